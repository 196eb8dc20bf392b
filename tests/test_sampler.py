"""Random numbers: uniform, independent along every axis, and a pure function of their four names."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from scipy import stats
from support.kernels import draw, map_function
from support.statistics import chi_square_test, sidak

from wrt.kernels.sampling.sampler import unit_float, vertex_block

N = 2**20
AXES = ("seed", "pixel", "index", "block")
PLACES = {"seed": 7, "pixel": 4321, "index": 11, "block": 2}
"""Where the three other names stand while one of them runs."""
BINS = 101


def along(axis: str, device: str, *, start: int = 0, n: int = N, **places: int) -> NDArray:
    names = {**PLACES, **places, axis: start + np.arange(n, dtype=np.uint64)}
    return draw(*(names[a] for a in AXES), device)


def pcg4d(seed: NDArray, pixel: NDArray, index: NDArray, block: NDArray) -> NDArray:
    """Return the hash as printed in Jarzynski and Olano, "Hash Functions for GPU Rendering", JCGT 9(3), 2020."""
    v = np.stack([pixel, index, block, seed]).astype(np.uint32) * np.uint32(1664525) + np.uint32(1013904223)

    def mix() -> None:
        for a, b, c in ((0, 1, 3), (1, 2, 0), (2, 0, 1), (3, 1, 2)):
            v[a] += v[b] * v[c]

    mix()
    v[:] ^= v >> np.uint32(16)
    mix()
    return v.T


def test_numbers_are_the_published_hash(device: str) -> None:
    rng = np.random.default_rng(0)
    names = rng.integers(0, 2**32, (4, 100_000), dtype=np.uint64)
    names[:, :2] = np.array([[0, 2**32 - 1]])
    expected = (pcg4d(*names) >> np.uint32(8)).astype(np.float64) / 2.0**24
    np.testing.assert_array_equal(draw(*names, device).astype(np.float64), expected)


def test_numbers_do_not_depend_on_the_order_of_threads(device: str) -> None:
    names = np.random.default_rng(1).integers(0, 2**32, (4, 50_000), dtype=np.uint64)
    order = np.random.default_rng(2).permutation(50_000)
    np.testing.assert_array_equal(draw(*names[:, order], device), draw(*names, device)[order])


def test_all_bits_map_into_the_half_open_interval(device: str) -> None:
    bits = np.array([0, 255, 256, 2**31, 2**32 - 256, 2**32 - 1], np.uint32)
    values = map_function(unit_float, bits, device=device)
    np.testing.assert_array_equal(values, np.array([0, 0, 2**-24, 0.5, 1 - 2**-24, 1 - 2**-24], np.float32))


def test_numbers_lie_in_the_half_open_interval(device: str) -> None:
    for axis in AXES:
        u = along(axis, device)
        assert u.dtype == np.float32
        assert u.min() >= 0.0
        assert u.max() < 1.0


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("start", [0, 2**31 - N])
def test_each_number_is_uniform(axis: str, start: int, device: str, report: Report) -> None:
    u = along(axis, device, start=start)
    tests = 2 * 4 * len(AXES)
    for k in range(4):
        counts = np.bincount((u[:, k] * 1021).astype(int), minlength=1021)
        result = chi_square_test(counts, np.full(1021, N / 1021), tests=tests)
        report(f"number {k} along {axis} from {start}", result.statistic, result.dof, p=result.p)
        assert result.passed, f"number {k} along {axis}: {result.message}"


Pairs = dict[str, tuple[NDArray, NDArray]]


def pair_tests(pairs_from: Callable[[int, int], Pairs], report: Report) -> None:
    """Test that each pair of numbers is uniform on the unit square.

    Args:
        pairs_from: takes the first name and how many names to run through, and returns the pairs by name.
        report: of the run.

    A pair in doubt is tested once more, on four times as many other numbers: what was chance is gone then,
    while a defect shows more clearly.
    """
    pairs = pairs_from(0, N)
    p = {name: square_p(*pair) for name, pair in pairs.items()}
    worst = min(p, key=p.__getitem__)
    limit = sidak(0.01, len(p))
    report(f"least uniform of {len(p)} pairs: {worst}", p[worst], f"> {limit:.2g}", p=p[worst])
    doubtful = [name for name in p if p[name] < limit]
    if doubtful:
        again = pairs_from(N, 4 * N)
        p = {name: square_p(*again[name]) for name in doubtful}
        report(f"once more: {', '.join(p)}", min(p.values()), p=min(p.values()))
        assert min(p.values()) > sidak(0.01, len(p)), p


def square_p(a: NDArray, b: NDArray) -> float:
    cells = (a * BINS).astype(np.int64) * BINS + (b * BINS).astype(np.int64)
    counts = np.bincount(cells, minlength=BINS * BINS)
    return chi_square_test(counts, np.full(BINS * BINS, len(a) / BINS**2)).p


def test_a_defect_does_not_pass_for_chance() -> None:
    """Numbers that lean together by one percent fail."""

    def leaning(start: int, n: int) -> Pairs:
        a, b, c = np.random.default_rng(start).random((3, n))
        return {"leaning": (a, np.where(c < 0.01, a, b)), "well": (a, b)}

    with pytest.raises(AssertionError, match="leaning"):
        pair_tests(leaning, lambda *_, **__: None)


@pytest.mark.parametrize("axis", ["pixel", "index", "seed"])
def test_pairs_within_a_block_fill_the_square(axis: str, device: str, report: Report) -> None:
    def pairs(start: int, n: int) -> Pairs:
        u = along(axis, device, start=start, n=n)
        return {f"{i}, {j}": (u[:, i], u[:, j]) for i, j in itertools.combinations(range(4), 2)}

    pair_tests(pairs, report)


@pytest.mark.parametrize("axis", ["pixel", "index", "seed"])
def test_pairs_across_blocks_fill_the_square(axis: str, device: str, report: Report) -> None:
    """Film and lens, then light, environment and BSDF of the first vertex, and the next."""

    def pairs(start: int, n: int) -> Pairs:
        blocks = {block: along(axis, device, start=start, n=n, block=block) for block in (0, 5, 6, 7, 8)}
        return {
            f"{i} of block {a}, {j} of block {b}": (blocks[a][:, i], blocks[b][:, j])
            for a, b in itertools.combinations(blocks, 2)
            for i, j in itertools.product(range(4), repeat=2)
        }

    pair_tests(pairs, report)


@pytest.mark.parametrize(("axis", "step"), [("index", 1), ("pixel", 1), ("pixel", 768), ("seed", 1), ("index", 2**16)])
def test_pairs_of_neighbours_fill_the_square(axis: str, step: int, device: str, report: Report) -> None:
    """Consecutive samples, the pixel to the right and below, the next seed."""
    other = "index" if axis == "pixel" else "pixel"

    def pairs(start: int, n: int) -> Pairs:
        here = along(other, device, start=start, n=n)
        there = along(other, device, start=start, n=n, **{axis: PLACES[axis] + step})
        return {f"{i} here, {j} there": (here[:, i], there[:, j]) for i, j in itertools.product(range(4), repeat=2)}

    pair_tests(pairs, report)


def test_no_two_numbers_are_correlated(device: str, report: Report) -> None:
    """Numbers of several blocks, of neighbouring pixels and seeds, and with two names exchanged."""
    n = 2**18
    rows = [along("index", device, n=n, pixel=p, seed=s, block=b) for p in (0, 1) for s in (0, 1) for b in (0, 2, 7)]
    rows.append(along("pixel", device, n=n, index=0, seed=0, block=0))
    rows.append(along("block", device, n=n, index=0, seed=0, pixel=0))
    values = np.concatenate(rows, axis=1).astype(np.float64).T
    r = np.corrcoef(values)[np.triu_indices(len(values), 1)]
    p = 2.0 * stats.norm.sf(np.abs(r) * np.sqrt(n))
    limit = sidak(0.01, len(p))
    report(f"largest of {len(r)} correlations", float(np.abs(r).max()), 0.0, p=float(p.min()))
    assert p.min() > limit


def test_runs_of_a_hundred_million_samples_do_not_repeat(device: str) -> None:
    """Sample numbers past 2^24, where a float would count no further, stay distinct and uniform."""
    starts = [2**24, 2**24 + 1, 2**27, 2**31 - 2]
    first = np.concatenate([along("index", device, start=s, n=1) for s in starts])
    assert len(np.unique(first, axis=0)) == len(starts)
    early, late = along("index", device), along("index", device, start=2**24)
    rows = np.concatenate([early, late])
    # Two of 2^21 hashes of 96 bits coincide with a probability of 3e-17.
    assert len(np.unique(rows.view(np.dtype((np.void, 16))))) == len(rows)
    cells = (late[:, :2] * BINS).astype(np.int64) @ np.array([BINS, 1])
    result = chi_square_test(np.bincount(cells, minlength=BINS**2), np.full(BINS**2, N / BINS**2))
    assert result.passed, result.message


def test_no_two_vertices_share_a_block(device: str) -> None:
    depth, kind = (a.ravel() for a in np.meshgrid(np.arange(1, 65537), np.arange(3), indexing="ij"))
    blocks = map_function(vertex_block, depth.astype(np.int32), kind.astype(np.uint32), device=device)
    assert len(np.unique(blocks)) == len(blocks)
    # Blocks 0 and 1 are the camera's.
    assert blocks.min() >= 2
