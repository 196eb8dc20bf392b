"""Distributions of microfacet normals and their maskings: the printed ones, normalised, and sampled as stated."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import Report
from scipy import integrate, special
from support.kernels import uniforms
from support.microfacet import (
    ANGLES,
    CASES,
    RESOLUTION,
    VISIBLE,
    Array,
    Case,
    N,
    hemisphere,
    normalised,
    slopes,
    viewer,
)
from support.statistics import chi_square_test, integrate_pdf_over_bins, sphere_histogram

from wrt.kernels.microfacet import DISTRIBUTIONS, LEAST_ALPHA, make_microfacet, maskings_of
from wrt.scene.materials import microfacet as described
from wrt.scene.materials.microfacet import sgd_normalization


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
    whole = s % 1.0 or 1.0
    upper = special.exp1(a) if s in (0.0, -1.0) else special.gammaincc(whole, a) * special.gamma(whole)
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
    m = normalised(slope).astype(np.float32)
    found, expected = case.d(m, device), printed_d(case, m.astype(np.float64))
    area = r**2 * case.scale[0] * case.scale[1] * (log_r[1] - log_r[0]) * (2.0 * np.pi / 16)
    total = float(np.sum(found * m[:, 2].astype(np.float64) ** 4 * area))
    seen = (expected > 1e-20 * expected.max()) & (r > 1e-3) & (r < 50.0)
    error = np.abs(found[seen] / expected[seen] - 1.0)
    report(f"{case}: ∫ D cosθ dω", total, 1.0)
    report(f"{case}: largest relative error", float(error.max()), 0.0)
    assert abs(total - 1.0) < 1e-4
    # Rounding, and that of the argument of exp, where D has fallen by 20 orders: 50 roundings and more.
    assert error.max() < 3e-5
    assert seen.sum() > 10_000
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
    with pytest.raises(ValueError, match="alpha must be above 0"):
        sgd_normalization(0.0, 0.5)
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
    stretched = normalised(m / np.array([*case.scale, 1.0]))
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
    worst = 0.0
    for case in (case for case in CASES if case.name == name):
        found = case.masking("smith", up, wo, wo, device)[1]
        worst = max(worst, float(np.abs(found / smith_g1(case, wo) - 1.0).max()))
    report(f"{name}: largest relative error of G1", worst, 0.0)
    assert worst < 5e-6


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "masking"),
    [
        *((case, "smith") for case in VISIBLE if case.shape[:2] in (*CHOSEN[1:], (1e-4, 1e-4), (0.1, 0.1))),
        *((case, "cook-torrance") for case in CASES if case.shape[0] in (0.1, 0.0148, 10.0)),
    ],
    ids=str,
)
def test_visible_microfacets_cover_the_surface(case: Case, masking: str, device: str, report: Report) -> None:
    """∫ G1(wo, m) max(0, wo·m) D(m) dm = cosθo (Heitz 2014, eq. 14), for any D where microfacets are grooves.

    Where visible normals are sampled, that is the integral of their density as well.
    """
    for degrees in (45.0, 89.9):
        wo = viewer(degrees)

        def visible(m: Array, wo: Array = wo) -> Array:
            return case.d(m, device) * case.masking(masking, m, wo, wo, device)[1] * np.maximum(m @ wo, 0.0) / wo[2]

        found = case.integral(visible)
        report(f"{case}, {masking} at {degrees:g}°", found, 1.0)
        assert abs(found - 1.0) < 2e-4


def test_walters_fit(device: str, report: Report) -> None:
    """Within 0.5 % of Smith's G1 of Beckmann's distribution, at every angle and for Blinn's as well."""
    wo = np.array([viewer(a) for a in np.linspace(0.0, 89.99, 20_000)])
    up = np.broadcast_to([0.0, 0.0, 1.0], wo.shape)
    for case in (slopes("beckmann", 0.5), slopes("beckmann", 0.5, 0.05), slopes("blinn-phong", 0.8)):
        found = case.masking("walter", up, wo, wo, device)[1]
        error = float(np.abs(found / smith_g1(case, wo) - 1.0).max())
        report(f"{case}: largest relative error", error, "< 0.005")
        assert error < 0.005
        assert found.max() == 1.0


def pairs(seed: int) -> tuple[Array, Array, Array]:
    """Return viewers, lights, and the normals that join them."""
    wo, wi = hemisphere(20_000, seed), hemisphere(20_000, seed + 1)
    return wo, wi, normalised(wo + wi)


@pytest.mark.parametrize("name", DISTRIBUTIONS)
def test_masking_is_a_fraction_and_symmetric(name: str, device: str) -> None:
    wo, wi, m = pairs(seed=5)
    mirrored = m * np.array([-1.0, -1.0, 1.0])
    behind = np.sum(mirrored * wo, axis=1) < -1e-6
    assert behind.sum() > 40
    for case in (case for case in CASES if case.name == name):
        for masking in maskings_of(name):
            g, g1 = case.masking(masking, m, wo, wi, device)
            np.testing.assert_array_equal(g, case.masking(masking, m, wi, wo, device)[0])
            assert g.min() >= 0.0
            assert max(g.max(), g1.max()) <= 1.0
            assert not g[g1 == 0.0].any()
            # A direction behind the microfacet sees nothing of it.
            assert not case.masking(masking, mirrored, wo, wi, device)[:, behind].any()


def test_maskings_are_the_printed_ones(device: str) -> None:
    wo, wi, m = pairs(seed=7)
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
        found = case.masking(masking, m, wo, wi, device)[0]
        np.testing.assert_allclose(found[clear], value[clear], rtol=1e-5 if "smith" in masking else 1e-4)


def test_materials_may_ask_for_what_kernels_have() -> None:
    known = {name: set(maskings_of(name)) for name in DISTRIBUTIONS}
    known["blinn-phong"].remove("smith")  # borrowed, and makes light at grazing angles whatever the roughness
    assert known == {name: set(maskings) for name, maskings in described.MASKINGS.items()}
    assert float(LEAST_ALPHA) == described.LEAST_ALPHA
    with pytest.raises(ValueError, match="'smith' is not known for the distribution 'abc'"):
        make_microfacet("abc", "smith")
