"""Maps from the unit square have the density they state."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.kernels import map_function, uniforms
from support.statistics import chi_square_test, integrate_pdf_over_bins, sphere_histogram

from wrt.kernels.sampling.warps import square_to_cosine_hemisphere, square_to_disk, square_to_sphere, square_to_triangle

N = 2**20
Counts = tuple[NDArray, NDArray]


def disk(points: NDArray) -> Counts:
    r2 = (points**2).sum(axis=1)
    assert r2.max() <= 1.0 + 1e-6
    # Cells of equal area: rings of r², and sectors.
    i = np.minimum((r2 * 51).astype(int), 50)
    j = np.minimum(((np.arctan2(points[:, 1], points[:, 0]) / (2.0 * np.pi) + 0.5) * 101).astype(int), 100)
    return np.bincount(i * 101 + j, minlength=51 * 101), np.full(51 * 101, N / (51 * 101))


def hemisphere(directions: NDArray) -> Counts:
    assert directions[:, 2].min() >= 0.0
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-6)
    return sphere_histogram(directions), N * integrate_pdf_over_bins(lambda d: np.maximum(d[:, 2], 0.0) / np.pi)


def sphere(directions: NDArray) -> Counts:
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-6)
    counts = sphere_histogram(directions)  # in cells of equal area
    return counts, np.full(counts.shape, N / counts.size)


def triangle(points: NDArray) -> Counts:
    assert points.min() >= 0.0
    assert points.sum(axis=1).max() <= 1.0 + 1e-6
    # n² congruent triangles: squares of side 1/n, each cut by its diagonal, and the last of each row uncut.
    n = 71
    cell = np.minimum((points * n).astype(int), n - 1)
    above = ((points * n - cell).sum(axis=1) > 1.0) & (cell.sum(axis=1) < n - 1)
    counts = np.bincount((cell[:, 0] * n + cell[:, 1]) * 2 + above, minlength=2 * n * n)
    a, b, top = (x.ravel() for x in np.meshgrid(np.arange(n), np.arange(n), np.arange(2), indexing="ij"))
    inside = (a + b + top) < n
    assert counts[~inside].sum() == 0
    return counts[inside], np.full(n * n, N / n**2)


MAPS = [
    (square_to_disk, disk, 1),
    (square_to_cosine_hemisphere, hemisphere, 2),
    (square_to_triangle, triangle, 3),
    (square_to_sphere, sphere, 4),
]


@pytest.mark.parametrize(("function", "count", "seed"), MAPS, ids=[count.__name__ for _, count, _ in MAPS])
def test_maps_have_their_density(function, count, seed: int, device: str, report: Report) -> None:
    points = map_function(function, uniforms(N, 2, seed=seed), device=device).astype(np.float64)
    result = chi_square_test(*count(points), tests=len(MAPS))
    report(count.__name__, result.statistic, result.dof, p=result.p)
    assert result.passed, result.message
