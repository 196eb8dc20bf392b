"""The host's side of the film: what has been seen so far, per pixel."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.device import Device
from wrt.errors import InputError
from wrt.film_layers import FilmLayers, bytes_per_pixel

STATE_ARRAYS = ("total", "total_of_squares", "count", "rejected")
"""The arrays that make up a film's state; the rays traced only report on this run."""


BYTES_PER_PIXEL = 64
"""Memory of a film: two sums of three doubles, two counts and a tally."""

COPIED_PER_PIXEL = 56
"""Memory of temporary copies: a checkpoint copies all but the tally; an 8-bit picture takes less."""

NOISE_PIXELS = 1 << 14
"""At least, in a slice of the launch that finds their noise: several times the work of starting one."""


class Film:
    """Sums of samples and of their squares, and their number, for each pixel of a picture."""

    def __init__(self, width: int, height: int, device: Device, layers: tuple[str, ...] = ()) -> None:
        """Start an empty film of width x height pixels on a device, with `layers` beside its light."""
        import warp as wp

        from wrt.kernels.film import FilmData

        self.width, self.height, self.device = width, height, device
        self.pixels = pixels = width * height
        self._per_pixel = bytes_per_pixel(layers)
        self.require_memory(BYTES_PER_PIXEL + self._per_pixel)
        self.layers = FilmLayers(layers, width, height, device)
        self.data = FilmData()
        self.data.total = wp.zeros(pixels, dtype=wp.vec3d, device=device.name)
        self.data.total_of_squares = wp.zeros(pixels, dtype=wp.vec3d, device=device.name)
        self.data.count = wp.zeros(pixels, dtype=wp.int32, device=device.name)
        self.data.rejected = wp.zeros(pixels, dtype=wp.int32, device=device.name)
        self.data.rays = wp.zeros(pixels, dtype=wp.int64, device=device.name)

    def require_memory(self, new: int = 0) -> None:
        """Raise InputError unless there is memory for `new` bytes a pixel and for the copies that saving makes."""
        what = f"a picture of {self.width}x{self.height}"
        copies = self.pixels * (COPIED_PER_PIXEL + self._per_pixel)
        self.device.require_memory(self.pixels * new, what, copies=copies)

    def state(self) -> dict[str, NDArray[Any]]:
        """Return copies of all that must be kept to go on later, by name."""
        return {name: array.copy() for name, array in self.arrays().items()}

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that `state` copies; on the CPU these are the film's own arrays."""
        own = {name: getattr(self.data, name).numpy() for name in STATE_ARRAYS}
        return {**own, **self.layers.state()}

    def clear(self) -> None:
        """Start anew, with no samples."""
        for name in (*STATE_ARRAYS, "rays"):
            getattr(self.data, name).zero_()
        self.layers.clear()

    def check(self, state: dict[str, NDArray[Any]], shapes: int) -> None:
        """Raise InputError if no render can have produced a state.

        Args:
            state: arrays of the shapes and types that `state` gives.
            shapes: number of shapes in the scene.
        """
        total, squares, count, rejected = (state[name] for name in STATE_ARRAYS)
        if (count < 0).any():
            raise InputError(f"'count' is {count.min()} samples in a pixel")
        if ((rejected < 0) | (rejected > count)).any():
            raise InputError("'rejected' is below 0 or above 'count'")
        if not (np.isfinite(total).all() and np.isfinite(squares).all()):
            raise InputError("sums of samples are not finite")
        if (squares < 0.0).any():
            raise InputError("a sum of squares is negative")
        # The Cauchy-Schwarz inequality, with a margin for rounding; without samples the sums must be 0.
        with np.errstate(over="ignore"):
            possible = np.abs(total) <= np.sqrt(squares * count[:, None]) * (1.0 + 1e-6)
        if not possible.all():
            raise InputError("sums of samples do not match their squares and count")
        self.layers.check(state, shapes)

    def restore(self, state: dict[str, NDArray[Any]]) -> None:
        """Go on from a state; arrays must have the shapes and types that `state` gives."""
        import warp as wp

        for name in STATE_ARRAYS:
            target = getattr(self.data, name)
            wp.copy(target, wp.array(state[name], dtype=target.dtype, device=self.device.name))
        self.layers.restore(state)

    @property
    def counts(self) -> NDArray[np.int32]:
        """(H, W) int32 samples in each pixel."""
        counts: NDArray[np.int32] = self.data.count.numpy().reshape(self.height, self.width)
        return counts

    @property
    def rays(self) -> int:
        """Rays traced since this film was made."""
        return int(self.data.rays.numpy().sum())

    @property
    def rejected(self) -> int:
        """Samples that were not finite and counted as black."""
        return int(self.data.rejected.numpy().sum())

    def mean(self) -> NDArray[np.float32]:
        """Return (H, W, 3) float32 linear radiance; black where there are no samples yet."""
        n = np.maximum(self.data.count.numpy(), 1)[:, None]
        mean: NDArray[np.float32] = (self.data.total.numpy() / n).astype(np.float32)
        return mean.reshape(self.height, self.width, 3)

    def device_mean(self) -> Any:
        """Return (H, W) wp.array of vec3 on the device: what `mean` gives."""
        import warp as wp

        from wrt.kernels.film import film_mean

        mean = wp.empty(self.pixels, dtype=wp.vec3, device=self.device.name)
        self.device.launch(film_mean, self.pixels, [self.data.total, self.data.count, mean])
        return mean.reshape((self.height, self.width))

    def variance(self) -> NDArray[np.float64]:
        """Return (H, W, 3) float64 variance of the mean; NaN below two samples."""
        n = self.data.count.numpy().astype(np.float64)[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            mean = self.data.total.numpy() / n
            spread = np.maximum(self.data.total_of_squares.numpy() / n - mean * mean, 0.0)
            variance = np.where(n > 1.0, spread / (n - 1.0), np.nan)
        return variance.reshape(self.height, self.width, 3)

    def noise(self) -> float | None:
        """Return the picture's relative noise: the pixels' mean standard error over their mean radiance.

        Not the root mean square, which a handful of pixels across the edge of a lamp would rule. None
        before any pixel has two samples, or where the picture is black.
        """
        import warp as wp

        from wrt.kernels.film import film_noise

        mean = wp.zeros(self.height, dtype=wp.float64, device=self.device.name)
        error = wp.zeros(self.height, dtype=wp.float64, device=self.device.name)
        rows = -(-NOISE_PIXELS // self.width)
        self.device.launch(film_noise, self.height, [self.width, self.data, mean, error], least=rows)
        total = float(mean.numpy().sum())
        if total <= 0.0:
            return None
        return float(error.numpy().sum()) / total
