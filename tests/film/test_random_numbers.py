"""Independent random numbers: the published hash, uniform, and independent along every name."""

import itertools

import numpy as np
import pytest
from support.kernels import draw, map_function
from support.statistics import chi_square_test, sidak

from wrt.kernels.sampling.sampler import unit_float, vertex_block

N = 2**20
BINS = 101
AXES = ("seed", "pixel", "index", "block")
PLACES = {"seed": 7, "pixel": 4321, "index": 11, "block": 2}
"""Where the three other names stand while one of them runs."""


def along(axis, device, *, start=0, n=N, **places):
    names = {**PLACES, **places, axis: start + np.arange(n, dtype=np.uint64)}
    return draw(*(names[a] for a in AXES), device)


def pcg4d(seed, pixel, index, block):
    """Return the hash as printed in Jarzynski and Olano, "Hash Functions for GPU Rendering", JCGT 9(3), 2020."""
    v = np.stack([pixel, index, block, seed]).astype(np.uint32) * np.uint32(1664525) + np.uint32(1013904223)

    def mix():
        for a, b, c in ((0, 1, 3), (1, 2, 0), (2, 0, 1), (3, 1, 2)):
            v[a] += v[b] * v[c]

    mix()
    v[:] ^= v >> np.uint32(16)
    mix()
    return v.T


def test_numbers_are_the_published_hash(device):
    names = np.random.default_rng(0).integers(0, 2**32, (4, 100_000), dtype=np.uint64)
    names[:, :2] = np.array([[0, 2**32 - 1]])
    expected = (pcg4d(*names) >> np.uint32(8)).astype(np.float64) / 2.0**24
    np.testing.assert_array_equal(draw(*names, device).astype(np.float64), expected)


def test_all_bits_map_into_the_half_open_interval(device):
    bits = np.array([0, 255, 256, 2**31, 2**32 - 256, 2**32 - 1], np.uint32)
    expected = np.array([0, 0, 2**-24, 0.5, 1 - 2**-24, 1 - 2**-24], np.float32)
    np.testing.assert_array_equal(map_function(unit_float, bits, device=device), expected)


def square_p(a, b):
    cells = (a * BINS).astype(np.int64) * BINS + (b * BINS).astype(np.int64)
    return chi_square_test(np.bincount(cells, minlength=BINS * BINS), np.full(BINS * BINS, len(a) / BINS**2)).p


# Blocks of film and lens, light and BSDF; or consecutive samples, the pixel to the right and below, the next seed.
NEIGHBOURS = [
    ("pixel", "block", (0, 6, 8)),
    ("index", "block", (0, 6, 8)),
    pytest.param("index", "seed", (7, 8), marks=pytest.mark.slow),
    pytest.param("pixel", "index", (11, 12), marks=pytest.mark.slow),
    pytest.param("index", "pixel", (4321, 4322, 4321 + 768), marks=pytest.mark.slow),
]


@pytest.mark.parametrize(("axis", "other", "places"), NEIGHBOURS)
def test_pairs_of_numbers_fill_the_square(axis, other, places, device, report):
    rows = {place: along(axis, device, start=N, **{other: place}) for place in places}
    numbers = {f"{k} of {other} {place}": u[:, k] for place, u in rows.items() for k in range(4)}
    p = {f"{a}, {b}": square_p(numbers[a], numbers[b]) for a, b in itertools.combinations(numbers, 2)}
    worst = min(p, key=p.__getitem__)
    report(f"least uniform of {len(p)} pairs: {worst}", p[worst], p=p[worst])
    assert p[worst] > sidak(0.01, len(p)), worst


def test_no_two_vertices_share_a_block(device):
    depth, kind = (a.ravel() for a in np.meshgrid(np.arange(1, 65537), np.arange(3), indexing="ij"))
    blocks = map_function(vertex_block, depth.astype(np.int32), kind.astype(np.uint32), device=device)
    assert len(np.unique(blocks)) == len(blocks)
    assert blocks.min() >= 2  # 0 and 1 are the camera's
