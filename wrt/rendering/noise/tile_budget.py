"""Adaptive sampling: which tiles of a picture have had enough samples.

The error of a picture is the sum of its tiles' errors, and that of a tile falls as n^−a. The fewest samples in all for
a given error follow from Lagrange's condition that the last sample of each pixel removes as much error anywhere:

    n_i = n (κ ε_i)^(1 / (1 + a)),

where ε_i is the mean error of a pixel of tile i at n samples, and κ is such that the sum of all errors is the target.
A tile that should have fewer than √2 n samples stops at n, as n doubles between decisions.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

SIDE = 16
"""Pixels along a side of a tile."""

MOST_OF_BUDGET = 0.85
"""Share of the target that the errors of stopped tiles may take, so that the others can reach it."""

Floats = NDArray[np.float64]


class Tiles:
    """A fixed grid of square tiles over a picture.

    Attributes:
        columns, rows: of the grid; the tiles of the last ones may be smaller.
        count: number of tiles.
        of_pixels: (pixels,) number of each pixel's tile.
        pixels: (tiles,) number of pixels of each tile.
    """

    def __init__(self, width: int, height: int) -> None:
        """Lay tiles over a picture of width x height pixels."""
        self.columns, self.rows = -(-width // SIDE), -(-height // SIDE)
        self.count = self.columns * self.rows
        rows, columns = np.arange(height) // SIDE, np.arange(width) // SIDE
        self.of_pixels = (rows[:, None] * self.columns + columns[None]).astype(np.int32).reshape(-1)
        self.pixels = np.bincount(self.of_pixels, minlength=self.count)

    def sums(self, values: Floats) -> Floats:
        """Return the sum of (pixels,) values over each tile."""
        sums: Floats = np.bincount(self.of_pixels, weights=values, minlength=self.count).astype(np.float64)
        return sums

    def around(self, values: Floats) -> Floats:
        """Return (tiles,) values averaged over each tile and its up to eight neighbours."""
        padded = np.pad(values.reshape(self.rows, self.columns), 1, mode="edge")
        windows = np.lib.stride_tricks.sliding_window_view(padded, (3, 3))
        mean: Floats = windows.mean(axis=(2, 3)).reshape(-1)
        return mean


def tiles_to_stop(
    tiles: Tiles, errors: Floats, stopped: NDArray[np.bool_], rate: float, budget: float, whole: float
) -> NDArray[np.bool_]:
    """Return (tiles,) bool: those that should take no more samples.

    Args:
        tiles: the grid.
        errors: (tiles,) sums over each tile of the errors of its pixels; 0 for stopped ones.
        stopped: (tiles,) those that have stopped before.
        rate: the exponent a of convergence.
        budget: the sum of all errors that are to be left in the tiles that have not stopped.
        whole: the same with that of the stopped ones.
    """
    going = ~stopped
    per_pixel: Floats = np.where(going, errors / tiles.pixels, 0.0)
    # A tile that looks better than its neighbours may just not have seen what they have.
    per_pixel = np.where(going, np.maximum(per_pixel, tiles.around(per_pixel)), 0.0)
    expected: Floats = per_pixel * tiles.pixels
    if budget <= 0.0 or expected.sum() <= budget:
        return np.zeros_like(stopped)  # the render ends before it doubles its samples
    factor = _more_samples(per_pixel, expected, rate, budget)
    order = np.argsort(factor, kind="stable")
    order = order[going[order] & (factor[order] < math.sqrt(2.0))]
    left = np.cumsum(errors[order])
    stop = np.zeros_like(stopped)
    stop[order[left <= budget - (1.0 - MOST_OF_BUDGET) * whole]] = True
    return stop


def _more_samples(per_pixel: Floats, errors: Floats, rate: float, budget: float) -> Floats:
    """Return n_i / n for each tile, at least 1, so that the errors sum to the budget."""
    scale = float(per_pixel.max())
    relative = per_pixel / scale

    def factors(log_kappa: float) -> Floats:
        return np.maximum((math.exp(log_kappa) * relative) ** (1.0 / (1.0 + rate)), 1.0)

    low, high = 0.0, 200.0
    for _ in range(100):
        middle = 0.5 * (low + high)
        if float((errors * factors(middle) ** -rate).sum()) > budget:
            low = middle
        else:
            high = middle
    return factors(high)
