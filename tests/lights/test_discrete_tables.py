"""Tables of weights, alias tables and tiles of probabilities: each index gets its share, and kernels draw it so."""

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
from wrt.kernels.sampling.warps import sample_alias
from wrt.upload.lights.alias import AliasTable, make_alias_table
from wrt.upload.lights.piecewise import UNITS, integrals, part_edges, tiles


@wp.kernel(enable_backward=False)
def draw_indices(
    thresholds: wp.array(dtype=float),
    aliases: wp.array(dtype=int),
    u: wp.array(dtype=wp.vec2),
    out: wp.array(dtype=wp.vec2),
):
    i = wp.tid()
    choice = sample_alias(thresholds, aliases, u[i][0], u[i][1])
    out[i] = wp.vec2(float(choice.index), choice.rest)


@wp.struct
class Tile:
    edges: wp.array(dtype=wp.uint16)
    first: int
    rows: int
    columns: int


@wp.kernel(enable_backward=False)
def draw_cells(tile: Tile, u: wp.array(dtype=wp.vec2), out: wp.array2d(dtype=wp.vec2)):
    i = wp.tid()
    s = sample_tile(tile.edges, tile.first, tile.rows, tile.columns, u[i])
    p = tile_probability(tile.edges, tile.first, tile.rows, tile.columns, s.row, s.column)
    out[0, i] = wp.vec2(float(s.row), float(s.column))
    out[1, i] = wp.vec2(s.probability, p)
    out[2, i] = s.rest


def drawn(table: AliasTable, u: NDArray, device: str) -> tuple[NDArray, NDArray]:
    """Return indices, and what is left of the numbers."""
    out = wp.zeros(len(u), dtype=wp.vec2, device=device)
    arrays = [upload(table.thresholds, float, device), upload(table.aliases, int, device), upload(u, wp.vec2, device)]
    wp.launch(draw_indices, len(u), arrays, [out], device=device)
    return out.numpy()[:, 0].astype(int), out.numpy()[:, 1]


def implied(table: AliasTable) -> NDArray[np.float64]:
    """Return the probability with which the table, as stored, yields each index."""
    keep = table.thresholds.astype(np.float64)
    return (keep + np.bincount(table.aliases, 1.0 - keep, minlength=len(keep))) / len(keep)


def weights_of(name: str) -> NDArray[np.float64]:
    rng = np.random.default_rng(0)
    if name == "one":
        return np.array([0.1])
    if name == "equal":
        return np.full(999_983, 0.1)
    if name == "lognormal":
        return rng.lognormal(0.0, 4.0, 100_000)
    if name == "one of a million":
        return np.r_[np.full(999_999, 1e-9), 1.0]
    if name == "mostly zero":
        return np.where(rng.random(10_000) < 0.99, 0.0, rng.random(10_000))
    if name == "equal to the mean":
        return np.r_[np.full(20, 2.0), 1.0, 3.0]
    return 2.0 ** -np.arange(60.0)


NAMES = ("one", "equal", "lognormal", "one of a million", "mostly zero", "equal to the mean", "powers of two")


@pytest.mark.parametrize("name", NAMES)
def test_alias_table_implies_the_weights(name: str, report: Report) -> None:
    weights = weights_of(name)
    table = make_alias_table(weights)
    assert (table.thresholds.dtype, table.aliases.dtype) == (np.float32, np.int32)
    assert len(table.thresholds) == len(table.aliases) == len(table.probabilities) == len(weights)
    assert 0.0 <= table.thresholds.min() <= table.thresholds.max() <= 1.0
    assert 0 <= table.aliases.min() <= table.aliases.max() < len(weights)
    exact = weights / weights.sum()
    np.testing.assert_allclose(table.probabilities, exact, rtol=1e-12)
    found = implied(table)
    error = np.abs(found - exact)
    report(f"{name}: total variation from the weights", float(0.5 * error.sum()), 0.0)
    assert 0.5 * error.sum() <= 1e-6
    assert (error <= 1e-6 * exact).all()
    assert (found[weights == 0.0] == 0.0).all()


def test_alias_tables_of_every_small_size_and_of_extremely_uneven_weights() -> None:
    """Sixty orders of magnitude: what is too light for a float32 threshold may vanish, nothing else."""
    rng = np.random.default_rng(1)
    for n in (*range(1, 300), 20_000):
        weights = rng.integers(0, 5, n).astype(float) if n < 300 else 10.0 ** rng.uniform(-30.0, 30.0, n)
        weights[rng.random(n) < 0.3] = 0.0
        weights[rng.integers(n)] = 3.0
        exact = weights / weights.sum()
        found = implied(make_alias_table(weights))
        assert (np.abs(found - exact) <= 1e-6 * exact + 1e-38).all(), f"{n} weights"
        assert (found[weights == 0.0] == 0.0).all()


@pytest.mark.parametrize("n", [1, 2, 13, 50_021])
def test_draws_follow_the_weights(n: int, device: str, report: Report) -> None:
    """And what is left of the number is uniform, whatever was chosen."""
    rng = np.random.default_rng(n)
    weights = np.where(rng.random(n) < 0.2, 0.0, rng.lognormal(0.0, 2.0, n))
    weights[0] = 1.0
    samples, cells = 2**20, 51 if n < 100 else 1
    index, rest = drawn(make_alias_table(weights), uniforms(samples, 2, seed=n), device)
    assert 0.0 <= rest.min() <= rest.max() < 1.0
    counts = np.bincount(index * cells + (rest * cells).astype(np.int64), minlength=n * cells)
    result = chi_square_test(counts, np.repeat(samples * weights / weights.sum(), cells) / cells, tests=4)
    report(f"{n} weights", result.statistic, result.dof, p=result.p)
    assert result.passed, result.message


def test_extreme_numbers_stay_inside_the_alias_table(device: str) -> None:
    last = 1.0 - 2.0**-24
    corners = np.array([(a, b) for a in (0.0, last) for b in (0.0, last)])
    for n in (1, 3, 1_000_003):
        weights = np.ones(n)
        weights[0] = weights[-1] = 0.0 if n > 2 else 1.0
        index, _ = drawn(make_alias_table(weights), corners, device)
        assert 0 <= index.min() <= index.max() < n
        assert (weights[index] > 0.0).all()


def test_large_alias_tables_draw_equal_weights_equally_often(device: str, report: Report) -> None:
    """A number of 24 bits has 5 or 6 values for each of three million slots: that must not show."""
    n, samples = 3 * 2**20, 2**20
    index, _ = drawn(make_alias_table(np.ones(n)), uniforms(samples, 2, seed=9), device)
    values = np.arange(2**24, dtype=np.float32) * np.float32(2.0**-24)
    per_slot = np.bincount(np.minimum((values * np.float32(n)).astype(np.int64), n - 1), minlength=n)
    rich = per_slot > per_slot.min()
    share, expected = float(rich[index].mean()), float(rich.mean())
    result = chi_square_test(np.array([share, 1.0 - share]) * samples, np.array([expected, 1.0 - expected]) * samples)
    report(f"{n} equal weights: share of slots with more values", share, expected, p=result.p)
    assert result.passed, result.message


def tile_weights(name: str, rows: int, columns: int) -> NDArray[np.float64]:
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


@pytest.mark.parametrize(
    ("name", "rows", "columns"), [("noise", 1, 1), ("noise", 1, 2), ("holes", 16, 32), ("one", 16, 32), ("sun", 64, 64)]
)
def test_cells_are_drawn_by_their_weights(name: str, rows: int, columns: int, device: str, report: Report) -> None:
    initialize_warp()
    n = 2**18
    weights = tile_weights(name, rows, columns)
    edges = tiles(weights)
    tile, out = Tile(), wp.empty((3, n), dtype=wp.vec2, device=device)
    tile.edges, tile.first = upload(edges.ravel(), wp.uint16, device), edges.shape[1]
    tile.rows, tile.columns = rows, columns
    wp.launch(draw_cells, n, [tile, upload(uniforms(n, 2, seed=3), wp.vec2, device)], [out], device=device)
    cells, probabilities, rests = out.numpy()
    cells = cells.astype(int)

    share = weights[1] / weights[1].sum()
    by_row = np.diff(edges[1, :rows].astype(int), append=UNITS) / UNITS
    in_row = np.diff(edges[1, rows:].reshape(rows, columns).astype(int), axis=1, append=UNITS) / UNITS
    stated = (by_row[:, None] * in_row).astype(np.float32)
    np.testing.assert_array_equal(probabilities[:, 0], probabilities[:, 1])
    np.testing.assert_array_equal(probabilities[:, 0], stated[cells[:, 0], cells[:, 1]])
    np.testing.assert_array_equal(stated > 0.0, share > 0.0)
    # Rows and columns are whole units, and those that would be shorter than a few are made that long.
    assert np.abs(stated - share).max() < 4.0 * (rows + columns) / UNITS
    counts = np.bincount(cells[:, 0] * columns + cells[:, 1], minlength=rows * columns)
    assert not counts[share.ravel() == 0.0].any()
    if (share > 0.0).sum() > 1:
        result = chi_square_test(counts, n * stated.ravel(), tests=3)
        report(f"{name}, {rows} x {columns}", result.statistic, result.dof, p=result.p)
        assert result.passed, result.message
    assert 0.0 <= rests.min() <= rests.max() < 1.0
    for axis in range(2):
        evenly = chi_square_test(np.histogram(rests[:, axis], 51, (0.0, 1.0))[0], np.full(51, n / 51), tests=10)
        assert evenly.passed, evenly.message


def test_every_part_with_a_weight_has_a_length() -> None:
    weights = np.array([[1e-30, 1.0, 0.0, 1e-30], [0.0, 0.0, 0.0, 0.0], [0.0, 2.0, 6.0, 0.0], [0.0, 0.0, 1e-3, 1e9]])
    lengths = np.diff(part_edges(weights).astype(int), axis=1, append=UNITS)
    np.testing.assert_array_equal(lengths > 0, (weights > 0.0) | (np.arange(4)[:, None] == 1))
    np.testing.assert_array_equal(lengths[1:3], np.array([[0.25, 0.25, 0.25, 0.25], [0.0, 0.25, 0.75, 0.0]]) * UNITS)


@pytest.mark.parametrize("beyond", ["edge", "wrap"])
@pytest.mark.parametrize(("texels", "parts"), [(1, 4), (7, 16), (50, 8)])
def test_integrals_are_those_of_the_interpolated_texels(texels: int, parts: int, beyond: str) -> None:
    """Beside a sum over a hundred thousand points."""
    values = np.random.default_rng(4).random((3, texels)) ** 4
    place = (np.arange(100_800) + 0.5) / 100_800 * texels
    around = np.pad(values, ((0, 0), (1, 1)), mode=beyond)  # type: ignore[call-overload]
    dense = np.stack([np.interp(place, np.arange(-1, texels + 1) + 0.5, row) for row in around])
    expected = dense.reshape(3, parts, -1).mean(axis=2) * texels / parts
    found = integrals(values, parts, 1, beyond)  # type: ignore[arg-type]
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(integrals(values.T, parts, 0, beyond), found.T, rtol=1e-12)  # type: ignore[arg-type]
