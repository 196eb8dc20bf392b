"""Tables of weights and alias tables: each index gets its share, and kernels draw it so."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray
from support.kernels import uniforms, upload
from support.statistics import chi_square_test

from wrt.kernels.sampling.warps import sample_alias
from wrt.upload.lights.choice import AliasTable, make_alias_table
from wrt.upload.lights.piecewise import UNITS, integrals, part_edges


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


def weights_of_all_kinds() -> Iterator[NDArray[np.float64]]:
    rng = np.random.default_rng(1)
    yield np.full(999_983, 0.1)
    yield np.r_[np.full(999_999, 1e-9), 1.0]
    yield np.r_[np.full(20, 2.0), 1.0, 3.0]  # most are the mean
    yield 2.0 ** -np.arange(60.0)
    yield 10.0 ** rng.uniform(-30.0, 30.0, 20_000)
    for n in range(1, 300):
        weights = np.where(rng.random(n) < 0.3, 0.0, rng.integers(0, 5, n))
        weights[rng.integers(n)] = 3.0
        yield weights


def test_alias_tables_imply_the_weights() -> None:
    """Over sixty orders of magnitude: what is too light for a float32 threshold may vanish, nothing else."""
    for weights in weights_of_all_kinds():
        table = make_alias_table(weights)
        exact = weights / weights.sum()
        np.testing.assert_allclose(table.probabilities, exact, rtol=1e-12)
        found = implied(table)
        assert (np.abs(found - exact) <= 1e-6 * exact + 1e-38).all(), f"{len(weights)} weights"
        assert (found[weights == 0.0] == 0.0).all()


@pytest.mark.parametrize("n", [1, 2, 13, 50_021])
def test_draws_follow_the_weights(n: int, device: str) -> None:
    """And what is left of the number is uniform, whatever was chosen."""
    rng = np.random.default_rng(n)
    weights = np.where(rng.random(n) < 0.2, 0.0, rng.lognormal(0.0, 2.0, n))
    weights[0] = 1.0
    samples, cells = 2**20, 51 if n < 100 else 1
    index, leftover = drawn(make_alias_table(weights), uniforms(samples, 2, seed=n), device)
    assert 0.0 <= leftover.min() <= leftover.max() < 1.0
    counts = np.bincount(index * cells + (leftover * cells).astype(np.int64), minlength=n * cells)
    result = chi_square_test(counts, np.repeat(samples * weights / weights.sum(), cells) / cells, tests=4)
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


def test_large_alias_tables_draw_equal_weights_equally_often(device: str) -> None:
    """A number of 24 bits has 5 or 6 values for each of three million slots: that must not show."""
    n, samples = 3 * 2**20, 2**20
    index, _ = drawn(make_alias_table(np.ones(n)), uniforms(samples, 2, seed=9), device)
    values = np.arange(2**24, dtype=np.float32) * np.float32(2.0**-24)
    per_slot = np.bincount(np.minimum((values * np.float32(n)).astype(np.int64), n - 1), minlength=n)
    rich = per_slot > per_slot.min()
    share, expected = float(rich[index].mean()), float(rich.mean())
    result = chi_square_test(np.array([share, 1.0 - share]) * samples, np.array([expected, 1.0 - expected]) * samples)
    assert result.passed, result.message


def test_every_part_with_a_weight_has_a_length() -> None:
    weights = np.array([[1e-30, 1.0, 0.0, 1e-30], [0.0, 0.0, 0.0, 0.0], [0.0, 2.0, 6.0, 0.0], [0.0, 0.0, 1e-3, 1e9]])
    lengths = np.diff(part_edges(weights).astype(int), axis=1, append=UNITS)
    np.testing.assert_array_equal(lengths > 0, (weights > 0.0) | (np.arange(4)[:, None] == 1))
    np.testing.assert_array_equal(lengths[1:3], np.array([[0.25, 0.25, 0.25, 0.25], [0.0, 0.25, 0.75, 0.0]]) * UNITS)


@pytest.mark.parametrize("beyond", ["edge", "wrap"])
@pytest.mark.parametrize(("texels", "parts"), [(1, 4), (7, 16)])
def test_integrals_are_those_of_the_interpolated_texels(texels: int, parts: int, beyond: str) -> None:
    """Beside a sum over a hundred thousand points."""
    values = np.random.default_rng(4).random((3, texels)) ** 4
    place = (np.arange(100_800) + 0.5) / 100_800 * texels
    around = np.pad(values, ((0, 0), (1, 1)), mode=beyond)  # type: ignore[call-overload]
    dense = np.stack([np.interp(place, np.arange(-1, texels + 1) + 0.5, row) for row in around])
    expected = dense.reshape(3, parts, -1).mean(axis=2) * texels / parts
    found = integrals(values, parts, 1, beyond)  # type: ignore[arg-type]
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-7)
