"""Alias tables give each index its share, and the kernel draws from them so."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import ArrayLike, NDArray
from support.kernels import uniforms, upload
from support.statistics import chi_square_test

from wrt.kernels.sampling.warps import sample_alias
from wrt.upload.lights.alias import AliasTable, make_alias_table


@wp.kernel(enable_backward=False)
def draw_indices(
    thresholds: wp.array(dtype=float),
    aliases: wp.array(dtype=int),
    u: wp.array(dtype=wp.vec2),
    index_out: wp.array(dtype=int),
    rest_out: wp.array(dtype=float),
):
    i = wp.tid()
    choice = sample_alias(thresholds, aliases, u[i][0], u[i][1])
    index_out[i] = choice.index
    rest_out[i] = choice.rest


def drawn_with_rest(table: AliasTable, u: NDArray, device: str) -> tuple[NDArray, NDArray]:
    out, rest = wp.zeros(len(u), dtype=int, device=device), wp.zeros(len(u), dtype=float, device=device)
    arrays = [upload(table.thresholds, float, device), upload(table.aliases, int, device), upload(u, wp.vec2, device)]
    wp.launch(draw_indices, len(u), arrays, [out, rest], device=device)
    return out.numpy(), rest.numpy()


def drawn(table: AliasTable, u: NDArray, device: str) -> NDArray:
    return drawn_with_rest(table, u, device)[0]


def implied(table: AliasTable) -> NDArray[np.float64]:
    """Return the probability with which the table, as stored, yields each index."""
    keep = table.thresholds.astype(np.float64)
    total = keep + np.bincount(table.aliases, 1.0 - keep, minlength=len(keep))
    return total / len(keep)


def tables() -> dict[str, NDArray]:
    rng = np.random.default_rng(0)
    result = {f"{n} random": rng.random(n) for n in (1, 2, 3, 7, 100, 1023, 1_000_000)}
    result |= {f"{n} equal": np.full(n, 0.1) for n in (1, 3, 10, 49, 1000, 999_983)}
    result["lognormal"] = rng.lognormal(0.0, 4.0, 100_000)
    result["one of a million"] = np.r_[np.full(999_999, 1e-9), 1.0]
    result["first heavy"] = np.r_[1e6, np.ones(99_999)]
    result["powers of two"] = 2.0 ** -np.arange(60.0)
    result["mostly zero"] = np.where(rng.random(10_000) < 0.99, 0.0, rng.random(10_000))
    result["a sun"] = np.where(np.arange(2**19) == 12345, 1e7, rng.random(2**19))
    result["first equal to the mean"] = np.array([2.0, 1.0, 3.0])
    result["all but two equal to the mean"] = np.r_[np.full(20, 2.0), 1.0, 3.0]
    result["zeros around one"] = np.array([0.0, 0.0, 5.0, 0.0])
    return result


@pytest.mark.parametrize("name", tables())
def test_table_implies_the_weights(name: str, report: Report) -> None:
    weights = tables()[name]
    table = make_alias_table(weights)
    assert table.thresholds.dtype == np.float32
    assert table.aliases.dtype == np.int32
    assert len(table.thresholds) == len(table.aliases) == len(table.probabilities) == len(weights)
    assert 0.0 <= table.thresholds.min() <= table.thresholds.max() <= 1.0
    assert 0 <= table.aliases.min() <= table.aliases.max() < len(weights)
    exact = weights / weights.sum()
    np.testing.assert_allclose(table.probabilities, exact, rtol=1e-12)
    assert table.probabilities.sum() == pytest.approx(1.0, abs=1e-12)
    found = implied(table)
    error = np.abs(found - exact)
    report(f"{name}: total variation from the weights", float(0.5 * error.sum()), 0.0)
    assert 0.5 * error.sum() <= 1e-6
    assert (error <= 1e-6 * exact).all()
    assert (found[weights == 0.0] == 0.0).all()


@pytest.mark.parametrize("seed", range(5))
def test_extremely_uneven_weights(seed: int) -> None:
    """Sixty orders of magnitude: what is too light for a float32 threshold may vanish, nothing else."""
    rng = np.random.default_rng(seed)
    weights = 10.0 ** rng.uniform(-30.0, 30.0, 20_000)
    weights[rng.random(20_000) < 0.3] = 0.0
    exact = weights / weights.sum()
    found = implied(make_alias_table(weights))
    assert np.abs(found - exact).max() <= 1e-6 * exact.max()
    assert (np.abs(found - exact) <= 1e-6 * exact + 1e-38).all()
    assert (found[weights == 0.0] == 0.0).all()


def test_tables_of_every_small_size() -> None:
    rng = np.random.default_rng(1)
    for n in range(1, 300):
        weights = rng.integers(0, 5, n).astype(float)
        weights[rng.integers(n)] = 3.0
        exact = weights / weights.sum()
        found = implied(make_alias_table(weights))
        np.testing.assert_allclose(found, exact, rtol=1e-6, atol=0.0, err_msg=f"{n} weights")


def weights_to_draw(n: int) -> NDArray:
    if n == 2:
        return np.array([1.0, 3.0])
    rng = np.random.default_rng(n)
    weights = rng.lognormal(0.0, 2.0, n)
    weights[rng.random(n) < 0.2] = 0.0
    weights[0] = 1.0
    return weights


@pytest.mark.parametrize("n", [1, 2, 13, 1009, 50_021])
def test_draws_follow_the_weights(n: int, device: str, report: Report) -> None:
    weights = weights_to_draw(n)
    table = make_alias_table(weights)
    samples = 2**21
    counts = np.bincount(drawn(table, uniforms(samples, 2, seed=n), device), minlength=n)
    assert counts[weights == 0.0].sum() == 0
    if n == 1:
        assert counts[0] == samples
        return
    result = chi_square_test(counts, samples * weights / weights.sum(), tests=4)
    report(f"{n} weights", result.statistic, result.dof, p=result.p)
    assert result.passed, result.message


@pytest.mark.parametrize("n", [1, 2, 13])
def test_what_is_left_of_the_number_is_uniform_whatever_was_chosen(n: int, device: str, report: Report) -> None:
    weights = weights_to_draw(n)
    samples, cells = 2**20, 51
    index, rest = drawn_with_rest(make_alias_table(weights), uniforms(samples, 2, seed=n + 1), device)
    assert 0.0 <= rest.min() <= rest.max() < 1.0
    counts = np.bincount(index * cells + (rest * cells).astype(np.int64), minlength=n * cells)
    expected = np.repeat(samples * weights / weights.sum(), cells) / cells
    result = chi_square_test(counts, expected, tests=3)
    report(f"{n} weights, with the rest", result.statistic, result.dof, p=result.p)
    assert result.passed, result.message


def test_extreme_numbers_stay_inside_the_table(device: str) -> None:
    last = 1.0 - 2.0**-24
    corners = np.array([(a, b) for a in (0.0, last) for b in (0.0, last)])
    for n in (1, 3, 1000, 1_000_003):
        weights = np.ones(n)
        weights[0] = weights[-1] = 0.0 if n > 2 else 1.0
        index = drawn(make_alias_table(weights), corners, device)
        assert 0 <= index.min() <= index.max() < n
        assert (weights[index] > 0.0).all()


@pytest.mark.parametrize("n", [1000, 3 * 2**18, 3 * 2**20])
def test_large_tables_draw_equal_weights_equally_often(n: int, device: str, report: Report) -> None:
    """A number of 24 bits has 5 or 6 values for each of three million slots: that must not show."""
    samples = 2**20
    index = drawn(make_alias_table(np.ones(n)), uniforms(samples, 2, seed=9), device)
    values = np.arange(2**24, dtype=np.float32) * np.float32(2.0**-24)
    per_slot = np.bincount(np.minimum((values * np.float32(n)).astype(np.int64), n - 1), minlength=n)
    rich = per_slot > per_slot.min()
    share = ratio(rich[index])
    counts = np.array([share, 1.0 - share]) * samples
    expected = np.array([ratio(rich), 1.0 - ratio(rich)]) * samples
    result = chi_square_test(counts, expected, tests=3)
    report(f"{n} equal weights: share of slots with more values", share, ratio(rich), p=result.p)
    assert result.passed, result.message


def ratio(values: ArrayLike) -> float:
    return float(np.mean(values))
