"""Mip pyramids."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float32]


def pyramid(pixels: FloatArray) -> list[FloatArray]:
    """Return (H, W, 3) linear pixels at 1/2, 1/4, ... of their size, down to one texel, with the same mean."""
    levels = []
    while pixels.shape[:2] != (1, 1):
        pixels = halved(pixels)
        levels.append(pixels)
    return levels


def halved(pixels: FloatArray) -> FloatArray:
    """Return the image at half the width and height, rounded up, with the same mean."""
    for axis in (0, 1):
        pixels = _resized(pixels, axis, (pixels.shape[axis] + 1) // 2)
    return pixels


def _resized(pixels: FloatArray, axis: int, size: int) -> FloatArray:
    """Return the means over `size` equal pieces of an axis, which may cut texels."""
    old = pixels.shape[axis]
    if old == 2 * size:
        even, odd = (np.take(pixels, range(start, old, 2), axis) for start in (0, 1))
        return np.float32(0.5) * (even + odd)
    # Take differences of the cumulative integral.
    first = np.moveaxis(pixels.astype(np.float64), axis, 0)
    integral = np.concatenate([np.zeros_like(first[:1]), np.cumsum(first, axis=0)])
    edges = np.arange(size + 1) * (old / size)
    whole = np.minimum(edges.astype(int), old - 1)
    at_edges = integral[whole] + (edges - whole)[:, None, None] * first[whole]
    result: FloatArray = np.moveaxis(np.diff(at_edges, axis=0) * (size / old), 0, axis).astype(np.float32)
    return result
