"""The film on the host: the sums of samples in each pixel."""

from __future__ import annotations

import contextlib
import threading
import weakref
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.backend.device import Device
from wrt.errors import InputError
from wrt.rendering.film_aovs import FilmAovs, bytes_per_pixel
from wrt.rendering.reading import PLAIN, Reading

STATE_ARRAYS = ("total", "total_of_squares", "count", "rejected")
"""The arrays of a film's state, without the count of rays, which is only a statistic of this run."""

BYTES_PER_PIXEL = 64
"""Memory of a film: two sums of three doubles, two counts and a tally."""

COPIED_PER_PIXEL = 56
"""Memory of temporary copies: a checkpoint copies all but the tally; an 8-bit picture takes less."""

NOISE_PIXELS = 1 << 14
"""Fewest pixels in a slice of the noise kernel: their work is several times that of starting the slice."""


class Tally:
    """Counts in some of a film's pixels, each taken when it is read."""

    def __init__(self, samples: NDArray[Any], rays: NDArray[Any], least: NDArray[Any], most: NDArray[Any]) -> None:
        """Keep the counts of pixels, or of groups of pixels."""
        self._samples, self._rays, self._least, self._most = samples, rays, least, most

    @property
    def samples(self) -> int:
        """All samples."""
        return int(self._samples.sum(dtype=np.int64))

    @property
    def rays(self) -> int:
        """The rays that were traced for them."""
        return int(self._rays.sum())

    @property
    def least(self) -> int:
        """The fewest samples in one pixel."""
        return int(self._least.min())

    @property
    def most(self) -> int:
        """The most samples in one pixel."""
        return int(self._most.max())


class Film:
    """Sums of samples and of their squares, and sample counts, for each pixel of a picture."""

    def __init__(
        self,
        width: int,
        height: int,
        device: Device,
        layers: tuple[str, ...] = (),
        groups: tuple[str, ...] = (),
        reading: Reading = PLAIN,
    ) -> None:
        """Start an empty film of width x height pixels on a device, with `layers` besides radiance.

        `groups` are the light groups of the scene. By `reading` the film becomes a picture, which may be smaller.
        """
        self.width, self.height, self.reading = width, height, reading
        self.pixels = width * height
        self._per_pixel = bytes_per_pixel(layers, groups)
        self.device, backend = device, device.backend
        self.require_memory(BYTES_PER_PIXEL + self._per_pixel)
        self.aovs = FilmAovs(layers, width, height, device, groups, reading)
        self._count_before: Any = None
        self._chosen: tuple[NDArray[np.bool_], Any] | None = None
        self._kept: dict[str, Any] = {}
        self._using_kept = threading.Lock()
        self._images: list[Any] = []
        self.data = backend.kernels("wrt.kernels.film.film").FilmData()
        self.data.total = backend.zeros(self.pixels, "vec3d", device.name)
        self.data.total_of_squares = backend.zeros(self.pixels, "vec3d", device.name)
        self.data.count = backend.zeros(self.pixels, "int32", device.name)
        self.data.rejected = backend.zeros(self.pixels, "int32", device.name)
        self.data.rays = backend.zeros(self.pixels, "int64", device.name)

    @property
    def picture_size(self) -> tuple[int, int]:
        """Width and height of the picture that the film becomes, pixels."""
        left, top, right, bottom = self.reading.margins
        return self.width - left - right, self.height - top - bottom

    def require_memory(self, new: int = 0) -> None:
        """Raise InputError unless memory suffices for `new` bytes a pixel and for the copies that saving makes."""
        what = f"a picture of {self.width}x{self.height}"
        copies = self.pixels * (COPIED_PER_PIXEL + self._per_pixel)
        self.device.require_memory(self.pixels * new, what, copies=copies)

    @contextlib.contextmanager
    def leaving_out(self, pixels: NDArray[np.bool_] | None, spp: int) -> Iterator[None]:
        """Within the context, set the count of some pixels to `spp`, so that kernels add no samples to them."""
        if pixels is None:
            yield
            return
        film = self._kernels()
        if self._count_before is None:
            self._count_before = self.device.backend.empty(self.pixels, "int32", self.device.name)
        hidden, before = self._on_device(pixels), self._count_before
        self.device.launch(film.hide_pixels, self.pixels, [hidden, spp, self.data, before])
        try:
            yield
        finally:
            self.device.launch(film.show_pixels, self.pixels, [hidden, before, self.data])

    def tally(self, pixels: NDArray[np.bool_] | None = None) -> Tally:
        """Count samples and rays, in all pixels or where (pixels,) is true, without fetching the film.

        Read the result before the film changes: on the CPU it counts the film's own arrays.
        """
        if self.device.is_cpu:
            counts, rays = self.data.count.numpy(), self.data.rays.numpy()
            if pixels is not None:
                counts, rays = counts[pixels], rays[pixels]
            return Tally(counts, rays, counts, counts)
        film = self._kernels()
        threads = -(-self.pixels // film.PIXELS_OF_TALLY)
        with self._using_kept:
            counted = self._keep("no pixels", 0, "uint8") if pixels is None else self._on_device(pixels)
            found = self._keep("tally", (threads, 4), "int64")
            self.device.launch(film.film_tally, threads, [self.pixels, self.data, counted, found])
            return Tally(*self.device.backend.fetch(found).T)

    def _kernels(self) -> Any:
        return self.device.backend.kernels("wrt.kernels.film.film")

    def _keep(self, name: str, shape: Any, dtype: str) -> Any:
        """Return the array of a name on the device, uninitialised at first, and the same one for the next pass.

        A GPU releases memory after all work of all streams, and what is queued later waits for that.
        """
        if name not in self._kept:
            self._kept[name] = self.device.backend.empty(shape, dtype, self.device.name)
        return self._kept[name]

    def _on_device(self, chosen: NDArray[np.bool_]) -> Any:
        """Return (pixels,) bool on the device; what was sent there last is kept, as it seldom changes."""
        if self._chosen is None or not np.array_equal(self._chosen[0], chosen):
            bits = np.ascontiguousarray(chosen, np.uint8)
            self._chosen = chosen, self.device.backend.array(bits, "uint8", self.device.name)
        return self._chosen[1]

    def fetch(self, name: str) -> NDArray[Any]:
        """Return an array of FilmData by name; on the CPU it is the film's own."""
        array: NDArray[Any] = self.device.backend.fetch(getattr(self.data, name))
        return array

    def state(self) -> dict[str, NDArray[Any]]:
        """Return copies of all arrays needed to resume, by name."""
        return {name: array.copy() for name, array in self.arrays().items()}

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that `state` copies; on the CPU these are the film's own arrays."""
        return {name: self.device.backend.fetch(array) for name, array in self._state().items()}

    def _state(self) -> dict[str, Any]:
        return {**{name: getattr(self.data, name) for name in STATE_ARRAYS}, **self.aovs.state()}

    def clear(self) -> None:
        """Remove all samples."""
        for name in (*STATE_ARRAYS, "rays"):
            getattr(self.data, name).zero_()
        self.aovs.clear()

    def check(self, state: dict[str, NDArray[Any]], shapes: int, *, pixels: int | None = None) -> None:
        """Raise InputError if no render can have produced a state.

        Args:
            state: arrays by name, as `state` returns them.
            shapes: number of shapes in the scene.
            pixels: how many pixels it has, if only some of the film's.
        """
        for name, array in self.arrays().items():
            found, shape = state.get(name), (self.pixels if pixels is None else pixels, *array.shape[1:])
            if found is None or found.shape != shape or found.dtype != array.dtype:
                raise InputError(f"its array {name!r} is missing or of another shape")
        total, squares, count, rejected = (state[name] for name in STATE_ARRAYS)
        with np.errstate(over="ignore", invalid="ignore"):
            # The Cauchy-Schwarz inequality, with a margin for rounding; without samples the sums must be 0.
            most = np.sqrt(squares * count[:, None]) * (1.0 + 1e-6)
        for fault, is_faulty in (
            (f"'count' is {count.min()} samples in a pixel", count < 0),
            ("'rejected' is below 0 or above 'count'", (rejected < 0) | (rejected > count)),
            ("sums of samples are not finite", ~(np.isfinite(total) & np.isfinite(squares))),
            ("a sum of squares is negative", squares < 0.0),
            ("sums of samples do not match their squares and count", ~(np.abs(total) <= most)),
        ):
            if is_faulty.any():
                raise InputError(fault)
        self.aovs.check(state, shapes)

    def restore(self, state: dict[str, NDArray[Any]]) -> None:
        """Continue from a state, whose arrays must have the shapes and types of `state`."""
        backend = self.device.backend
        for name, target in self._state().items():
            backend.copy(target, backend.array(state[name], target.dtype, self.device.name))

    @property
    def counts(self) -> NDArray[np.int32]:
        """(H, W) int32 samples in each pixel of the picture."""
        counts: NDArray[np.int32] = self.reading.cut(self.fetch("count").reshape(self.height, self.width))
        return counts

    @property
    def rays(self) -> int:
        """Rays traced since this film was created."""
        return self.tally().rays

    @property
    def rejected(self) -> int:
        """Samples that were not finite and counted as black."""
        return int(self.fetch("rejected").sum())

    def means(self) -> NDArray[np.float64]:
        """Return (H, W, 3) float64, the mean of each pixel's own samples, with margins; 0 without samples."""
        n = np.maximum(self.fetch("count"), 1)[:, None]
        means: NDArray[np.float64] = self.fetch("total") / n
        return means.reshape(self.height, self.width, 3)

    def mean(self) -> NDArray[np.float32]:
        """Return (H, W, 3) float32 linear radiance; pixels without samples are black."""
        return self.reading.picture(self.means()).astype(np.float32)

    def snapshot(self) -> Callable[[], NDArray[np.float32]]:
        """Keep `means` as they are now, and return a function that fetches them, float32; `reading` makes the picture.

        On a GPU it is copied there. Another thread can fetch the copy while passes go on, which do not wait for that.
        Once the function is gone the next snapshot takes the memory of the copy.
        """
        backend, images = self.device.backend, self._images
        if self.device.is_cpu:
            image = self.means().astype(np.float32)
            return lambda: image
        copy = images.pop() if images else backend.empty(self.pixels, "vec3", self.device.name)
        self._write_mean(copy, PLAIN)
        shape = (self.height, self.width, 3)

        def fetch() -> NDArray[np.float32]:
            mean: NDArray[np.float32] = backend.fetch(copy, beside=True)
            return mean.reshape(shape)

        weakref.finalize(fetch, images.append, copy).atexit = False
        return fetch

    def on_device(self) -> dict[str, Any]:
        """Return (H, W) arrays on the device by name, which are the film's own memory; see `Renderer.device_film`."""
        backend = self.device.backend
        types = {"total": "vec3d", "total_of_squares": "vec3d", "count": "int32", "rejected": "int32", "rays": "int64"}
        shape = (self.height, self.width)
        return {
            name: backend.to_warp(backend.view(getattr(self.data, name), kind, shape), kind)
            for name, kind in types.items()
        }

    def device_mean(self) -> Any:
        """Return `mean` as (H, W) wp.array of vec3 on the device."""
        backend, (width, height) = self.device.backend, self.picture_size
        mean = backend.empty(width * height, "vec3", self.device.name)
        self._write_mean(mean, self.reading)
        return backend.to_warp(backend.view(mean, "vec3", (height, width)), "vec3")

    def _write_mean(self, mean_out: Any, reading: Reading) -> None:
        """Write the picture by a reading to a (pixels,) array of vec3 on the device."""
        arguments = [self.data.total, self.data.count, self._device_reading(reading), mean_out]
        self.device.launch(self._kernels().film_mean, len(mean_out), arguments)

    def _device_reading(self, reading: Reading) -> Any:
        left, top, right, _ = reading.margins
        data = self._kernels().FilmReading()
        data.width, data.picture_width = self.width, self.width - left - right
        data.left, data.top, data.share = left, top, reading.share
        return data

    def variance(self) -> NDArray[np.float64]:
        """Return (H, W, 3) float64 variance of the mean; NaN below two samples."""
        n = self.fetch("count").astype(np.float64)[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            mean = self.fetch("total") / n
            spread = np.maximum(self.fetch("total_of_squares") / n - mean * mean, 0.0)
            variance = np.where(n > 1.0, spread / (n - 1.0), np.nan)
        blended = self.reading.blended(variance.reshape(self.height, self.width, 3), squared=True)
        return self.reading.cut(blended)

    def noise(self) -> float | None:
        """Return the relative noise of the picture: the mean standard error of its pixels over their mean radiance.

        The root mean square would depend on a handful of pixels across the edge of a lamp. None before any pixel has
        two samples, or if the picture is black.
        """
        fetch, rows = self.device.backend.fetch, -(-NOISE_PIXELS // self.width)
        with self._using_kept:
            mean = self._keep("mean of rows", self.height, "float64")
            error = self._keep("error of rows", self.height, "float64")
            launch = self.device.launch
            launch(
                self._kernels().film_noise,
                self.height,
                [self._device_reading(self.reading), self.data, mean, error],
                least=rows,
            )
            total, errors = float(fetch(mean).sum()), float(fetch(error).sum())
        return errors / total if total > 0.0 else None
