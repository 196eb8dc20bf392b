"""Samplers that spread a pixel's numbers evenly: uniform, independent where they must be, even as they promise."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from scipy import stats
from scipy.stats import qmc
from support.kernels import draw, map_function
from support.statistics import chi_square_test, sidak, t_test_mean

from wrt.kernels.sampling.low_discrepancy import (
    further_dimension,
    morton_code,
    reverse_bits,
    scramble,
    second_dimension,
)
from wrt.scene.scene import SAMPLERS

EVEN = SAMPLERS[1:]
CAMERA, TIME, LIGHT, BSDF = 0, 1, 6, 8
"""Blocks of the film and the lens, of the time, and of the first vertex."""
ALPHA = 0.01
BINS = 61


def samples(sampler: str, block: int, pixels: NDArray | int, count: int, device: str, seed: int = 5) -> NDArray:
    """Return (pixels, count, 4) float64 numbers of the first samples of some pixels."""
    pixel = np.atleast_1d(pixels)[:, None]
    return draw(seed, pixel, np.arange(count)[None], block, device, sampler=sampler).astype(np.float64)


def is_net(points: NDArray, shapes: list[tuple[int, int]]) -> bool:
    """Return whether each cell of each grid of 2^a x 2^b = n cells has exactly one of (..., n, 2) points."""
    n = points.shape[-2]
    for a, b in shapes:
        cell = np.floor(points[..., 0] * 2**a) * 2**b + np.floor(points[..., 1] * 2**b)
        if (np.sort(cell, axis=-1) != np.arange(n)).any():
            return False
    return True


# --- The points ------------------------------------------------------------------------------------


def test_sobols_dimensions_are_the_published_ones(device: str) -> None:
    """Against SciPy's, which come in the order of the Gray code."""
    n = 2**12
    expected = qmc.Sobol(5, scramble=False, bits=32).random(n)
    index = np.arange(n, dtype=np.uint32)
    index ^= index >> 1
    digits = [index, map_function(second_dimension, index, device=device)]
    digits += [map_function(further_dimension, index, np.full(n, d, np.int32), device=device) for d in (2, 3, 4)]
    for dimension, reversed_digits in enumerate(digits):
        found = map_function(reverse_bits, np.asarray(reversed_digits), device=device) / 2.0**32
        np.testing.assert_array_equal(found, expected[:, dimension], err_msg=f"dimension {dimension}")


def test_scrambling_keeps_digits_apart_that_are_apart(device: str) -> None:
    """Two numbers share as many digits after it as before, so each flip hangs on the digits before it alone."""
    rng = np.random.default_rng(0)
    a, b, seed = rng.integers(0, 2**32, (3, 100_000), dtype=np.uint64).astype(np.uint32)
    b = a ^ (b << rng.integers(0, 32, len(a)).astype(np.uint32))
    difference = map_function(scramble, a, seed, device=device) ^ map_function(scramble, b, seed, device=device)
    before = a ^ b
    np.testing.assert_array_equal(difference & (~difference + 1), before & (~before + 1))


def test_morton_codes_interleave(device: str) -> None:
    x, y = np.random.default_rng(1).integers(0, 2**16, (2, 1000)).astype(np.uint32)
    expected = [
        int("".join(b + a for a, b in zip(f"{i:016b}", f"{j:016b}", strict=True)), 2) for i, j in zip(x, y, strict=True)
    ]
    np.testing.assert_array_equal(map_function(morton_code, x, y, device=device), expected)


@pytest.mark.parametrize("block", [LIGHT, BSDF])
def test_sobol_pairs_have_one_point_in_every_elementary_interval(block: int, device: str) -> None:
    """Of a prefix of 2^m, and of every later run of as many that starts at a multiple of it."""
    u = samples("sobol", block, np.arange(40), 2**10, device)
    for m in range(1, 11):
        shapes = [(a, m - a) for a in range(m + 1)]
        runs = u.reshape(40, -1, 2**m, 4)[:, :8]
        assert is_net(runs[..., :2], shapes), m
        assert is_net(runs[..., 2:], shapes), m
    # Seven of eight points and a stray one are no net.
    assert not is_net(u[:, 1:9, :2], [(a, 3 - a) for a in range(4)])


def test_what_the_camera_draws_is_even_in_each_dimension_and_on_the_film(device: str) -> None:
    u = samples("sobol", CAMERA, np.arange(40), 2**8, device)
    time = samples("sobol", TIME, np.arange(40), 2**8, device)[..., 0]
    for m in range(1, 9):
        assert is_net(u[:, : 2**m, :2], [(a, m - a) for a in range(m + 1)])
        for values in (*np.moveaxis(u, -1, 0), time):
            np.testing.assert_array_equal(
                np.sort(np.floor(values[:, : 2**m] * 2**m)), np.arange(2**m)[None].repeat(40, 0)
            )


@pytest.mark.parametrize("block", [CAMERA, LIGHT])
def test_stratified_pairs_have_one_point_in_every_cell(block: int, device: str) -> None:
    u = samples("stratified", block, np.arange(40), 4**5, device)
    for k in range(1, 6):
        runs = u.reshape(40, -1, 4**k, 4)[:, :8]
        assert is_net(runs[..., :2], [(k, k)])
        assert is_net(runs[..., 2:], [(k, k)])
    within = np.modf(u[:, : 4**3] * 2**3)[0]
    counts = np.bincount((within.ravel() * BINS).astype(int), minlength=BINS)
    assert chi_square_test(counts, np.full(BINS, within.size / BINS)).passed, "not uniform within the cells"


# --- Uniform and independent -----------------------------------------------------------------------


@pytest.mark.parametrize("sampler", EVEN)
@pytest.mark.parametrize("axis", ["pixel", "seed"])
def test_numbers_and_pairs_are_uniform_over_pixels_and_seeds(
    sampler: str, axis: str, device: str, report: Report
) -> None:
    """For samples early and late; of the camera, where no index is shuffled, and of a vertex."""
    n = 2**18
    p = {}
    for block, index in itertools.product((CAMERA, LIGHT), (0, 5, 1_000_003)):
        names = {"seed": 3, "pixel": 77, axis: np.arange(n)}
        u = draw(names["seed"], names["pixel"], index, block, device, sampler=sampler)
        for i in range(4):
            counts = np.bincount((u[:, i] * 1021).astype(int), minlength=1021)
            p[block, index, i] = chi_square_test(counts, np.full(1021, n / 1021)).p
        for i, j in itertools.combinations(range(4), 2):
            p[block, index, i, j] = square_p(u[:, i], u[:, j])
    worst = min(p, key=p.__getitem__)
    report(f"{sampler}, along {axis}: least uniform of {len(p)}: {worst}", p[worst], p=p[worst])
    assert p[worst] > sidak(ALPHA, len(p) * len(EVEN) * 2)


def square_p(a: NDArray, b: NDArray) -> float:
    cells = (a * BINS).astype(np.int64) * BINS + (b * BINS).astype(np.int64)
    return chi_square_test(np.bincount(cells.ravel(), minlength=BINS**2), np.full(BINS**2, a.size / BINS**2)).p


def together_p(rows: list[NDArray]) -> dict[tuple[int, int], float]:
    return {(i, j): square_p(rows[i], rows[j]) for i, j in itertools.combinations(range(len(rows)), 2)}


@pytest.mark.parametrize("sampler", EVEN)
def test_numbers_of_several_blocks_fill_the_square_together(sampler: str, device: str, report: Report) -> None:
    """Over the samples of one pixel: numbers that are even by themselves must not move in step."""
    blocks = [samples(sampler, block, 4321, 2**18, device)[0] for block in (CAMERA, LIGHT, BSDF, 10)]
    rows = [u[:, i] for u in blocks for i in range(4)]
    p = together_p(rows)
    worst = min(p, key=p.__getitem__)
    report(f"{sampler}: least uniform of {len(p)} pairs: {worst}", p[worst], p=p[worst])
    assert p[worst] > sidak(ALPHA, len(p) * len(EVEN))


def test_numbers_in_step_are_found(device: str) -> None:
    """The radical inverse scrambled twice, its indices not shuffled."""
    index = np.arange(2**18, dtype=np.uint32)
    rows = [
        map_function(
            reverse_bits, map_function(scramble, index, np.full_like(index, seed), device=device), device=device
        )
        / 2.0**32
        for seed in (123456789, 2345678901)
    ]
    assert together_p(rows)[0, 1] < 1e-6


@pytest.mark.parametrize("sampler", ["stratified", "sobol"])
def test_errors_of_pixels_blocks_and_seeds_are_independent(sampler: str, device: str, report: Report) -> None:
    n = 2**14
    pixel = np.arange(n)

    def error(pixels: NDArray, block: int, seed: int) -> NDArray:
        return inside_disk(samples(sampler, block, pixels, 16, device, seed)).mean(axis=1) - np.pi / 4.0

    here = error(pixel, LIGHT, 5)
    others = {
        "next pixel": error(pixel + 1, LIGHT, 5),
        "pixel below": error(pixel + 768, LIGHT, 5),
        "next seed": error(pixel, LIGHT, 6),
        "other block": error(pixel, BSDF, 5),
        "next vertex": error(pixel, LIGHT + 4, 5),
    }
    for name, there in others.items():
        r, p = stats.pearsonr(here, there)
        report(f"{sampler}: correlation with the {name}", float(r), 0.0, p=float(p))
        assert p > sidak(ALPHA, 2 * len(others))


def inside_disk(u: NDArray) -> NDArray:
    return (u[..., 0] ** 2 + u[..., 1] ** 2 < 1.0).astype(np.float64)


@pytest.mark.parametrize("sampler", EVEN)
@pytest.mark.parametrize("count", [1, 3, 7, 12, 100])
def test_any_number_of_samples_is_unbiased(sampler: str, count: int, device: str, report: Report) -> None:
    """A step in two numbers that are a pair, and one in two that are none; over seeds."""
    seeds = np.arange(2**13)[:, None]
    u = draw(seeds, 5, np.arange(count)[None], LIGHT, device, sampler=sampler).astype(np.float64)
    for name, values, exact in (
        ("disk", inside_disk(u), np.pi / 4.0),
        ("half", (u[..., 1] + u[..., 2] < 1.0).astype(np.float64), 0.5),
    ):
        means = values.mean(axis=1)
        p = float(t_test_mean(means.mean(), means.var(ddof=1) / len(means), len(means), exact))
        report(f"{sampler}, {count} samples: {name}", float(means.mean()), exact, p=p)
        assert p > sidak(ALPHA, 2 * 5 * len(EVEN))


# --- What it is good for ---------------------------------------------------------------------------


def slope(sampler: str, function: Callable[[NDArray], NDArray], device: str) -> float:
    """Return the power of N by which the variance over seeds falls."""
    counts = 4 ** np.arange(2, 6)
    seeds = np.arange(800)[:, None]
    u = draw(seeds, 5, np.arange(counts[-1])[None], LIGHT, device, sampler=sampler).astype(np.float64)
    variance = [function(u[:, :n]).mean(axis=1).var() for n in counts]
    return float(np.polyfit(np.log(counts), np.log(variance), 1)[0])


SLOPES = {
    ("independent", "smooth"): (-1.1, -0.9),
    ("independent", "disk"): (-1.1, -0.9),
    ("stratified", "smooth"): (-2.2, -1.8),
    ("stratified", "disk"): (-1.7, -1.4),
    ("sobol", "smooth"): (-3.2, -2.5),
    ("sobol", "disk"): (-1.8, -1.4),
    ("blue-noise", "smooth"): (-2.2, -1.9),
    ("blue-noise", "disk"): (-1.8, -1.4),
}
"""Powers of N. 1/N for independent samples; N^-2 and N^-1.5 for jittered grids on smooth functions and on steps
(Mitchell 1996); N^-3, but for a logarithm, for scrambled nets on smooth functions (Owen 1997), and N^-1.5 on steps.
The pixels of blue noise shift one net instead of scrambling it, which breaks its balance at the border: N^-2."""


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_the_variance_falls_as_fast_as_it_should(sampler: str, device: str, report: Report) -> None:
    def smooth(u: NDArray) -> NDArray:
        return np.exp(-3.0 * ((u[..., 0] - 0.4) ** 2 + (u[..., 1] - 0.6) ** 2))

    for name, function in (("smooth", smooth), ("disk", inside_disk)):
        found = slope(sampler, function, device)
        low, high = SLOPES[sampler, name]
        report(f"{sampler}: variance on {name} falls as N to the", found, f"{low} to {high}")
        assert low < found < high


def test_film_and_lens_are_even_together(device: str, report: Report) -> None:
    """An edge out of focus is a step across both: the camera's four numbers are one point, and not two pairs."""

    def variance(block: int, normal: tuple[float, ...]) -> float:
        u = samples("sobol", block, np.arange(2000), 256, device)
        return float((u @ normal < 0.55 * sum(normal)).mean(axis=1).var())

    for name, normal, limit in (
        ("upright", (1.0, 0.0, 0.8, 0.0), 0.5),
        ("level", (0.0, 1.0, 0.0, 0.8), 0.5),
        ("slanting", (1.0, 0.6, 0.8, 0.5), 1.0),
    ):
        ratio = variance(CAMERA, normal) / variance(LIGHT, normal)
        report(f"variance of {name} edges, one point over two pairs", ratio, f"< {limit}")
        assert ratio < limit


def low_frequencies(sampler: str, count: int, device: str) -> float:
    """Return the power of the error at frequencies below 0.08 a pixel, over that of all; 1 for white noise."""
    side = 64
    x, y = np.meshgrid(np.arange(side, dtype=np.uint32), np.arange(side, dtype=np.uint32))
    pixel = y * side + x
    if sampler == "blue-noise":
        pixel = map_function(morton_code, x.ravel(), y.ravel(), device=device)
    f = np.hypot(*np.meshgrid(np.fft.fftfreq(side), np.fft.fftfreq(side)))
    low, every = 0.0, 0.0
    for seed in range(8):
        u = samples(sampler, LIGHT, np.ravel(pixel), count, device, seed)
        error = inside_disk(u).mean(axis=1).reshape(side, side) - np.pi / 4.0
        power = np.abs(np.fft.fft2(error)) ** 2
        low += power[(f > 0.0) & (f < 0.08)].mean()
        every += power[f > 0.0].mean()
    return low / every


def test_errors_of_blue_noise_have_few_low_frequencies(device: str, report: Report) -> None:
    for sampler, count, limit in (
        ("independent", 1, 1.15),
        ("sobol", 1, 1.15),
        ("blue-noise", 1, 0.5),
        ("blue-noise", 4, 0.7),
    ):
        found = low_frequencies(sampler, count, device)
        report(f"{sampler}, {count} samples: power at low frequencies", found, f"< {limit}")
        assert found < limit
        assert sampler == "blue-noise" or found > 0.85
