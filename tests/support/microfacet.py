"""Distributions of microfacet normals and their maskings as functions over arrays, and the test cases."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from support.kernels import upload
from support.statistics import integrate_pdf_over_bins
from wrt.kernels.microfacet import make_microfacet, maskings_of
from wrt.scene.materials.microfacet import sgd_normalization

N = 2**18
ANGLES = (0.0, 45.0, 80.0, 89.0)
RESOLUTION = (25, 51)
"""Cells of histograms in cosθ and φ."""

Array = NDArray[np.float64]


class Kernels(NamedTuple):
    """A distribution's density and sampling, and its maskings by name."""

    density: wp.Kernel
    sample: wp.Kernel
    maskings: dict[str, wp.Kernel]


@functools.cache
def kernels(name: str) -> Kernels:
    module = wp.get_module(f"test.microfacet.{name}")
    parts = make_microfacet(name, "implicit")
    d, normal_pdf, sample_normal = parts.d, parts.normal_pdf, parts.sample_normal

    @wp.kernel(enable_backward=False, module=module)
    def density(
        shape: wp.vec3, wo: wp.array(dtype=wp.vec3), m: wp.array(dtype=wp.vec3), values_out: wp.array(dtype=wp.vec2)
    ):
        i = wp.tid()
        values_out[i] = wp.vec2(d(m[i], shape), normal_pdf(wo[i], m[i], shape))

    @wp.kernel(enable_backward=False, module=module)
    def sample(shape: wp.vec3, wo: wp.array(dtype=wp.vec3), u: wp.array(dtype=wp.vec2), m_out: wp.array(dtype=wp.vec3)):
        i = wp.tid()
        m_out[i] = sample_normal(wo[i], shape, u[i])

    return Kernels(density, sample, {masking: masking_kernel(name, masking, module) for masking in maskings_of(name)})


def masking_kernel(name: str, masking: str, module: wp.Module) -> wp.Kernel:
    parts = make_microfacet(name, masking)
    g, g1 = parts.g, parts.g1

    @wp.kernel(enable_backward=False, module=module)
    def evaluate(
        shape: wp.vec3,
        wo: wp.array(dtype=wp.vec3),
        wi: wp.array(dtype=wp.vec3),
        m: wp.array(dtype=wp.vec3),
        values_out: wp.array(dtype=wp.vec2),
    ):
        i = wp.tid()
        values_out[i] = wp.vec2(g(wo[i], wi[i], m[i], shape), g1(wo[i], m[i], shape))

    return evaluate


@dataclass(frozen=True)
class Case:
    """A distribution with its shape; `scale` stretches its peak over about the whole hemisphere."""

    name: str
    shape: tuple[float, float, float]
    scale: tuple[float, float]

    def __str__(self) -> str:
        return f"{self.name} {self.shape[0]:g}, {self.shape[1]:g}"

    def _launch(self, kernel: wp.Kernel, dtype: Any, device: str, *columns: ArrayLike) -> Array:
        n = len(np.asarray(columns[-1]))
        arrays = [
            upload(np.broadcast_to(a, (n, np.shape(a)[-1])), wp.types.vector(np.shape(a)[-1], float), device)
            for a in columns
        ]
        out = wp.empty(n, dtype=dtype, device=device)
        wp.launch(kernel, n, [wp.vec3(*self.shape), *arrays], [out], device=device)
        return out.numpy().T.astype(np.float64)

    def masking(self, name: str, m: Array, wo: ArrayLike, wi: ArrayLike, device: str) -> Array:
        """Return rows of G and G1(wo)."""
        return self._launch(kernels(self.name).maskings[name], wp.vec2, device, wo, wi, m)

    def d(self, m: Array, device: str) -> Array:
        return self._launch(kernels(self.name).density, wp.vec2, device, [0.0, 0.0, 1.0], m)[0]

    def pdf(self, wo: ArrayLike, m: Array, device: str) -> Array:
        return self._launch(kernels(self.name).density, wp.vec2, device, wo, m)[1]

    def sample(self, wo: ArrayLike, u: NDArray[np.float32], device: str) -> Array:
        return self._launch(kernels(self.name).sample, wp.vec3, device, wo, u).T

    def unstretched(self, stretched: Array) -> tuple[Array, Array]:
        """Return the normals that stretched ones stand for, and what a density of normals is multiplied by.

        The linear map M takes the solid angle dω at s to |det M| / |M s|³ dω.
        """
        m = stretched * np.array([*self.scale, 1.0])
        length = np.linalg.norm(m, axis=1)
        return m / length[:, None], self.scale[0] * self.scale[1] / length**3

    def stretched_density(self, density: Callable[[Array], Array]) -> Callable[[Array], Array]:
        def of(s: Array) -> Array:
            m, jacobian = self.unstretched(s)
            return density(m) * jacobian

        return of

    def integral(self, f: Callable[[Array], Array]) -> float:
        """Return ∫ f(m) dm over the hemisphere, in cells that are small where the distribution has its peak."""

        def upper(s: Array) -> Array:
            return np.where(s[:, 2] > 0.0, self.stretched_density(f)(s), 0.0)

        return float(integrate_pdf_over_bins(upper, (8, 16), tolerance=1e-7).sum())


def slopes(name: str, alpha_u: float, alpha_v: float | None = None) -> Case:
    alpha_v = alpha_u if alpha_v is None else alpha_v
    return Case(name, (alpha_u, alpha_v, 0.0), (alpha_u, alpha_v))


def abc(b: float, c: float) -> Case:
    width = min(np.sqrt(2.0 / b), 1.0)
    return Case("abc", (b, c, 0.0), (width, width))


def sgd(alpha: float, p: float) -> Case:
    # The density of samples has a step at tan²θ = α. That is at cosθ = 3/5 in this scale, between cells of histograms.
    width = 0.75 * np.sqrt(alpha)
    return Case("sgd", (alpha, p, sgd_normalization(alpha, p)), (width, width))


ROUGHNESSES = (1e-4, 0.1, 0.5, 1.0)
# Those of sgd are of chrome steel, alum-bronze and dark red paint (Bagher et al. 2012), but for the exact p.
CASES = [
    *(slopes(name, alpha) for name in ("ggx", "beckmann", "blinn-phong") for alpha in ROUGHNESSES),
    *(slopes(name, *pair) for name in ("ggx", "beckmann") for pair in ((0.5, 0.05), (1e-4, 1e-3))),
    *(abc(*pair) for pair in ((0.1, 0.5), (10.0, 1.0), (100.0, 2.0), (1e3, 1.0001), (1e6, 0.9), (50.0, 40.0))),
    *(
        sgd(*pair)
        for pair in ((3.13e-5, 0.1528), (0.0148, 0.459), (0.1, 0.0), (0.05, 1.0), (0.674, 1.381), (0.02, 2.0))
    ),
]
VISIBLE = [case for case in CASES if case.name in ("ggx", "beckmann")]
"""Cases that sample visible normals: those alone depend on the viewer."""


def viewer(degrees: float, azimuth: float = 0.7) -> Array:
    theta = np.radians(degrees)
    w = np.array([np.sin(theta) * np.cos(azimuth), np.sin(theta) * np.sin(azimuth), np.cos(theta)])
    return w.astype(np.float32).astype(np.float64)


def hemisphere(n: int, seed: int) -> Array:
    """Return directions, half of them within 6° of the horizon."""
    d = np.random.default_rng(seed).normal(size=(n, 3))
    d[:, 2] = np.abs(d[:, 2])
    d[: n // 2, 2] *= 0.1
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    return d.astype(np.float32).astype(np.float64)


def normalised(v: Array) -> Array:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)
