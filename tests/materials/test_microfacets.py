"""Distributions of microfacet normals and their maskings: the printed ones, normalised, and sampled as stated."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import ArrayLike, NDArray
from scipy import integrate, special
from support.kernels import uniforms, upload
from support.ray_trees import unit
from support.statistics import chi_square_test, integrate_pdf_over_bins, sphere_histogram

from wrt.kernels.microfacet import DISTRIBUTIONS, LEAST_ALPHA, make_microfacet, maskings_of
from wrt.scene.materials import microfacet as described
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
    g = make_microfacet(name, masking).g

    @wp.kernel(enable_backward=False, module=module)
    def evaluate(
        shape: wp.vec3,
        wo: wp.array(dtype=wp.vec3),
        wi: wp.array(dtype=wp.vec3),
        m: wp.array(dtype=wp.vec3),
        values_out: wp.array(dtype=float),
    ):
        i = wp.tid()
        values_out[i] = g(wo[i], wi[i], m[i], shape)

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
        """Return G; with the normal as `wi`, which is never masked, it is G1(wo)."""
        return self._launch(kernels(self.name).maskings[name], float, device, wo, wi, m)

    def d(self, m: Array, device: str) -> Array:
        return self._launch(kernels(self.name).density, wp.vec2, device, [0.0, 0.0, 1.0], m)[0]

    def pdf(self, wo: ArrayLike, m: Array, device: str) -> Array:
        return self._launch(kernels(self.name).density, wp.vec2, device, wo, m)[1]

    def sample(self, wo: ArrayLike, u: NDArray[np.float32], device: str) -> Array:
        return self._launch(kernels(self.name).sample, wp.vec3, device, wo, u).T

    def stretched_density(self, density: Callable[[Array], Array]) -> Callable[[Array], Array]:
        """Return the density of stretched normals.

        The linear map M of them to normals takes the solid angle dω at s to |det M| / |M s|³ dω.
        """

        def of(stretched: Array) -> Array:
            m = stretched * np.array([*self.scale, 1.0])
            length = np.linalg.norm(m, axis=1)
            return density(m / length[:, None]) * self.scale[0] * self.scale[1] / length**3

        return of


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


ROUGHNESSES = (1e-4, 0.1, 1.0)
# The first, second and fifth of sgd are chrome steel, alum-bronze and dark red paint (Bagher et al. 2012).
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


# --- Distributions ------------------------------------------------------------------------------------


def printed_d(case: Case, m: Array) -> Array:
    """Return D as the papers print it, or by its definition, in double precision."""
    cos, tan2 = m[:, 2], (m[:, 0] ** 2 + m[:, 1] ** 2) / m[:, 2] ** 2
    a, b, _ = case.shape
    if case.name in ("ggx", "beckmann"):
        x2 = (m[:, 0] ** 2 / a**2 + m[:, 1] ** 2 / b**2) / cos**2
        return (1.0 / (1.0 + x2) ** 2 if case.name == "ggx" else np.exp(-x2)) / (np.pi * a * b * cos**4)
    if case.name == "blinn-phong":
        n = 2.0 / a**2 - 2.0
        return (n + 2.0) / (2.0 * np.pi) * np.exp(-0.5 * n * np.log1p(tan2))
    if case.name == "abc":
        v = (m[:, 0] ** 2 + m[:, 1] ** 2) / (1.0 + cos)
        points = [p for p in (1.0 / a, 30.0 / a, 1e3 / a) if p < 1.0]
        area, _ = integrate.quad(
            lambda v: (1.0 - v) * (1.0 + a * v) ** -b, 0.0, 1.0, points=points, epsabs=0, limit=200
        )
        return (1.0 + a * v) ** -b / (2.0 * np.pi * area)
    y = a + tan2 / a
    # Γ(1 − p, α), from its value at 0 < 1 − p + n by Γ(s, α) = (Γ(s + 1, α) − α^s exp(−α)) / s.
    s = 1.0 - b
    fraction = s % 1.0 or 1.0
    upper = special.exp1(a) if s in (0.0, -1.0) else special.gammaincc(fraction, a) * special.gamma(fraction)
    for k in np.arange(s, s % 1.0 if s % 1.0 else 0.0)[::-1]:
        upper = (upper - a**k * np.exp(-a)) / k
    return np.exp(-y) / y**b / (a * upper * np.pi * cos**4)


@pytest.mark.parametrize("case", CASES, ids=str)
def test_distribution_is_the_printed_one_and_normalised(case: Case, device: str, report: Report) -> None:
    """∫ D cosθ dω = ∫∫ D cos⁴θ dx dy over slopes, by the trapezoidal rule in ln r from 1e-4 of the width to 1e4."""
    log_r = np.linspace(np.log(1e-4), np.log(1e4 / min(case.scale)), 4000)
    phi = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False) + 0.1
    r, phi = (a.ravel() for a in np.meshgrid(np.exp(log_r), phi))
    slope = np.stack([case.scale[0] * r * np.cos(phi), case.scale[1] * r * np.sin(phi), np.ones_like(r)], axis=1)
    m = unit(slope).astype(np.float32)
    found, expected = case.d(m, device), printed_d(case, m.astype(np.float64))
    area = r**2 * case.scale[0] * case.scale[1] * (log_r[1] - log_r[0]) * (2.0 * np.pi / 16)
    total = float(np.sum(found * m[:, 2].astype(np.float64) ** 4 * area))
    is_significant = (expected > 1e-20 * expected.max()) & (r > 1e-3) & (r < 50.0)
    error = np.abs(found[is_significant] / expected[is_significant] - 1.0)
    report(f"{case}: ∫ D cosθ dω", total, 1.0)
    report(f"{case}: largest relative error", float(error.max()), 0.0)
    assert abs(total - 1.0) < 1e-4
    # The argument of exp is rounded, too: 50 roundings and more where D has fallen by 20 orders.
    assert error.max() < 3e-5
    assert is_significant.sum() > 10_000
    assert not case.d(m * np.array([1.0, 1.0, -1.0]), device).any()


def test_sgd_constants_are_the_published_ones(device: str, report: Report) -> None:
    """1 / (α Γ(1 − p, α)) of the authors' fits: alum-bronze, alumina oxide, black obsidian, delrin.

    And D cosθ ≤ 1.5 times the density of its samples, so that no sample weighs much more than others.
    """
    for alpha, p, published in (
        (0.014832, 0.459076, 46.3841),
        (0.000159222, 0.377727, 4381.96),
        (0.000153649, 0.186234, 5668.57),
        (0.176535, 0.762088, 5.02017),
    ):
        found = sgd_normalization(alpha, p) * np.exp(alpha) * alpha**p
        report(f"sgd {alpha:g}, {p:g}: K", found, published)
        assert found == pytest.approx(published, rel=2e-3)
    for case in (case for case in CASES if case.name == "sgd"):
        m = case.sample([0.0, 0.0, 1.0], uniforms(100_000, 2, seed=3), device)
        weight = case.d(m, device) * m[:, 2] / case.pdf([0.0, 0.0, 1.0], m, device)
        assert weight.max() < 1.5
        assert abs(weight.mean() - 1.0) < 4.0 * weight.std() / np.sqrt(len(m)) + 1e-5


# --- Sampling ---------------------------------------------------------------------------------------

CHOSEN = ((1e-4, 1e-3), (0.5, 0.05), (1.0, 1.0))
SAMPLED = [
    *((case, degrees) for case in VISIBLE if case.shape[:2] in CHOSEN for degrees in (0.0, 45.0, 89.0)),
    *((case, 45.0) for case in CASES if case not in VISIBLE and case.shape[0] != 0.5),
]
QUICK = [("ggx", 89.0), ("beckmann", 45.0)]


def marked(case: Case, degrees: float) -> object:
    quick = (case.name, degrees) in QUICK and case.shape[0] == 0.5
    return pytest.param(case, degrees, marks=() if quick else pytest.mark.slow, id=f"{case} at {degrees:g}")


@pytest.mark.parametrize(("case", "degrees"), [marked(*each) for each in SAMPLED])
def test_normals_follow_their_density(case: Case, degrees: float, device: str, report: Report) -> None:
    wo = viewer(degrees)
    m = case.sample(wo, uniforms(N, 2, seed=int(degrees)), device)
    np.testing.assert_allclose(np.linalg.norm(m, axis=1), 1.0, atol=1e-6)
    density = case.stretched_density(lambda m: case.pdf(wo, m, device))
    expected = N * integrate_pdf_over_bins(density, RESOLUTION, tolerance=1e-6)
    assert abs(expected.sum() / N - 1.0) < 2e-4
    # Of some cells a mere corner is visible, which quadrature may miss; that samples are visible is asserted below.
    expected = np.maximum(expected, 1e-6)
    stretched = unit(m / np.array([*case.scale, 1.0]))
    result = chi_square_test(sphere_histogram(stretched, RESOLUTION), expected, tests=len(SAMPLED))
    report(f"{case} at {degrees:g}°", result.statistic, result.dof, p=result.p)
    assert result.passed, result.message
    assert (case.pdf(wo, m, device) > 0.0).all()


# --- Masking ----------------------------------------------------------------------------------------


def smith_g1(case: Case, w: Array) -> Array:
    """Return Smith's G1 as printed (Heitz 2014, section 5), in double precision."""
    s = np.hypot(case.shape[0] * w[:, 0], case.shape[1] * w[:, 1])
    if case.name == "ggx":
        return 2.0 / (1.0 + np.sqrt(1.0 + (s / w[:, 2]) ** 2))
    a = np.minimum(w[:, 2] / np.maximum(s, 1e-10), 100.0)  # from where on nothing is hidden
    with np.errstate(under="ignore"):
        return np.asarray(2.0 / (1.0 + special.erf(a) + np.exp(-a * a) / (a * np.sqrt(np.pi))))


@pytest.mark.parametrize("name", [name for name in DISTRIBUTIONS if "smith" in maskings_of(name)])
def test_smith_is_exact(name: str, device: str, report: Report) -> None:
    wo = np.concatenate([hemisphere(20_000, seed=4), [viewer(a) for a in (*ANGLES, 89.9, 89.99)]])
    up = np.broadcast_to([0.0, 0.0, 1.0], wo.shape)
    largest = 0.0
    for case in (case for case in CASES if case.name == name):
        found = case.masking("smith-separable", up, wo, up, device)
        largest = max(largest, float(np.abs(found / smith_g1(case, wo) - 1.0).max()))
    report(f"{name}: largest relative error of G1", largest, 0.0)
    assert largest < 5e-6


def test_walters_fit(device: str, report: Report) -> None:
    """Within 0.5 % of Smith's G1 of Beckmann's distribution, at every angle and for Blinn's as well."""
    wo = np.array([viewer(a) for a in np.linspace(0.0, 89.99, 20_000)])
    up = np.broadcast_to([0.0, 0.0, 1.0], wo.shape)
    for case in (slopes("beckmann", 0.5), slopes("beckmann", 0.5, 0.05), slopes("blinn-phong", 0.8)):
        found = case.masking("walter", up, wo, up, device)
        error = float(np.abs(found / smith_g1(case, wo) - 1.0).max())
        report(f"{case}: largest relative error", error, "< 0.005")
        assert error < 0.005
        assert found.max() == 1.0


def test_maskings_are_the_printed_ones(device: str) -> None:
    wo, wi = hemisphere(20_000, seed=7), hemisphere(20_000, seed=8)
    m = unit(wo + wi)
    case = slopes("ggx", 0.5)
    dot, nl, nv, nh = np.sum(wo * m, axis=1), wi[:, 2], wo[:, 2], m[:, 2]
    g_o, g_i = smith_g1(case, wo), smith_g1(case, wi)
    expected = {
        "implicit": nl * nv,
        "kelemen": nl * nv * 2.0 / (1.0 + np.sum(wo * wi, axis=1)),
        "cook-torrance": np.minimum(1.0, np.minimum(2.0 * nh * nv / dot, 2.0 * nh * nl / dot)),
        "smith": 1.0 / (1.0 / g_o + 1.0 / g_i - 1.0),
        "smith-separable": g_o * g_i,
    }
    clear = dot > 0.05
    for masking, value in expected.items():
        found = case.masking(masking, m, wo, wi, device)
        np.testing.assert_allclose(found[clear], value[clear], rtol=1e-5 if "smith" in masking else 1e-4)


def test_materials_may_ask_for_what_kernels_have() -> None:
    in_kernels = {name: set(maskings_of(name)) for name in DISTRIBUTIONS}
    in_kernels["blinn-phong"].remove("smith")  # borrowed, and makes light at grazing angles whatever the roughness
    assert in_kernels == {name: set(maskings) for name, maskings in described.MASKINGS.items()}
    assert float(LEAST_ALPHA) == described.LEAST_ALPHA
    with pytest.raises(ValueError, match="'smith' is not known for the distribution 'abc'"):
        make_microfacet("abc", "smith")
