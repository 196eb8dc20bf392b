"""Distributions of microfacet normals are the printed ones, normalised, and sampled as stated."""

from __future__ import annotations

import functools

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

from wrt.scene.materials.microfacet import sgd_normalization


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
    # GPUs fuse products and sums, so turned axes round otherwise: nearer to 0, wo·m has larger errors than are allowed.
    clear = np.abs((m * wo).sum(axis=1)) > 0.02
    m, wo = m[clear], wo[clear]
    assert clear.mean() > 0.9
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
