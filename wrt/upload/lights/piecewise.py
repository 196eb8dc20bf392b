"""Cumulative sums for sampling cells of grids, and integrals of images over such cells."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

UNITS = 2**15
"""The value of a complete cumulative sum."""


def part_edges(weights: NDArray[np.floating]) -> NDArray[np.uint16]:
    """Return the start of each part of [0, 1), in units, for non-negative weights along the last axis.

    Parts of weight zero have no length, all others at least one unit; if all weights are zero, the parts are equal.
    """
    total = weights.sum(axis=-1, keepdims=True, dtype=np.float64)
    lifted = np.where(weights > 0.0, np.maximum(weights, total / (0.4 * UNITS)), 0.0)
    sums = np.cumsum(np.where(total > 0.0, lifted, 1.0), axis=-1)
    edges = np.zeros(weights.shape, np.uint16)
    edges[..., 1:] = np.rint(sums[..., :-1] / sums[..., -1:] * UNITS)
    return edges


def tiles(weights: NDArray[np.floating]) -> NDArray[np.uint16]:
    """Return (N, R + R C) tiles of N grids of weights (N, R, C)."""
    by_row = part_edges(weights.sum(axis=2, dtype=np.float64))
    return np.concatenate([by_row, part_edges(weights).reshape(len(weights), -1)], axis=1)


def integrals(
    values: NDArray[np.floating], parts: int, axis: int, beyond: Literal["edge", "wrap"]
) -> NDArray[np.float64]:
    """Integrate a linear interpolation between texel centres over equal parts of an axis.

    Args:
        values: values of the texels, which have length 1.
        parts: number of parts.
        axis: axis of `values`.
        beyond: whether the texels beyond an end repeat it or wrap around.
    """
    around = [(1, 1) if k == axis else (0, 0) for k in range(values.ndim)]
    samples = np.moveaxis(np.pad(values, around, mode=beyond), axis, -1)
    count = samples.shape[-1] - 2
    # Sample j is at j - 1/2; the integral up to there is a sum of trapezoids.
    up_to = np.zeros(samples.shape)
    np.cumsum(0.5 * (samples[..., :-1] + samples[..., 1:]), axis=-1, dtype=np.float64, out=up_to[..., 1:])
    place = np.arange(parts + 1) * (count / parts) + 0.5
    j = place.astype(int)
    t = place - j
    start, end = samples[..., j], samples[..., j + 1]
    at_edges = up_to[..., j] + t * start + 0.5 * t * t * (end - start)
    return np.moveaxis(np.maximum(np.diff(at_edges, axis=-1), 0.0), -1, axis)


def pooled(values: NDArray[np.float64], rows: int, columns: int) -> NDArray[np.float64]:
    """Return the sums over blocks of a grid, in the given number of rows and columns."""
    height, width = values.shape
    blocks = values.reshape(rows, height // rows, columns, width // columns)
    return np.asarray(blocks.sum(axis=(1, 3)))
