"""Microfacet distributions are normalised and sampled as stated; masking is what its sources say."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import ArrayLike, NDArray
from scipy import integrate, special
from support.kernels import map_function, uniforms, upload
from support.statistics import chi_square_test, integrate_pdf_over_bins, sphere_histogram

from wrt.distributions import sgd_normalization
from wrt.kernels.microfacet import DISTRIBUTIONS, MASKINGS, make_microfacet, maskings_of
from wrt.kernels.microfacet.masking import beta_from_one

N = 2**18
ANGLES = (0.0, 45.0, 80.0, 89.0)
LAST = 1.0 - 2.0**-24
"""The largest random number."""

RESOLUTION = (25, 51)
"""Cells of histograms in cosθ and φ."""

Array = NDArray[np.float64]


# --- Running the device functions -------------------------------------------------------------------


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


ROUGHNESSES = (1e-4, 0.01, 0.1, 0.5, 1.0)
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


# --- Distributions ----------------------------------------------------------------------------------


@pytest.mark.parametrize("case", CASES, ids=str)
def test_projected_area_is_one(case: Case, device: str, report: Report) -> None:
    """∫ D cosθ dω = ∫∫ D cos⁴θ dx dy over slopes, by the trapezoidal rule in ln r."""
    # Slopes from 1e-4 of the peak's width to 1e4.
    log_r = np.linspace(np.log(1e-4), np.log(1e4 / min(case.scale)), 4000)
    phi = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False) + 0.1
    r, phi = (a.ravel() for a in np.meshgrid(np.exp(log_r), phi))
    x, y = case.scale[0] * r * np.cos(phi), case.scale[1] * r * np.sin(phi)
    m = normalised(np.stack([x, y, np.ones_like(x)], axis=1))
    area = r**2 * case.scale[0] * case.scale[1] * (log_r[1] - log_r[0]) * (2.0 * np.pi / 16)
    found = float(np.sum(case.d(m, device) * m[:, 2] ** 4 * area))
    report(f"{case}: ∫ D cosθ dω", found, 1.0)
    assert abs(found - 1.0) < 1e-4


def printed_d(case: Case, m: Array) -> Array:
    """Return D as the papers print it, or by its definition, in double precision."""
    cos, tan2 = m[:, 2], (m[:, 0] ** 2 + m[:, 1] ** 2) / m[:, 2] ** 2
    a, b, _ = case.shape
    if case.name in ("ggx", "beckmann"):
        x2 = (m[:, 0] ** 2 / a**2 + m[:, 1] ** 2 / b**2) / cos**2
    if case.name == "ggx":
        return 1.0 / (np.pi * a * b * cos**4 * (1.0 + x2) ** 2)
    if case.name == "beckmann":
        return np.exp(-x2) / (np.pi * a * b * cos**4)
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
    upper = (
        special.exp1(a)
        if s == 0.0 or s == -1.0
        else special.gammaincc(s % 1.0 or 1.0, a) * special.gamma(s % 1.0 or 1.0)
    )
    for k in np.arange(s, s % 1.0 if s % 1.0 else 0.0)[::-1]:
        upper = (upper - a**k * np.exp(-a)) / k
    return np.exp(-y) / y**b / (a * upper * np.pi * cos**4)


@pytest.mark.parametrize("case", CASES, ids=str)
def test_distribution_is_the_printed_one(case: Case, device: str, report: Report) -> None:
    r = np.exp(np.linspace(np.log(1e-3), np.log(50.0), 2000))
    phi = np.linspace(0.0, 40.0, 2000)
    x, y = case.scale[0] * r * np.cos(phi), case.scale[1] * r * np.sin(phi)
    m = normalised(np.stack([x, y, np.ones_like(x)], axis=1)).astype(np.float32)
    found, expected = case.d(m, device), printed_d(case, m.astype(np.float64))
    seen = expected > 1e-20 * expected.max()
    error = np.abs(found[seen] / expected[seen] - 1.0)
    report(f"{case}: largest relative error", float(error.max()), 0.0)
    # Rounding, and that of the argument of exp, where D has fallen by 20 orders: 50 roundings and more.
    assert error.max() < 3e-5
    assert seen.mean() > 0.5
    below = m * np.array([1.0, 1.0, -1.0])
    assert (case.d(below, device) == 0.0).all()


def test_anisotropic_distributions_turn_with_their_axes(device: str) -> None:
    m, wo = hemisphere(10_000, seed=1), hemisphere(10_000, seed=2)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    for name in ("ggx", "beckmann"):
        there = slopes(name, 0.5, 0.1).values(device, m, wo, masking="smith")
        back = slopes(name, 0.1, 0.5).values(device, m @ turn, wo @ turn, masking="smith")
        np.testing.assert_allclose(there, back, rtol=1e-5, atol=1e-30)


def test_sgd_constants_are_the_published_ones(report: Report) -> None:
    """1 / (α Γ(1 − p, α)) of the authors' fits: alum-bronze, alumina oxide, black obsidian, delrin."""
    for alpha, p, published in (
        (0.014832, 0.459076, 46.3841),
        (0.000159222, 0.377727, 4381.96),
        (0.000153649, 0.186234, 5668.57),
        (0.176535, 0.762088, 5.02017),
    ):
        found = sgd_normalization(alpha, p) * np.exp(alpha) * alpha**p
        report(f"sgd {alpha:g}, {p:g}: K", found, published)
        assert found == pytest.approx(published, rel=2e-3)
    with pytest.raises(ValueError, match="alpha must be above 0"):
        sgd_normalization(0.0, 0.5)


# --- Sampling ---------------------------------------------------------------------------------------

CHOSEN = ((1e-4, 1e-3), (0.5, 0.05), (1.0, 1.0))
SAMPLED = [
    *((case, degrees) for case in VISIBLE if case.shape[:2] in CHOSEN for degrees in ANGLES),
    *((case, 45.0) for case in CASES if case not in VISIBLE and case.shape[0] not in (0.01, 0.5)),
]


@pytest.mark.parametrize(("case", "degrees"), SAMPLED, ids=str)
def test_normals_follow_their_density(case: Case, degrees: float, device: str, report: Report) -> None:
    wo = viewer(degrees)
    m = case.sample(wo, uniforms(N, 2, seed=int(degrees)), device)
    np.testing.assert_allclose(np.linalg.norm(m, axis=1), 1.0, atol=1e-6)
    density = case.stretched_density(lambda m: case.pdf(wo, m, device))
    expected = N * integrate_pdf_over_bins(density, RESOLUTION, tolerance=1e-7)
    # Of some cells a mere corner is visible, which quadrature may miss; that samples are visible is asserted below.
    expected = np.maximum(expected, 1e-6)
    stretched = normalised(m / np.array([*case.scale, 1.0]))
    result = chi_square_test(sphere_histogram(stretched, RESOLUTION), expected, tests=len(SAMPLED))
    report(f"{case} at {degrees:g}°", result.statistic, result.dof, p=result.p)
    assert result.passed, result.message
    assert (case.pdf(wo, m, device) > 0.0).all()


@pytest.mark.parametrize("case", VISIBLE, ids=str)
def test_density_of_visible_normals_is_one_in_all(case: Case, device: str, report: Report) -> None:
    for degrees in (*ANGLES, 89.99):
        found = case.integral(functools.partial(case.pdf, viewer(degrees), device=device))
        report(f"{case} at {degrees:g}°", found, 1.0)
        assert abs(found - 1.0) < 1e-4


def test_sgd_samples_are_never_far_from_the_distribution(device: str, report: Report) -> None:
    """D cosθ ≤ 1.5 times the density of its samples, so that no sample weighs much more than others."""
    for case in (case for case in CASES if case.name == "sgd"):
        m = case.sample([0.0, 0.0, 1.0], uniforms(100_000, 2, seed=3), device)
        weight = case.d(m, device) * m[:, 2] / case.pdf([0.0, 0.0, 1.0], m, device)
        report(f"{case}: largest weight", float(weight.max()), "< 1.5")
        assert weight.max() < 1.5
        assert abs(weight.mean() - 1.0) < 4.0 * weight.std() / np.sqrt(len(m)) + 1e-5


# --- Masking ----------------------------------------------------------------------------------------


def smith_g1(case: Case, w: Array) -> Array:
    """Return Smith's G1 as printed (Heitz 2014, section 5), in double precision."""
    s = np.hypot(case.shape[0] * w[:, 0], case.shape[1] * w[:, 1])
    a = np.abs(w[:, 2]) / np.maximum(s, 1e-30)
    if case.name == "ggx":
        return 2.0 / (1.0 + np.sqrt(1.0 + 1.0 / a**2))
    with np.errstate(under="ignore"):
        return 2.0 / (1.0 + special.erf(a) + np.exp(-(np.minimum(a, 30.0) ** 2)) / (a * np.sqrt(np.pi)))


@pytest.mark.parametrize("name", [name for name in DISTRIBUTIONS if "smith" in maskings_of(name)])
def test_smith_is_exact(name: str, device: str, report: Report) -> None:
    wo = np.concatenate([hemisphere(20_000, seed=4), [viewer(a) for a in (*ANGLES, 89.9, 89.99)]])
    up = np.broadcast_to([0.0, 0.0, 1.0], wo.shape)
    worst = 0.0
    for case in (case for case in CASES if case.name == name):
        expected = smith_g1(case, wo)
        found = case.values(device, up, wo, masking="smith")[3]
        worst = max(worst, float(np.abs(found / expected - 1.0).max()))
    report(f"{name}: largest relative error of G1", worst, 0.0)
    assert worst < 5e-6


IDENTITIES = [
    *((case, "smith") for case in VISIBLE if case.shape[0] >= 0.1 or case.shape[0] == case.shape[1]),
    *((case, "cook-torrance") for case in CASES if case.shape[0] in (0.1, 0.5, 0.0148, 10.0)),
]


@pytest.mark.parametrize(("case", "masking"), IDENTITIES, ids=str)
def test_visible_microfacets_cover_the_surface(case: Case, masking: str, device: str, report: Report) -> None:
    """∫ G1(wo, m) max(0, wo·m) D(m) dm = cosθo (Heitz 2014, eq. 14), for any D where microfacets are grooves."""
    for degrees in (*ANGLES, 89.9):
        wo = viewer(degrees)

        def visible(m: Array, wo: Array = wo) -> Array:
            d, _, _, g1 = case.values(device, m, wo, masking=masking)
            return d * g1 * np.maximum(m @ wo, 0.0) / wo[2]

        found = case.integral(visible)
        report(f"{case}, {masking} at {degrees:g}°", found, 1.0)
        assert abs(found - 1.0) < 2e-4


def test_walters_fit(device: str, report: Report) -> None:
    """Within 0.5 % of Smith's G1 of Beckmann's distribution, at every angle and for Blinn's as well."""
    wo = np.array([viewer(a) for a in np.linspace(0.0, 89.99, 20_000)])
    up = np.broadcast_to([0.0, 0.0, 1.0], wo.shape)
    for case in (slopes("beckmann", 0.5), slopes("beckmann", 0.5, 0.05), slopes("blinn-phong", 0.8)):
        found = case.values(device, up, wo, masking="walter")[3]
        error = float(np.abs(found / smith_g1(case, wo) - 1.0).max())
        report(f"{case}: largest relative error", error, "< 0.005")
        assert error < 0.005
        assert found.max() == 1.0


def pairs(eta: float, seed: int) -> tuple[Array, Array, Array]:
    """Return viewers, lights on the same side (eta 1) or the other, and the normals that join them."""
    wo, wi = hemisphere(50_000, seed), hemisphere(50_000, seed + 1)
    if eta != 1.0:
        # The normal of refraction (Walter 2007, eq. 16), on the viewer's side; pairs it cannot join are left out.
        wi *= np.array([1.0, 1.0, -1.0])
        m = normalised(wo + eta * wi)
        m *= np.sign(m[:, 2:])
        joined = (np.sum(m * wo, axis=1) > 1e-4) & (np.sum(m * wi, axis=1) < -1e-4)
        return wo[joined], wi[joined], m[joined]
    return wo, wi, normalised(wo + wi)


@pytest.mark.parametrize("eta", [1.0, 1.5])
@pytest.mark.parametrize("name", DISTRIBUTIONS)
def test_masking_is_a_fraction_and_symmetric(name: str, eta: float, device: str) -> None:
    wo, wi, m = pairs(eta, seed=5)
    assert len(m) > 5_000
    for case in (case for case in CASES if case.name == name):
        values = {}
        for masking in maskings_of(name):
            _, _, g, g1 = case.values(device, m, wo, wi, masking)
            back = case.values(device, m, wi, wo, masking)[2]
            np.testing.assert_array_equal(g, back)
            assert g.min() >= 0.0
            assert max(g.max(), g1.max()) <= 1.0
            assert (g[g1 == 0.0] == 0.0).all()
            values[masking] = g
            # A direction behind the microfacet sees nothing of it.
            _, _, g, g1 = case.values(device, m * np.array([-1.0, -1.0, 1.0]), wo, wi, masking)
            mirrored = m * np.array([-1.0, -1.0, 1.0])
            behind = np.sum(mirrored * wo, axis=1) < -1e-6
            assert behind.sum() > 100
            assert (g[behind] == 0.0).all()
            assert (g1[behind] == 0.0).all()
        if "smith" in values:
            # Heights help each other on one side, and hinder each other across, where rounding is that of logarithms.
            difference = values["smith"] - values["smith-separable"]
            assert (difference.min() > -2e-7) if eta == 1.0 else (difference.max() < 2e-6)


def test_general_maskings_are_the_printed_ones(device: str) -> None:
    wo, wi, m = pairs(1.0, seed=7)
    case = slopes("ggx", 0.5)
    dot, nl, nv, nh = np.sum(wo * m, axis=1), wi[:, 2], wo[:, 2], m[:, 2]
    expected = {
        "implicit": nl * nv,
        "kelemen": nl * nv * 2.0 / (1.0 + np.sum(wo * wi, axis=1)),
        "cook-torrance": np.minimum(1.0, np.minimum(2.0 * nh * nv / dot, 2.0 * nh * nl / dot)),
    }
    clear = dot > 0.05
    for masking, value in expected.items():
        found = case.values(device, m, wo, wi, masking)[2]
        np.testing.assert_allclose(found[clear], value[clear], rtol=1e-4)
    for masking in ("smith", "smith-separable"):
        g_o, g_i = smith_g1(case, wo), smith_g1(case, wi)
        value = g_o * g_i if masking == "smith-separable" else 1.0 / (1.0 / g_o + 1.0 / g_i - 1.0)
        np.testing.assert_allclose(case.values(device, m, wo, wi, masking)[2], value, rtol=1e-5)


def test_masking_across_the_surface_is_a_beta_function(device: str, report: Report) -> None:
    a, b = (x.ravel() for x in np.meshgrid(*[np.concatenate([[0.0], np.geomspace(1e-6, 1e4, 80)])] * 2))
    found = map_function(beta_from_one, a, b, device=device)
    expected = special.betaln(1.0 + a, 1.0 + b)
    likely = expected > -40.0
    error = float(np.abs(found[likely] / np.exp(expected[likely]) - 1.0).max())
    report("largest relative error", error, 0.0)
    assert error < 2e-5
    assert (found[~likely] < 1e-17).all()


@pytest.mark.parametrize("name", DISTRIBUTIONS)
def test_nothing_is_infinite(name: str, device: str) -> None:
    """At the least and the greatest roughness, along the surface, for the first and the last random number."""
    u = uniforms(20_000, 2, seed=8)
    edges = [0.0, 2.0**-24, 0.25, 0.5, 0.75, LAST]
    u[:36] = [(a, b) for a in edges for b in edges]
    grazing = np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 1e-7], [0.6, 0.8, 1e-20], [0.0, 0.0, 1.0]])
    for case in (case for case in CASES if case.name == name):
        for wo in (*(viewer(a) for a in (0.0, 80.0, 89.99, 89.9999)), *grazing):
            m = case.sample(wo, u, device)
            assert np.isfinite(m).all()
            np.testing.assert_allclose(np.linalg.norm(m, axis=1), 1.0, atol=1e-6)
            assert m[:, 2].min() >= 0.0
            m = np.concatenate([m, grazing, hemisphere(1000, seed=9)])
            wi = hemisphere(len(m), seed=10)
            wi[::2, 2] *= -1.0
            for masking in maskings_of(name):
                values = case.values(device, m, wo, wi, masking)
                assert np.isfinite(values).all(), masking
                assert values.min() >= 0.0


# --- Names ------------------------------------------------------------------------------------------


def test_every_pair_is_made_or_refused() -> None:
    for name in DISTRIBUTIONS:
        for masking in MASKINGS:
            if masking in maskings_of(name):
                assert all(isinstance(part, wp.Function) for part in make_microfacet(name, masking))
                continue
            with pytest.raises(ValueError, match=f"'{masking}' is not known for the distribution '{name}'"):
                make_microfacet(name, masking)
    assert maskings_of("beckmann") == maskings_of("blinn-phong") == MASKINGS
    assert maskings_of("abc") == maskings_of("sgd") == ("cook-torrance", "kelemen", "implicit")
    with pytest.raises(ValueError, match="no distribution 'phong'"):
        make_microfacet("phong", "smith")
    with pytest.raises(ValueError, match="no masking 'none'"):
        make_microfacet("ggx", "none")
