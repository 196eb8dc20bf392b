"""The phase function is a density of directions, and what it samples follows it."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import Report
from support.kernels import map_function, uniforms
from support.statistics import chi_square_test, integrate_pdf_over_bins, sphere_histogram

from wrt.kernels.media.phase import phase, sample_phase
from wrt.kernels.sampling.warps import square_to_sphere

N = 2**20
MEANS = (-0.95, -0.5, 0.0, 1e-4, 0.3, 0.8, 0.99)
FORWARD = np.array([0.0, 0.0, 1.0])


def henyey_greenstein(cosine: np.ndarray, g: float) -> np.ndarray:
    return (1.0 - g * g) / (4.0 * np.pi * (1.0 + g * g - 2.0 * g * cosine) ** 1.5)


def drawn(g: float, device: str, forward: np.ndarray = FORWARD) -> np.ndarray:
    directions = np.broadcast_to(forward, (N, 3))
    return map_function(sample_phase, directions, np.full(N, g), uniforms(N, 2, seed=4), device=device)


@pytest.mark.parametrize("g", MEANS)
def test_directions_follow_the_phase_function(g: float, device: str, report: Report) -> None:
    counts = sphere_histogram(drawn(g, device))
    g32 = float(np.float32(g))

    def expected(mean: float) -> np.ndarray:
        return N * integrate_pdf_over_bins(lambda d: henyey_greenstein(d[..., 2], mean), counts.shape)

    result = chi_square_test(counts, expected(g32), tests=len(MEANS))
    report(f"g = {g:g}", result.statistic, result.dof, p=result.p)
    assert result.passed, result.message
    # With another mean cosine they do not.
    assert not chi_square_test(
        counts, expected(g + 0.05 * (1.0 if g < 0.0 else -1.0)), tests=len(MEANS), total_tolerance=1.0
    ).passed


def test_directions_turn_with_the_way(device: str) -> None:
    forward = np.array([0.48, -0.6, 0.64])
    directions = drawn(0.8, device, forward).astype(np.float64)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-6)
    assert abs((directions @ forward).mean() - 0.8) < 4.0 * 0.4 / np.sqrt(N)
    across = np.cross(forward, [0.0, 0.0, 1.0])
    assert abs((directions @ across).mean()) < 4.0 * 0.4 / np.sqrt(N)


@pytest.mark.parametrize("g", MEANS)
def test_its_value_is_the_formula(g: float, device: str) -> None:
    cosine = np.linspace(-1.0, 1.0, 1001)
    value = map_function(phase, cosine, np.full(1001, g), device=device)
    expected = henyey_greenstein(np.float32(cosine).astype(np.float64), float(np.float32(g)))
    # 1 + g² − 2 g cosθ is a difference of near numbers for g near 1 and θ near 0.
    np.testing.assert_allclose(value, expected, rtol=2e-6 / (1.0 - abs(g)) ** 2)


def test_uniform_directions(device: str, report: Report) -> None:
    counts = sphere_histogram(map_function(square_to_sphere, uniforms(N, 2, seed=6), device=device))
    expected = N * integrate_pdf_over_bins(lambda d: np.full(d.shape[:-1], 0.25 / np.pi), counts.shape)
    result = chi_square_test(counts, expected)
    report("sphere", result.statistic, result.dof, p=result.p)
    assert result.passed, result.message
