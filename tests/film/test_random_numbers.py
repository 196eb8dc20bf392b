"""Independent random numbers are the published hash; `test_even_samplers.py` shows that they are uniform."""

import numpy as np
from support.kernels import draw, map_function

from wrt.kernels.sampling.sampler import unit_float, vertex_block


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


def test_no_two_vertices_share_a_block(device):
    depth, kind = (a.ravel() for a in np.meshgrid(np.arange(1, 65537), np.arange(3), indexing="ij"))
    blocks = map_function(vertex_block, depth.astype(np.int32), kind.astype(np.uint32), device=device)
    assert len(np.unique(blocks)) == len(blocks)
    assert blocks.min() >= 2  # 0 and 1 are the camera's
