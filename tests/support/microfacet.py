"""Distributions of microfacet normals and their maskings as functions over arrays, and the test cases."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray
from scipy import special

from support.kernels import upload
from support.statistics import integrate_pdf_over_bins
from wrt.kernels.microfacet import DISTRIBUTIONS, make_microfacet, maskings_of
from wrt.scene.materials.microfacet import sgd_normalization

N = 2**18
ANGLES = (0.0, 45.0, 80.0, 89.0)
RESOLUTION = (25, 51)
"""Cells of histograms in cosθ and φ."""

Array = NDArray[np.float64]


@functools.cache
def kernels(name: str) -> tuple[wp.Kernel, wp.Kernel]:
    """Return a kernel that evaluates a distribution with any of its maskings, by number, and one that samples it."""
    parts = make_microfacet(name, "implicit")
    d, normal_pdf, sample_normal = parts.d, parts.normal_pdf, parts.sample_normal

    @wp.func(name=f"test_no_masking_{DISTRIBUTIONS[name].__name__.split('.')[-1]}")
    def masking(which: int, wo: wp.vec3, wi: wp.vec3, m: wp.vec3, shape: wp.vec3) -> wp.vec2:
        return wp.vec2(-1.0, -1.0)

    for number, masking_name in enumerate(maskings_of(name)):
        masking = link(masking, number, name, masking_name)

    @wp.kernel(enable_backward=False, module="unique")
    def evaluate(
        which: int,
        shape: wp.vec3,
        wo: wp.array(dtype=wp.vec3),
        wi: wp.array(dtype=wp.vec3),
        m: wp.array(dtype=wp.vec3),
        values_out: wp.array(dtype=wp.vec4),
    ):
        i = wp.tid()
        both = wp.vec2(0.0, 0.0)
        if which >= 0:
            both = masking(which, wo[i], wi[i], m[i], shape)
        values_out[i] = wp.vec4(d(m[i], shape), normal_pdf(wo[i], m[i], shape), both[0], both[1])

    @wp.kernel(enable_backward=False, module="unique")
    def sample(
        shape: wp.vec3,
        wo: wp.array(dtype=wp.vec3),
        u: wp.array(dtype=wp.vec2),
        m_out: wp.array(dtype=wp.vec3),
    ):
        i = wp.tid()
        m_out[i] = sample_normal(wo[i], shape, u[i])

    return evaluate, sample


def link(others: wp.Function, number: int, distribution: str, masking: str) -> wp.Function:
    parts = make_microfacet(distribution, masking)
    g, g1 = parts.g, parts.g1

    @wp.func(name=f"test_masking_{distribution}_{masking}".replace("-", "_"))
    def masked(which: int, wo: wp.vec3, wi: wp.vec3, m: wp.vec3, shape: wp.vec3) -> wp.vec2:
        if which == wp.static(number):
            return wp.vec2(g(wo, wi, m, shape), g1(wo, m, shape))
        return others(which, wo, wi, m, shape)

    return masked


@dataclass(frozen=True)
class Case:
    """A distribution with its shape; `scale` stretches its peak over about the whole hemisphere."""

    name: str
    shape: tuple[float, float, float]
    scale: tuple[float, float]

    def __str__(self) -> str:
        return f"{self.name} {self.shape[0]:g}, {self.shape[1]:g}"

    def values(self, device: str, m: Array, wo: ArrayLike, wi: ArrayLike | None = None, masking: str = "") -> Array:
        """Return rows of D, density of normals, G and G1(wo)."""
        which = maskings_of(self.name).index(masking) if masking else -1
        rows = [np.broadcast_to(a, m.shape) for a in (wo, wo if wi is None else wi, m)]
        out = wp.empty(len(m), dtype=wp.vec4, device=device)
        inputs = [which, wp.vec3(*self.shape), *(upload(a, wp.vec3, device) for a in rows)]
        wp.launch(kernels(self.name)[0], len(m), inputs, [out], device=device)
        return out.numpy().T.astype(np.float64)

    def d(self, m: Array, device: str) -> Array:
        return self.values(device, m, [0.0, 0.0, 1.0])[0]

    def pdf(self, wo: ArrayLike, m: Array, device: str) -> Array:
        return self.values(device, m, wo)[1]

    def sample(self, wo: ArrayLike, u: NDArray[np.float32], device: str) -> Array:
        out = wp.empty(len(u), dtype=wp.vec3, device=device)
        rows = upload(np.broadcast_to(wo, (len(u), 3)), wp.vec3, device)
        wp.launch(kernels(self.name)[1], len(u), [wp.vec3(*self.shape), rows, upload(u, wp.vec2, device)], [out])
        return out.numpy().astype(np.float64)

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


# --- Beckmann's masking, exact and as Walter fits it --------------------------------------------------


def stretched_cotangent(w: Array, alpha: tuple[float, float]) -> Array:
    """Return a = 1 / (α tanθ); where it is 100 and more, nothing is hidden."""
    return np.minimum(w[:, 2] / np.maximum(np.hypot(alpha[0] * w[:, 0], alpha[1] * w[:, 1]), 1e-10), 100.0)


def smith_lambda_beckmann(a: Array) -> Array:
    """Return Λ of Beckmann's distribution (Walter 2007): G1 = 1 / (1 + Λ)."""
    return np.asarray(0.5 * (np.exp(-a * a) / (a * np.sqrt(np.pi)) - special.erfc(a)))


def g1_fit(a: Array) -> Array:
    """Return Walter's rational fit of 1 / (1 + Λ): Walter 2007, eq. 27."""
    return np.where(a >= 1.6, 1.0, (3.535 * a + 2.181 * a * a) / (1.0 + 2.276 * a + 2.577 * a * a))
