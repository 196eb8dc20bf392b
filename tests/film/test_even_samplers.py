"""Samplers: uniform, independent across pixels, blocks and seeds, and stratified as documented."""

import itertools

import numpy as np
import pytest
from scipy import stats
from scipy.stats import qmc
from support.kernels import draw, map_function
from support.statistics import chi_square_test, sidak

from wrt.kernels.sampling import low_discrepancy as ld
from wrt.scene.scene import SAMPLERS

CAMERA, TIME, LIGHT, BSDF = 0, 1, 6, 8
"""Blocks of the film and the lens, of the time, and of the first vertex."""
ALPHA = 0.01
BINS = 61


def samples(sampler, block, pixels, count, device, seed=5):
    """Return (pixels, count, 4) float64 numbers of the first samples of some pixels."""
    pixel = np.atleast_1d(pixels)[:, None]
    return draw(seed, pixel, np.arange(count)[None], block, device, sampler=sampler).astype(np.float64)


def is_net(points, shapes):
    """Return whether each cell of each grid of 2^a x 2^b = n cells has exactly one of (..., n, 2) points."""
    cells = (np.floor(points[..., 0] * 2**a) * 2**b + np.floor(points[..., 1] * 2**b) for a, b in shapes)
    return all((np.sort(cell, axis=-1) == np.arange(points.shape[-2])).all() for cell in cells)


def elementary(m):
    return [(a, m - a) for a in range(m + 1)]


def test_sobols_dimensions_are_the_published_ones(device):
    """Against SciPy's, which are in Gray-code order."""
    n = 2**12
    expected = qmc.Sobol(5, scramble=False, bits=32).random(n)
    index = np.arange(n, dtype=np.uint32)
    index ^= index >> 1
    digits = [index, map_function(ld.second_dimension, index, device=device)]
    digits += [map_function(ld.further_dimension, index, np.full(n, d, np.int32), device=device) for d in (2, 3, 4)]
    for dimension, reversed_digits in enumerate(digits):
        found = map_function(ld.reverse_bits, np.asarray(reversed_digits), device=device) / 2.0**32
        np.testing.assert_array_equal(found, expected[:, dimension], err_msg=f"dimension {dimension}")


@pytest.mark.parametrize("block", [LIGHT, BSDF])
def test_sobol_pairs_have_one_point_in_every_elementary_interval(block, device):
    """For the first 2^m points, and for each later run of 2^m that starts at a multiple of 2^m."""
    u = samples("sobol", block, np.arange(40), 2**10, device)
    for m in range(1, 11):
        runs = u.reshape(40, -1, 2**m, 4)[:, :8]
        assert is_net(runs[..., :2], elementary(m)), m
        assert is_net(runs[..., 2:], elementary(m)), m
    assert not is_net(u[:, 1:9, :2], elementary(3))  # seven of eight points and a stray one are no net


def test_what_the_camera_draws_is_even_in_each_dimension_and_on_the_film(device):
    u = samples("sobol", CAMERA, np.arange(40), 2**8, device)
    u = np.concatenate([u, samples("sobol", TIME, np.arange(40), 2**8, device)[..., :1]], axis=2)
    for m in range(1, 9):
        assert is_net(u[:, : 2**m, :2], elementary(m))
        strata = np.sort(np.floor(u[:, : 2**m] * 2**m), axis=1)
        np.testing.assert_array_equal(strata, np.broadcast_to(np.arange(2**m)[:, None], strata.shape))


@pytest.mark.parametrize("block", [CAMERA, LIGHT])
def test_stratified_pairs_have_one_point_in_every_cell(block, device):
    u = samples("stratified", block, np.arange(40), 4**5, device)
    for k in range(1, 6):
        runs = u.reshape(40, -1, 4**k, 4)[:, :8]
        assert is_net(runs[..., :2], [(k, k)])
        assert is_net(runs[..., 2:], [(k, k)])
    offsets = np.modf(u[:, : 4**3] * 2**3)[0]
    counts = np.bincount((offsets.ravel() * BINS).astype(int), minlength=BINS)
    assert chi_square_test(counts, np.full(BINS, offsets.size / BINS)).passed, "not uniform within the cells"


def square_p(a, b):
    cells = (a * BINS).astype(np.int64) * BINS + (b * BINS).astype(np.int64)
    return chi_square_test(np.bincount(cells.ravel(), minlength=BINS**2), np.full(BINS**2, a.size / BINS**2)).p


@pytest.mark.parametrize("sampler", SAMPLERS)
@pytest.mark.parametrize("axis", ["pixel", pytest.param("seed", marks=pytest.mark.slow)])
def test_numbers_and_pairs_are_uniform_over_pixels_and_seeds(sampler, axis, device, report):
    """For early and late samples, of the camera, whose index is not shuffled, and of a vertex."""
    n, p = 2**18, {}
    for block, index in itertools.product((CAMERA, LIGHT), (0, 5, 1_000_003)):
        names = {"seed": 3, "pixel": 77, axis: np.arange(n)}
        u = draw(names["seed"], names["pixel"], index, block, device, sampler=sampler)
        for i in range(4):
            p[block, index, i] = chi_square_test(np.bincount((u[:, i] * 1021).astype(int)), np.full(1021, n / 1021)).p
        for i, j in itertools.combinations(range(4), 2):
            p[block, index, i, j] = square_p(u[:, i], u[:, j])
    least = min(p, key=p.__getitem__)
    report(f"{sampler}, along {axis}: least uniform of {len(p)}: {least}", p[least], p=p[least])
    assert p[least] > sidak(ALPHA, len(p) * len(SAMPLERS) * 2)


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_numbers_of_several_blocks_fill_the_square_together(sampler, device, report):
    """Over the samples of one pixel: dimensions that are stratified by themselves must not be correlated."""
    blocks = [samples(sampler, block, 4321, 2**18, device)[0] for block in (CAMERA, LIGHT, BSDF, 10)]
    rows = [u[:, i] for u in blocks for i in range(4)]
    p = {(i, j): square_p(rows[i], rows[j]) for i, j in itertools.combinations(range(len(rows)), 2)}
    least = min(p, key=p.__getitem__)
    report(f"{sampler}: least uniform of {len(p)} pairs: {least}", p[least], p=p[least])
    assert p[least] > sidak(ALPHA, len(p) * len(SAMPLERS))


def inside_disk(u):
    return (u[..., 0] ** 2 + u[..., 1] ** 2 < 1.0).astype(np.float64)


@pytest.mark.parametrize("sampler", ["independent", "stratified", "sobol"])
def test_errors_of_pixels_blocks_and_seeds_are_independent(sampler, device, report):
    pixel = np.arange(2**14)

    def error(pixels, block, seed):
        return inside_disk(samples(sampler, block, pixels, 16, device, seed)).mean(axis=1) - np.pi / 4.0

    partners = {
        "next pixel": (pixel + 1, LIGHT, 5),
        "pixel below": (pixel + 768, LIGHT, 5),
        "next seed": (pixel, LIGHT, 6),
        "other block": (pixel, BSDF, 5),
        "next vertex": (pixel, LIGHT + 4, 5),
    }
    errors = error(pixel, LIGHT, 5)
    for name, partner in partners.items():
        r, p = stats.pearsonr(errors, error(*partner))
        report(f"{sampler}: correlation with the {name}", float(r), 0.0, p=float(p))
        assert p > sidak(ALPHA, 3 * len(partners))


SLOPES = {
    "independent": ((-1.1, -0.9), (-1.1, -0.9)),
    "stratified": ((-2.2, -1.8), (-1.7, -1.4)),
    "sobol": ((-3.2, -2.5), (-1.8, -1.4)),
    "blue-noise": ((-2.2, -1.9), (-1.8, -1.4)),
}
"""Powers of N by which the variance of a smooth function and of a step falls. 1/N for independent samples; N^-2 and
N^-1.5 for jittered grids (Mitchell 1996); N^-3, up to a logarithm, for scrambled nets on smooth functions (Owen 1997),
and N^-1.5 on steps. The pixels of blue noise shift one net instead of scrambling it, which breaks its balance at
the border: N^-2."""


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_the_variance_over_seeds_falls_as_fast_as_it_should(sampler, device, report):
    counts = 4 ** np.arange(2, 6)
    seeds = np.arange(800)[:, None]
    u = draw(seeds, 5, np.arange(counts[-1])[None], LIGHT, device, sampler=sampler).astype(np.float64)
    smooth = np.exp(-3.0 * ((u[..., 0] - 0.4) ** 2 + (u[..., 1] - 0.6) ** 2))
    for name, values, (low, high) in zip(("smooth", "disk"), (smooth, inside_disk(u)), SLOPES[sampler], strict=True):
        variance = [values[:, :n].mean(axis=1).var() for n in counts]
        found = float(np.polyfit(np.log(counts), np.log(variance), 1)[0])
        report(f"{sampler}: variance on {name} falls as N to the", found, f"{low} to {high}")
        assert low < found < high


def test_film_and_lens_are_even_together(device, report):
    """An edge out of focus is a step in film and lens: the camera's four numbers are one 4D point, not two pairs."""
    for normal, limit in (((1.0, 0.0, 0.8, 0.0), 0.5), ((0.0, 1.0, 0.0, 0.8), 0.5), ((1.0, 0.6, 0.8, 0.5), 1.0)):
        one, two = (
            (samples("sobol", block, np.arange(2000), 256, device) @ normal < 0.55 * sum(normal)).mean(axis=1).var()
            for block in (CAMERA, LIGHT)
        )
        report(f"variance of edges along {normal}, one point over two pairs", float(one / two), f"< {limit}")
        assert one < limit * two


@pytest.mark.parametrize(
    ("sampler", "count", "least", "most"),
    [("sobol", 1, 0.85, 1.15), ("blue-noise", 1, 0.0, 0.5), ("blue-noise", 4, 0.0, 0.7)],
)
def test_errors_of_blue_noise_have_few_low_frequencies(sampler, count, least, most, device, report):
    """The mean power of the error at frequencies below 0.08 a pixel, over the mean of all; 1 for white noise."""
    side = 64
    x, y = (a.ravel().astype(np.uint32) for a in np.meshgrid(np.arange(side), np.arange(side)))
    pixel = map_function(ld.morton_code, x, y, device=device) if sampler == "blue-noise" else y * side + x
    f = np.hypot(*np.meshgrid(np.fft.fftfreq(side), np.fft.fftfreq(side)))
    errors = [inside_disk(samples(sampler, LIGHT, pixel, count, device, seed)).mean(axis=1) for seed in range(8)]
    power = sum(np.abs(np.fft.fft2(error.reshape(side, side) - np.pi / 4.0)) ** 2 for error in errors)
    found = power[(f > 0.0) & (f < 0.08)].mean() / power[f > 0.0].mean()
    report(f"{sampler}, {count} samples: power at low frequencies", found, f"{least} to {most}")
    assert least < found < most
