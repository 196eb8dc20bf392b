"""Maps from the unit square have the density they state."""

from __future__ import annotations

import numpy as np
from conftest import Report
from support.kernels import map_function, uniforms
from support.statistics import chi_square_test, integrate_pdf_over_bins, sphere_histogram

from wrt.kernels.sampling.warps import square_to_cosine_hemisphere, square_to_disk, square_to_sphere, square_to_triangle

N = 2**20
TESTS = 4


def test_disk_is_uniform(device: str, report: Report) -> None:
    points = map_function(square_to_disk, uniforms(N, 2, seed=1), device=device).astype(np.float64)
    r2 = (points**2).sum(axis=1)
    assert r2.max() <= 1.0 + 1e-6
    # Cells of equal area: rings of r², and sectors.
    i = np.minimum((r2 * 51).astype(int), 50)
    j = np.minimum(((np.arctan2(points[:, 1], points[:, 0]) / (2.0 * np.pi) + 0.5) * 101).astype(int), 100)
    counts = np.bincount(i * 101 + j, minlength=51 * 101)
    result = chi_square_test(counts, np.full(51 * 101, N / (51 * 101)), tests=TESTS)
    report("disk", result.statistic, result.dof, p=result.p)
    assert result.passed, result.message


def test_disk_is_sane_where_its_two_halves_meet(device: str) -> None:
    last = 1.0 - 2.0**-24
    corners = np.array([(0.5, 0.5), (0.0, 0.0), (0.0, last), (last, 0.0), (last, last), (0.5, 0.0), (0.0, 0.5)])
    points = map_function(square_to_disk, corners, device=device)
    radius = np.abs(2.0 * corners - 1.0).max(axis=1)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), radius, atol=1e-6)


def test_hemisphere_is_cosine_distributed(device: str, report: Report) -> None:
    directions = map_function(square_to_cosine_hemisphere, uniforms(N, 2, seed=2), device=device)
    assert directions[:, 2].min() >= 0.0
    np.testing.assert_allclose(np.linalg.norm(directions.astype(np.float64), axis=1), 1.0, atol=1e-6)
    expected = N * integrate_pdf_over_bins(lambda d: np.maximum(d[:, 2], 0.0) / np.pi)
    result = chi_square_test(sphere_histogram(directions), expected, tests=TESTS)
    report("cosine hemisphere", result.statistic, result.dof, p=result.p)
    assert result.passed, result.message


def test_sphere_is_uniform(device: str, report: Report) -> None:
    directions = map_function(square_to_sphere, uniforms(N, 2, seed=4), device=device)
    np.testing.assert_allclose(np.linalg.norm(directions.astype(np.float64), axis=1), 1.0, atol=1e-6)
    counts = sphere_histogram(directions)  # in cells of equal area
    result = chi_square_test(counts, np.full(counts.shape, N / counts.size), tests=TESTS)
    report("sphere", result.statistic, result.dof, p=result.p)
    assert result.passed, result.message


def test_triangle_is_uniform(device: str, report: Report) -> None:
    points = map_function(square_to_triangle, uniforms(N, 2, seed=3), device=device).astype(np.float64)
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
    result = chi_square_test(counts[inside], np.full(n * n, N / n**2), tests=TESTS)
    report("triangle", result.statistic, result.dof, p=result.p)
    assert result.passed, result.message
