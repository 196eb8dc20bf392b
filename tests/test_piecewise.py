"""Tiles of probabilities: cells are drawn as often as they should be, and light is summed exactly over parts."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import NDArray
from support.kernels import uniforms, upload
from support.statistics import chi_square_test

from wrt.backend.warp_backend import initialize_warp
from wrt.kernels.sampling.piecewise import sample_tile, tile_probability
from wrt.upload.lights.piecewise import UNITS, integrals, part_edges, tiles

N = 2**18


@wp.kernel(enable_backward=False)
def draw_cells(
    edges: wp.array(dtype=wp.uint16),
    first: int,
    rows: int,
    columns: int,
    u: wp.array(dtype=wp.vec2),
    cell_out: wp.array(dtype=wp.vec2i),
    probability_out: wp.array(dtype=wp.vec2),
    rest_out: wp.array(dtype=wp.vec2),
):
    i = wp.tid()
    s = sample_tile(edges, first, rows, columns, u[i])
    cell_out[i] = wp.vec2i(s.row, s.column)
    probability_out[i] = wp.vec2(s.probability, tile_probability(edges, first, rows, columns, s.row, s.column))
    rest_out[i] = s.rest


def drawn(weights: NDArray, tile: int, u: NDArray, device: str) -> tuple[NDArray, NDArray, NDArray]:
    """Return cells (row, column), both probabilities and the rests, drawn from one of several tiles."""
    initialize_warp()
    edges = tiles(weights)
    _, rows, columns = weights.shape
    out = [wp.empty(len(u), dtype=dtype, device=device) for dtype in (wp.vec2i, wp.vec2, wp.vec2)]
    given = [upload(edges.ravel(), wp.uint16, device), tile * edges.shape[1], rows, columns, upload(u, wp.vec2, device)]
    wp.launch(draw_cells, len(u), given, out, device=device)
    cells, probabilities, rests = (array.numpy() for array in out)
    return cells, probabilities, rests


def weights_of(name: str, rows: int, columns: int) -> NDArray[np.float64]:
    """Return (2, R, C) weights: those of the first tile matter to none."""
    rng = np.random.default_rng(2)
    weights = rng.random((2, rows, columns)) ** 3
    if name == "holes":
        weights[1] *= rng.random((rows, columns)) < 0.4
        weights[1, [0, -1]] = 0.0
    elif name == "one":
        weights[1] = 0.0
        weights[1, rows // 2, columns - 1] = 3.0
    elif name == "sun":
        weights[1, rows // 2, 0] = 1e9
    return weights


def probabilities_of(tile: NDArray[np.uint16], rows: int, columns: int) -> NDArray[np.float32]:
    """Return (R, C) what the numbers of a tile say."""
    by_row = np.diff(tile[:rows].astype(int), append=UNITS) / UNITS
    in_row = np.diff(tile[rows:].reshape(rows, columns).astype(int), axis=1, append=UNITS) / UNITS
    return (by_row[:, None] * in_row).astype(np.float32)


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (1, 2), (16, 32), (64, 64)])
@pytest.mark.parametrize("name", ["noise", "holes", "one", "sun"])
def test_cells_are_drawn_by_their_weights(name: str, rows: int, columns: int, device: str, report: Report) -> None:
    weights = weights_of(name, rows, columns)
    if not weights[1].any():
        weights[1] = 1.0
    cells, probabilities, rests = drawn(weights, 1, uniforms(N, 2, seed=3), device)
    np.testing.assert_array_equal(probabilities[:, 0], probabilities[:, 1])
    share = weights[1] / weights[1].sum()
    stated = probabilities_of(tiles(weights)[1], rows, columns)
    np.testing.assert_array_equal(probabilities[:, 0], stated[cells[:, 0], cells[:, 1]])
    np.testing.assert_array_equal(stated > 0.0, share > 0.0)
    # Rows and columns are whole units, and those that would be shorter than a few are made that long.
    assert np.abs(stated - share).max() < 4.0 * (rows + columns) / UNITS
    counts = np.bincount(cells[:, 0] * columns + cells[:, 1], minlength=rows * columns)
    assert not counts[share.ravel() == 0.0].any()
    if (share > 0.0).sum() > 1:
        result = chi_square_test(counts, N * stated.ravel(), tests=12)
        report(f"{name}, {rows} x {columns}", result.statistic, result.dof, p=result.p)
        assert result.passed, result.message
    assert rests.min() >= 0.0
    assert rests.max() < 1.0
    for axis in range(2):
        evenly = chi_square_test(np.histogram(rests[:, axis], 51, (0.0, 1.0))[0], np.full(51, N / 51), tests=32)
        assert evenly.passed, evenly.message


def test_every_part_with_a_weight_has_a_length() -> None:
    weights = np.array([[1e-30, 1.0, 0.0, 1e-30], [0.0, 0.0, 0.0, 0.0], [0.0, 2.0, 6.0, 0.0], [0.0, 0.0, 1e-3, 1e9]])
    lengths = np.diff(part_edges(weights).astype(int), axis=1, append=UNITS)
    np.testing.assert_array_equal(lengths > 0, (weights > 0.0) | (np.arange(4)[:, None] == 1))
    np.testing.assert_array_equal(lengths[1:3], np.array([[0.25, 0.25, 0.25, 0.25], [0.0, 0.25, 0.75, 0.0]]) * UNITS)


@pytest.mark.parametrize("beyond", ["edge", "wrap"])
@pytest.mark.parametrize(("texels", "parts"), [(1, 1), (1, 4), (7, 16), (16, 16), (50, 8)])
def test_integrals_are_those_of_the_interpolated_texels(texels: int, parts: int, beyond: str, report: Report) -> None:
    """Beside a sum over a hundred thousand points."""
    values = np.random.default_rng(4).random((3, texels)) ** 4
    place = (np.arange(100_800) + 0.5) / 100_800 * texels
    around = np.pad(values, ((0, 0), (1, 1)), mode=beyond)  # type: ignore[call-overload]
    dense = np.stack([np.interp(place, np.arange(-1, texels + 1) + 0.5, row) for row in around])
    expected = dense.reshape(3, parts, -1).mean(axis=2) * texels / parts
    found = integrals(values, parts, 1, beyond)  # type: ignore[arg-type]
    report("largest error", float(np.abs(found - expected).max()))
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(integrals(values.T, parts, 0, beyond), found.T, rtol=1e-12)  # type: ignore[arg-type]
