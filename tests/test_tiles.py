"""Threads of a GPU take the pixels of a film tile by tile."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from wrt.kernels.film.tiles import TILE_HEIGHT, TILE_WIDTH, pixel_of_thread

WARP = 32


@wp.kernel(enable_backward=False, module="test_tiles")
def pixels(width: int, height: int, pixels_out: wp.array(dtype=int)):
    thread = wp.tid()
    pixels_out[thread] = pixel_of_thread(thread, width, height)


def taken(width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the column and the row of each thread's pixel."""
    found = wp.empty(width * height, dtype=int, device="cpu")
    wp.launch(pixels, dim=width * height, inputs=[width, height, found], device="cpu")
    return found.numpy() % width, found.numpy() // width


@pytest.mark.parametrize(
    "size", [(1, 1), (7, 3), (8, 4), (9, 5), (45, 31), (1, 100), (100, 1), (640, 360), (1919, 1079)], ids=str
)
def test_each_pixel_is_taken_once(size: tuple[int, int]) -> None:
    width, height = size
    x, y = taken(width, height)
    assert (np.bincount(y * width + x, minlength=width * height) == 1).all()


def test_a_warp_takes_a_tile() -> None:
    x, y = (each.reshape(-1, WARP) for each in taken(64, 36))
    assert int(TILE_WIDTH) * int(TILE_HEIGHT) == WARP
    assert (np.ptp(x, axis=1) == TILE_WIDTH - 1).all()
    assert (np.ptp(y, axis=1) == TILE_HEIGHT - 1).all()
    # One after the other along a row of tiles.
    assert (x[:8, 0].tolist(), y[8, 0]) == ([8 * i for i in range(8)], TILE_HEIGHT)
