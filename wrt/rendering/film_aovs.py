"""The layers of a film on the host: AOVs, arbitrary output variables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.backend.device import Device
from wrt.errors import InputError
from wrt.scene.layers import CATCHER, FILM_LAYERS, LIGHT_GROUPS, NUMBERS, REST, group_layer
from wrt.scene.materials import Material

_ARRAYS = ("sums", "nearest", "object_number", "off_middle")
_PREFIX = "layer_"


def bytes_per_pixel(names: tuple[str, ...], groups: tuple[str, ...] = ()) -> int:
    """Return the bytes of layers per pixel, in a scene with these light groups."""
    layers = [FILM_LAYERS[name] for name in names if name not in (*NUMBERS, LIGHT_GROUPS)]
    of_groups = 8 * _group_channels(names, groups)
    return of_groups + sum((8 if each.averaged else 4) * len(each.channels) for each in layers) + 8 if names else 0


def _group_channels(names: tuple[str, ...], groups: tuple[str, ...]) -> int:
    return 3 * (1 + len(groups)) if LIGHT_GROUPS in names else 0


def material_numbers(materials: Sequence[Material]) -> list[int]:
    """Return a number for the material of each shape, from 1 in order of first use."""
    first_seen: dict[int, int] = {}
    return [first_seen.setdefault(id(material), len(first_seen) + 1) for material in materials]


class FilmAovs:
    """The selected layers of a film; without any it takes no memory."""

    def __init__(
        self, names: tuple[str, ...], width: int, height: int, device: Device, groups: tuple[str, ...] = ()
    ) -> None:
        """Start empty layers for a picture of width x height pixels on a device, of a scene with these light groups."""
        backend = device.backend
        aovs = backend.kernels("wrt.kernels.integrators.aovs")

        self.names, self.width, self.height, self.device = names, width, height, device
        self._groups = groups
        self.data = aovs.AovData()
        self._first: dict[str, int] = {}
        counts = {True: 0, False: 0}
        for name, layer in FILM_LAYERS.items():
            if name in NUMBERS:
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

    def state(self) -> dict[str, Any]:
        """Return the arrays on the device that are saved for resuming, by name."""
        return {_PREFIX + name: getattr(self.data, name) for name in _ARRAYS} if self.names else {}

    def clear(self) -> None:
        """Remove all samples."""
        if self.names:
            for array in (self.data.sums, self.data.nearest, self.data.object_number):
                array.zero_()
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

    def arrays(self, counts: NDArray[np.int32], materials: Sequence[int]) -> dict[str, NDArray[Any]]:
        """Return each layer, (H, W, channels), or (H, W) if it has one channel, one for each light group.

        Args:
            counts: (H, W) samples in each pixel.
            materials: numbers of the materials of the scene's shapes, see `material_numbers`.
        """
        if not self.names:
            return {}
        fetch = self.device.backend.fetch
        objects = fetch(self.data.object_number)
        numbers = [0, *materials]
        averages = fetch(self.data.sums) / np.maximum(counts.reshape(-1, 1), 1)
        nearest = fetch(self.data.nearest)
        result: dict[str, NDArray[Any]] = {}
        for name in self.names:
            if name == LIGHT_GROUPS:
                lights = averages[:, self.data.light_groups :].astype(np.float32)
                for number, group in (*enumerate(self._groups, 1), (0, REST)):
                    radiance = lights[:, 3 * number : 3 * number + 3]
                    result[group_layer(group)] = radiance.reshape(self.height, self.width, 3)
                continue
            if name in NUMBERS:
                values = objects if name == "object" else np.array(numbers)[objects]
                result[name] = values.astype(np.uint32).reshape(self.height, self.width)
                continue
            layer = FILM_LAYERS[name]
            first, count = self._first[name], len(layer.channels)
            values = (averages if layer.averaged else nearest)[:, first : first + count].astype(np.float32)
            result[name] = values.reshape((self.height, self.width, count) if count > 1 else (self.height, self.width))
        return result
