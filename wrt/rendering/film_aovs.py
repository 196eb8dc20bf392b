"""The layers of a film on the host: AOVs, arbitrary output variables."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.backend.device import Device
from wrt.errors import InputError
from wrt.rendering.reading import PLAIN, Reading
from wrt.scene.cryptomatte import RANKS, TYPES, ids_of
from wrt.scene.layers import CATCHER, FILM_LAYERS, LIGHT_GROUPS, NAMED, NUMBERS, REST, group_layer
from wrt.scene.scene import Shape

_ARRAYS = ("sums", "nearest", "object_number", "off_middle")
_COVERAGE = "coverage"
_PREFIX = "layer_"

_SLOTS = 8
"""Objects in a pixel whose samples are counted; two more than files hold, as the largest are not the first ones."""

_RANKED_AT_ONCE = 1 << 18
"""Pixels whose objects are ranked at once, which takes 200 bytes for each."""


def bytes_per_pixel(names: tuple[str, ...], groups: tuple[str, ...] = ()) -> int:
    """Return the bytes of layers per pixel, in a scene with these light groups."""
    if not names:
        return 0
    layers = [FILM_LAYERS[name] for name in names if name not in (*NAMED, LIGHT_GROUPS)]
    sizes = sum((8 if layer.averaged else 4) * len(layer.channels) for layer in layers)
    return sizes + 8 * (1 + _group_channels(names, groups) + _counts_coverage(names) * _SLOTS)


def _group_channels(names: tuple[str, ...], groups: tuple[str, ...]) -> int:
    return 3 * (1 + len(groups)) if LIGHT_GROUPS in names else 0


def _counts_coverage(names: tuple[str, ...]) -> bool:
    return not TYPES.keys().isdisjoint(names)


@dataclass(frozen=True)
class Labels:
    """What the numbers in a film's layers stand for.

    Attributes:
        materials: the number of each shape's material, from 1 in order of first use.
        objects: the name of each shape.
        material_names: the name of each material.
    """

    materials: Sequence[int] = ()
    objects: Sequence[str] = ()
    material_names: Sequence[str] = ()

    def ids(self, layer: str) -> NDArray[np.uint32]:
        """Return the Cryptomatte id of each object number from 0, in one of the layers of ranked coverage."""
        if layer == "crypto_object":
            return np.append(np.uint32(0), ids_of(self.objects))
        return np.append(np.uint32(0), ids_of(self.material_names))[[0, *self.materials]]


NO_LABELS = Labels()


def labels_of(shapes: Sequence[Shape]) -> Labels:
    """Return the numbers and the names of a scene's shapes and their materials."""
    numbers: dict[int, int] = {}
    materials = [numbers.setdefault(id(shape.material), len(numbers) + 1) for shape in shapes]
    names = {number: shape.material.label(number) for number, shape in zip(materials, shapes, strict=True)}
    return Labels(materials, [shape.name for shape in shapes], list(names.values()))


class FilmAovs:
    """The selected layers of a film; without any it takes no memory."""

    def __init__(
        self,
        names: tuple[str, ...],
        width: int,
        height: int,
        device: Device,
        groups: tuple[str, ...] = (),
        reading: Reading = PLAIN,
    ) -> None:
        """Start empty layers of a film of width x height pixels on a device, of a scene with these light groups."""
        backend = device.backend
        aovs = backend.kernels("wrt.kernels.integrators.aovs")

        self.names, self.width, self.height, self.device = names, width, height, device
        self._groups, self._reading = groups, reading
        self.data = aovs.AovData()
        self._first: dict[str, int] = {}
        counts = {True: 0, False: 0}
        for name, layer in FILM_LAYERS.items():
            if name in NAMED:
                continue
            self._first[name] = counts[layer.averaged] if name in names else -1
            setattr(self.data, name, self._first[name])
            if name in names:
                counts[layer.averaged] += len(layer.channels)
        self.data.light_groups = counts[True]
        counts[True] += _group_channels(names, groups)
        if not names:
            return
        pixels = width * height
        self.data.sums = backend.zeros((pixels, counts[True]), "float64", device.name)
        self.data.nearest = backend.zeros((pixels, counts[False]), "float32", device.name)
        self.data.object_number = backend.zeros(pixels, "int32", device.name)
        self.data.off_middle = backend.empty(pixels, "float32", device.name)
        self.data.off_middle.fill_(float("inf"))
        self.data.slots = _SLOTS if _counts_coverage(names) else 0
        self.data.coverage = backend.zeros((pixels, 2 * self.data.slots), "int32", device.name)

    @property
    def _saved(self) -> tuple[str, ...]:
        """The arrays that are saved for resuming."""
        if not self.names:
            return ()
        return (*_ARRAYS, _COVERAGE) if self.data.slots else _ARRAYS

    def state(self) -> dict[str, Any]:
        """Return the arrays on the device that are saved for resuming, by name."""
        return {_PREFIX + name: getattr(self.data, name) for name in self._saved}

    def clear(self) -> None:
        """Remove all samples."""
        for name in self._saved:
            getattr(self.data, name).zero_()
        if self.names:
            self.data.off_middle.fill_(float("inf"))

    def check(self, state: dict[str, NDArray[Any]], shapes: int) -> None:
        """Raise InputError if no render can have produced a state; see `wrt.rendering.film.Film.check`."""
        if not self.names:
            return
        sums, nearest, objects, off_middle = (state[_PREFIX + name] for name in _ARRAYS)
        if not np.isfinite(sums).all():
            raise InputError("sums of layers are not finite")
        for name in (each for each in self.names if each != LIGHT_GROUPS):
            first, channels = self._first.get(name, -1), FILM_LAYERS[name].channels
            if FILM_LAYERS[name].averaged and name != "albedo":  # a mean of unit vectors, or a share
                means = sums[:, first : first + len(channels)]
                means = means[:, 3:] if name == CATCHER else means
                least = 0.0 if means.shape[1] == 1 else -np.inf
                if (np.abs(means) > state["count"][:, None] * (1.0 + 1e-6)).any() or (means < least).any():
                    raise InputError(f"the layer {name!r} has impossible values")
            # Motion is NaN for a point that moves behind the camera.
            shown = first >= 0 and not FILM_LAYERS[name].averaged and name != "motion"
            if shown and np.isnan(nearest[:, first : first + len(channels)]).any():
                raise InputError(f"the layer {name!r} has values that are not numbers")
        if ((objects < 0) | (objects > shapes)).any():
            raise InputError(f"an object number is not one of the scene's {shapes}")
        if not (off_middle >= 0.0).all():
            raise InputError("'off_middle' is below 0, or not a number")
        if self.data.slots:
            objects, samples = np.moveaxis(state[_PREFIX + _COVERAGE].reshape(len(objects), -1, 2), 2, 0)
            if ((objects < 0) | (objects > shapes) | (samples < 0) | ((objects > 0) != (samples > 0))).any():
                raise InputError("its coverage by objects has impossible values")
            if (samples.sum(axis=1, dtype=np.int64) > state["count"]).any():
                raise InputError("a pixel has more samples of its objects than samples")

    def arrays(
        self,
        counts: NDArray[np.int32],
        labels: Labels = NO_LABELS,
        *,
        names: Sequence[str] | None = None,
        blended: bool = True,
    ) -> dict[str, NDArray[Any]]:
        """Return each layer, (H, W, channels), (H, W) for one channel, or (H, W, ranks, 2) ids and coverage.

        There is a layer for each light group.

        Args:
            counts: (pixels,) samples in each pixel of the film.
            labels: what its numbers stand for; needed for layers of materials and of ranked coverage alone.
            names: the layers that are wanted; by default all of the film.
            blended: whether means are those of the picture, not of each pixel's own samples, with margins.
        """
        samples = np.maximum(counts[:, None], 1)
        fetch = functools.cache(lambda name: self.device.backend.fetch(getattr(self.data, name)))
        shape, cut = (self.height, self.width), self._reading.cut
        result: dict[str, NDArray[Any]] = {}

        def means(first: int, channels: int) -> NDArray[np.float32]:
            values = (fetch("sums")[:, first : first + channels] / samples).reshape(*shape, channels)
            return (self._reading.picture(values) if blended else values).astype(np.float32)

        for name in self.names if names is None else names:
            if name == LIGHT_GROUPS:
                for number, group in (*enumerate(self._groups, 1), (0, REST)):
                    result[group_layer(group)] = means(self.data.light_groups + 3 * number, 3)
                continue
            if name in NUMBERS:
                objects = fetch("object_number")
                values = objects if name == "object" else np.array([0, *labels.materials])[objects]
                result[name] = cut(values.astype(np.uint32).reshape(shape))
                continue
            if name in TYPES:
                rank = self._ranked_after_blending if self._reading.share else self._ranked
                result[name] = cut(rank(labels.ids(name), counts).reshape(*shape, RANKS, 2))
                continue
            layer = FILM_LAYERS[name]
            first, count = self._first[name], len(layer.channels)
            if layer.averaged:
                values = means(first, count)
            else:
                values = cut(fetch("nearest")[:, first : first + count].reshape(*shape, count)).astype(np.float32)
            result[name] = values if count > 1 else values[..., 0]
        return result

    def _ranked(self, ids: NDArray[np.uint32], counts: NDArray[np.int32]) -> NDArray[np.float32]:
        """Return (pixels, ranks, 2) ids and coverage, the largest first, of equal ones the one that was met first.

        Args:
            ids: the id of each object number from 0.
            counts: (pixels,) samples in each pixel.
        """
        pairs = self.device.backend.fetch(self.data.coverage).reshape(len(counts), -1, 2)
        result = np.empty((len(counts), RANKS, 2), np.float32)
        for start in range(0, len(counts), _RANKED_AT_ONCE):
            part = slice(start, start + _RANKED_AT_ONCE)
            found, samples = ids[pairs[part, :, 0]], pairs[part, :, 1].copy()
            for later in range(1, _SLOTS):  # objects of one name, or with one material, count together
                for slot in range(later):
                    moved = np.where(found[:, slot] == found[:, later], samples[:, later], 0)
                    samples[:, slot] += moved
                    samples[:, later] -= moved
            order = np.argsort(-samples, axis=1, kind="stable")[:, :RANKS]
            found, samples = (np.take_along_axis(values, order, axis=1) for values in (found, samples))
            result[part, :, 0] = np.where(samples > 0, found, np.uint32(0)).view(np.float32)
            result[part, :, 1] = samples / np.maximum(counts[part, None], 1)
        return result

    def _ranked_after_blending(self, ids: NDArray[np.uint32], counts: NDArray[np.int32]) -> NDArray[np.float32]:
        """Return what `_ranked` does, of coverage that is blended as the picture is; equal ones by their ids."""
        pairs = self.device.backend.fetch(self.data.coverage).reshape(self.height, self.width, _SLOTS, 2)
        samples = np.maximum(counts, 1).reshape(self.height, self.width, 1)
        weights = np.array([self._reading.share, 1.0 - 2.0 * self._reading.share, self._reading.share])
        columns = np.clip(np.arange(-1, self.width + 1), 0, self.width - 1)
        result = np.empty((self.height, self.width, RANKS, 2), np.float32)
        band = max(_RANKED_AT_ONCE // (9 * self.width), 1)
        for start in range(0, self.height, band):
            end = min(start + band, self.height)
            around = np.ix_(np.clip(np.arange(start - 1, end + 1), 0, self.height - 1), columns)
            shares = pairs[around][..., 1] / samples[around]
            found, shares = (
                np.lib.stride_tricks.sliding_window_view(values, (3, 3), axis=(0, 1))
                for values in (ids[pairs[around][..., 0]], shares)
            )
            found = found.reshape(-1, 9 * _SLOTS)
            shares = (shares * np.outer(weights, weights)).reshape(found.shape)
            order = np.argsort(found, axis=1, kind="stable")
            found, shares = (np.take_along_axis(values, order, axis=1) for values in (found, shares))
            is_first = np.ones(found.shape, bool)
            is_first[:, 1:] = found[:, 1:] != found[:, :-1]
            sums = np.zeros(found.shape)
            sums[is_first] = np.bincount(np.cumsum(is_first) - 1, weights=shares.ravel())
            order = np.argsort(-sums, axis=1, kind="stable")[:, :RANKS]
            found, sums = (np.take_along_axis(values, order, axis=1) for values in (found, sums))
            shape = (end - start, self.width, RANKS)
            result[start:end, ..., 0] = np.where(sums > 0.0, found, np.uint32(0)).view(np.float32).reshape(shape)
            result[start:end, ..., 1] = sums.reshape(shape)
        return result
