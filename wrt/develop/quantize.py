"""Dithering to 8 bits."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.backend.slices import Threads, available_threads

ROWS_AT_ONCE = 16  # rows that are converted in one step: few enough to stay in a core's cache


def quantize(
    size: tuple[int, ...], encoded: Callable[[slice], NDArray[Any]], white: float
) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """Quantize a picture to 8-bit codes.

    Dithering avoids bands in dark gradients: the code is floor(255 v + u), where u in (0, 1) is a fixed hash of
    column, row and channel. A value that equals a code, such as 0 or 1, is not dithered.

    Args:
        size: height and width.
        encoded: returns (rows, W, 3) float64 values of some rows, encoded for a display, 0 to 1.
        white: smallest value that counts as white.

    Returns:
        (H, W, 3) codes, and (H, W) whether a channel of a pixel is white.
    """
    height, width = size
    codes = np.empty((height, width, 3), np.uint8)
    whites = np.empty((height, width), np.bool_)
    x = np.arange(width, dtype=np.uint32)[:, None]
    c = np.arange(3, dtype=np.uint32)
    columns = _hash(x ^ _hash(c + np.uint32(0x9E3779B9)))

    def fill(rows: slice) -> None:
        values = encoded(rows)
        noise = _hash(columns + _hash(np.arange(height, dtype=np.uint32)[rows, None, None]))
        # 256 levels from 1/512 to 511/512, so that rounding errors cannot change a value that equals a code.
        u = ((noise >> np.uint32(24)).astype(np.float64) + 0.5) / 256.0
        codes[rows] = np.floor(255.0 * values + u).clip(0.0, 255.0).astype(np.uint8)
        whites[rows] = (values >= white).any(axis=2)

    # A few rows at a time: a whole picture in float64 would take several times its memory.
    pool = Threads(available_threads(), "wrt-dither")
    try:
        for each in [pool.submit(fill, slice(y, y + ROWS_AT_ONCE)) for y in range(0, height, ROWS_AT_ONCE)]:
            each.result()
    finally:
        pool.end()
    return codes, whites


def _hash(x: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Mix 32 bits (Wellons 2018, the "lowbias32" function)."""
    x = x ^ (x >> np.uint32(16))
    with np.errstate(over="ignore"):
        x = x * np.uint32(0x7FEB352D)
        x = x ^ (x >> np.uint32(15))
        x = x * np.uint32(0x846CA68B)
    return x ^ (x >> np.uint32(16))
