"""Stop a render, or tiles of its picture, when its noise is below a target.

The noise of a picture is the mean standard error of its pixels over their mean radiance. The variance of a pixel's
samples overestimates it, because a low-discrepancy sampler spreads them evenly. The picture at n samples differs from
that at n / 2 by what the second half changed, and this measures how fast the picture converges: where the standard
error falls as n^−a and both halves have the same distribution, the covariance of both pictures is the variance of the
later one, so that

    E[(I(n) − I(n/2))²] = σ(n)² (4^a − 1).

The rate a follows from the differences at n and n / 2, and it falls as n grows. It is 1/2 for independent samples, and
up to about 3/4 for low-discrepancy ones.

The error of a picture is the sum of the errors of its tiles, and each of them falls as n^−a. The fewest samples in all
for a given error follow from Lagrange's condition that the last sample of each pixel removes as much error anywhere:

    n_i = n (κ ε_i)^(1 / (1 + a)),

where ε_i is the mean error of a pixel of tile i at n samples, and κ is such that the sum of all errors is the target.
With adaptive sampling a tile that should have fewer than √2 n samples stops at n, as n doubles between decisions, and
the other tiles alone decide how long they go on.

All decisions are functions of the film at powers of two of samples, so that they do not depend on passes, threads, or
interruptions.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.rendering.film import Film

FIRST = 8
"""The first number of samples at which noise is estimated; with fewer, whole features of a picture may be missing."""

FIRST_STOP_OF_TILES = 32
"""The first number of samples at which tiles may stop; the rate is known then."""

MOST = 2**20
"""Samples per pixel at which a render ends all the same: noise of 1 % where it would be 1000 % with one sample."""

STEPS = 16
"""Between two powers of two the render can end at any multiple of this fraction of the first."""

SLOWEST = 0.5
"""The rate of independent samples."""

SHARE_OF_RATE = 0.5
"""Share of the measured rate above the slowest that counts: the rate falls while samples are added, and two
differences show the rate of earlier ones."""

_STANDARD_ERROR = math.sqrt(math.pi / 2.0)
"""Standard deviation over mean absolute deviation of normal errors; a few bright pixels would dominate a variance."""

SIDE = 16
"""Pixels along a side of a tile."""

MOST_OF_BUDGET = 0.85
"""Share of the target that the errors of stopped tiles may take, so that the others can reach it."""

Floats = NDArray[np.float64]

_ARRAYS = ("noise_mean", "noise_tiles", "noise_counts", "noise_target")


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
    tiles: Tiles, errors: Floats, stopped: NDArray[np.bool_], rate: float, budget: float, total_budget: float
) -> NDArray[np.bool_]:
    """Return (tiles,) bool, true for tiles that should take no more samples.

    Args:
        tiles: the grid.
        errors: (tiles,) sums over each tile of the errors of its pixels; 0 for stopped tiles.
        stopped: (tiles,) which have stopped before.
        rate: the exponent a of convergence.
        budget: the sum of errors that may remain in the tiles that have not stopped.
        total_budget: the sum of errors that may remain in all tiles.
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
    stop = np.zeros_like(stopped)
    stop[order[np.cumsum(errors[order]) <= budget - (1.0 - MOST_OF_BUDGET) * total_budget]] = True
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


class NoiseEstimate:
    """Estimates the noise of a film while it is rendered, and which of its tiles go on.

    Attributes:
        film: the film.
        tiles: its tiles.
        spp: the last power of two of samples at which the film was observed, 0 for none.
        stopped: (tiles,) bool, true for tiles that take no more samples.
        target: noise for which they have stopped, 0 if none may.
    """

    def __init__(self, film: Film) -> None:
        """Estimate nothing yet."""
        self.film = film
        self.tiles = Tiles(film.width, film.height)
        self._forget()

    def _forget(self) -> None:
        self.spp, self._differences, self.target = 0, 0, 0.0
        self._mean: NDArray[np.float64] | None = None
        self._level = 0.0  # sum of the picture's values
        count = self.tiles.count
        # Sums over each tile of absolute changes by the last doubling, and by the one before; and of the absolute
        # errors of tiles that have stopped.
        self._changes, self._earlier, self._final_errors = np.zeros(count), np.zeros(count), np.zeros(count)
        self.stopped = np.zeros(count, bool)

    def begin(self, target: float) -> None:
        """Render towards a target at which tiles may stop, 0 for none; after another one all tiles go on again."""
        if target != self.target:
            if self.stopped.any():
                self._forget()
            self.target = target

    def observe(self, spp: int) -> None:
        """Note the film's state if the pixels that go on have `spp` samples and this is the next power of two."""
        if spp & (spp - 1) or 2 * spp < FIRST or spp <= self.spp:
            return
        mean = self.film.reading.blended(self.film.means()).reshape(-1, 3)
        if self._mean is not None and spp == 2 * self.spp:
            self._earlier = self._changes
            self._changes = np.where(self.stopped, 0.0, self.tiles.sums(np.abs(mean - self._mean).sum(axis=1)))
            self._differences += 1
        else:
            self._differences = 0
        self._mean, self._level, self.spp = mean, float(mean.sum()), spp
        if self.target > 0.0 and spp >= FIRST_STOP_OF_TILES and self._differences > 0:
            errors = self._changes * self._error_of_change
            total_budget = self.target * self._level
            budget = total_budget - float(self._final_errors.sum())
            stop = tiles_to_stop(self.tiles, errors, self.stopped, self.rate, budget, total_budget)
            self._final_errors[stop] = errors[stop]
            self.stopped |= stop

    @property
    def rate(self) -> float:
        """The exponent of convergence."""
        changed, before = (float(each[~self.stopped].sum()) for each in (self._changes, self._earlier))
        if self._differences < 3 or changed <= 0.0 or before <= 0.0:
            return SLOWEST
        return SLOWEST + SHARE_OF_RATE * min(max(math.log2(before / changed) - SLOWEST, 0.0), SLOWEST)

    @property
    def _error_of_change(self) -> float:
        return _STANDARD_ERROR / math.sqrt(4.0**self.rate - 1.0)

    def noise(self, spp: int) -> float | None:
        """Return the estimated noise at `spp` samples, from the last power of two on; None while it is unknown."""
        if self._differences == 0:
            return None
        if self._level <= 0.0:
            return 0.0
        errors = float(self._changes[~self.stopped].sum()) * self._error_of_change * self._error_ratio(spp)
        return (errors + float(self._final_errors.sum())) / self._level

    def noise_now(self) -> float | None:
        """Return the estimated noise of the film as it is; None while it is unknown."""
        return self.noise(self.samples_of_tiles_that_go_on()[0])

    def _error_ratio(self, spp: int) -> float:
        """Return the error at `spp` samples over that at the last power of two."""
        rate = self.rate
        if spp <= self.spp:
            return 1.0
        if spp >= 2 * self.spp:
            return float((self.spp / spp) ** rate)
        # The first m of the further n samples have the noise of m samples, and are not evenly spread among the first n.
        growth = (spp - self.spp) / self.spp
        return math.sqrt(1.0 + math.pow(growth, 2.0 - 2.0 * rate)) / (1.0 + growth)

    def samples_for(self, target: float) -> int | None:
        """Return the estimated number of samples for a noise of `target`; None while the noise is unknown."""
        now = self.noise(0)
        if now is None:
            return None
        if now <= target or self.stopped.all():
            return self.spp
        step = max(self.spp // STEPS, 1)
        for spp in range(self.spp + step, 2 * self.spp, step):
            if (self.noise(spp) or 0.0) <= target:
                return spp
        fixed = float(self._final_errors.sum()) / self._level
        ratio = (now - fixed) / max(target - fixed, 1e-6 * target)
        return max(2 * self.spp, math.ceil(self.spp * math.pow(min(ratio, 1e6), 1.0 / self.rate)))

    def next_stop(self, spp: int, target: float) -> int:
        """Return the number of samples after `spp` at which to decide again, or at which the render is to end."""
        power = 1 << spp.bit_length()
        estimated = self.samples_for(target)
        return power if estimated is None else min(power, max(estimated, spp))

    def samples_of_tiles_that_go_on(self) -> tuple[int, bool]:
        """Return their least samples per pixel, and whether all their pixels have as many, as without interrupts."""
        stopped = self.stopped_pixels()
        tally = self.film.tally(None if stopped is None or stopped.all() else ~stopped)
        return tally.least, tally.least == tally.most

    @property
    def share_going_on(self) -> float:
        """The share of the picture that takes further samples."""
        return 1.0 - float(self.tiles.pixels[self.stopped].sum()) / self.film.pixels

    def stopped_pixels(self) -> NDArray[np.bool_] | None:
        """Return (pixels,) whether each has stopped; None if none has."""
        return self.stopped[self.tiles.of_pixels] if self.stopped.any() else None

    def state(self) -> dict[str, NDArray[Any]]:
        """Return the arrays to save for resuming, by name."""
        if self._mean is None:
            return {}
        tiles = np.stack([self._changes, self._earlier, self._final_errors, self.stopped], axis=1)
        return {
            "noise_mean": self._mean,
            "noise_tiles": tiles,
            "noise_counts": np.array([self.spp, self._differences], np.int64),
            "noise_target": np.array([self.target]),
        }

    def restore(self, state: dict[str, NDArray[Any]]) -> None:
        """Continue from saved arrays; without any, noise is known again after two powers of two.

        Raises:
            InputError: if no render can have produced them.
        """
        self._forget()
        if not any(name in state for name in _ARRAYS):
            return
        shapes = ((self.film.pixels, 3), (self.tiles.count, 4), (2,), (1,))
        for name, shape in zip(_ARRAYS, shapes, strict=True):
            array = state.get(name)
            if array is None or array.shape != shape or array.dtype != (np.int64 if name == _ARRAYS[2] else np.float64):
                raise InputError(f"its array {name!r} is missing or of another shape")
        mean, tiles, (spp, differences), (target,) = (state[name] for name in _ARRAYS)
        is_power = 2 * spp >= FIRST and not spp & (spp - 1) and spp <= state.get("count", np.array(spp)).max()
        if not (is_power and 0 <= differences < 64 and (tiles >= 0.0).all() and np.isin(tiles[:, 3], (0.0, 1.0)).all()):
            raise InputError("its estimate of noise has impossible values")
        if not (np.isfinite(mean).all() and np.isfinite(tiles).all() and 0.0 <= target <= 1.0):
            raise InputError("its estimate of noise is not finite")
        self.spp, self._differences, self.target = int(spp), int(differences), float(target)
        self._mean, self._level = mean, float(mean.sum())
        self._changes, self._earlier, self._final_errors = (tiles[:, k].copy() for k in range(3))
        self.stopped = tiles[:, 3] > 0.0
