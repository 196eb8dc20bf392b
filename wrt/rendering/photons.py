"""Sets of photons, each for a few samples of the pixels: sample i of any pixel gathers those of set i / `samples`.

Where shapes move, each sample has a smaller set, which shares the sample's time in all pixels: so light falls where
things are. Times are as even as those of a pixel without photons. Several samples of one time would show a fast thing
as coarsely as fewer samples do.

A set is a function of the seed and its number, so pictures do not depend on passes, crops or what was resumed. Radii
shrink from set to set as by Knaus and Zwicker, "Progressive photon mapping: a probabilistic approach" (2011), eq. 20:
r² falls with the number n of sets as n^(ALPHA − 1), which leaves neither noise nor bias in the limit.
"""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Any

import numpy as np

from wrt.backend.cuda.warp_errors import ran_out
from wrt.backend.device import Device
from wrt.compiling.kernel import PHOTONS, SCALAR, declaration
from wrt.linalg import norm
from wrt.rendering.wide_kernel import WideKernel, threads_of
from wrt.scene.camera import Camera, OrthographicCamera

if TYPE_CHECKING:
    from wrt.upload.casters import CasterTable

ALPHA = 2.0 / 3.0
"""The balance of noise and bias; both fall alike for 2/3."""

FIRST_RADIUS = 2.0
"""Radius of the first set, pixels at the distance of what throws caustics."""

LARGEST_RADIUS = 0.05
"""Most of it, as a share of the size of what throws caustics."""

FIRST_CROWD = 32.0
"""Neighbours that the spread of a photon of the first set reaches, where they are dense."""

FEWEST, MOST = 1 << 14, 1 << 20
"""Photons of a set."""

MOST_SAMPLES = 8
"""Samples of a pixel that gather the same set; there is a photon for every four paths. At equal seconds the errors of a
glass ball under a small lamp and of `still-life` are 1.43 and 0.52 %; 1.50 and 0.62 % with 4, 1.65 and 0.47 % with 16.
"""

PER_THREAD = 16
"""Photons for each thread of the wide kernel; a thread of the scalar kernel follows one."""

SPEEDUP = 2.5
"""How much faster the wide kernel is than the scalar one: 2.1 to 3.0."""


def squared_shrinkage(number: float) -> float:
    """Return r² of set `number`, counted from 0, over r² of set 0."""
    # The product of (i + α) / (i + 1) for i from 1 to `number`
    log = math.lgamma(number + 1.0 + ALPHA) - math.lgamma(1.0 + ALPHA) - math.lgamma(number + 2.0)
    return math.exp(log)


class Photons:
    """The photons of the current set.

    Attributes:
        kernels: the scalar kernels that follow, arrange and spread photons.
        wide: the wide kernel that follows photons, from `start` on.
        samples: how many samples of a pixel gather the same set.
        _seconds: time that following photons took.
        _share: photons of a set over those of a set where nothing moves.
    """

    def __init__(self, device: Device, features: Any, casters: CasterTable, seed: int, width: int, height: int) -> None:
        """Take what photons are aimed at, and the size of the whole picture in pixels.

        Raises:
            InputError: when memory does not suffice.
        """
        backend = device.backend
        self.kernels = [
            backend.call(*declaration(features, SCALAR, PHOTONS)),
            backend.kernels("wrt.kernels.integrators.gathering").arrange_photons,
            backend.kernels("wrt.kernels.integrators.gathering").spread_photons,
        ]
        self._seconds = 0.0
        self._device, self._features, self._casters, self._seed = device, features, casters, seed
        self._size = width, height
        self._count = min(max(2 * width * height, FEWEST), MOST)
        self.samples = min(max(4 * self._count // (width * height), 1), MOST_SAMPLES)
        self._share = 1.0
        if features.shares_times:
            self._share = 1.0 / self.samples
            self._count, self.samples = self._count // self.samples, 1
        photon = backend.kernels("wrt.kernels.core.photon_map").Photon
        device.require_memory(4 * self._count * (photon.numpy_dtype().itemsize + 12), "a set of photons")
        stored = 2 * self._count
        self._found, self._arranged = (backend.empty(stored, photon, device.name) for _ in range(2))
        self._places = backend.empty(stored, "vec4", device.name)
        # A GPU needs room for twice as many to sort them, and numbers that are sorted along.
        room = stored if device.is_cpu else 2 * stored
        self._room = backend.empty(room, "int64", device.name), backend.empty(room, int, device.name)
        self._keys = backend.view(self._room[0], "int64", stored)
        buckets = 1 << (stored - 1).bit_length()
        self._starts = backend.empty(buckets + 1, "int32", device.name)
        self._number: int | None = None
        self._first_radius = 0.0

    def start(self, scene: Any) -> None:
        """Take the scene on the device, without the kernel for several lanes."""
        self.wide = WideKernel(self._device, self._features, (scene,), PHOTONS)
        self.forget()

    def prepare(self, seconds_left: float, seconds: float) -> None:
        """Have the wide kernel compiled if that saves time, `seconds` after the render began."""
        if seconds > 0.0:
            self.wide.prepare(seconds_left * min(self._seconds / seconds, 1.0), SPEEDUP)

    def look_from(self, camera: Camera) -> None:
        """Choose the first radius for a camera."""
        pixel = min(camera.film(*self._size)["pixel"])
        if not isinstance(camera, OrthographicCamera):
            distance = norm(self._casters.center - np.asarray(camera.origin, np.float64))
            pixel *= max(distance, 0.25 * self._casters.size)
        self._first_radius = min(FIRST_RADIUS * pixel, LARGEST_RADIUS * self._casters.size)
        self._number = None

    def forget(self) -> None:
        """Follow the photons anew, as the scene has changed."""
        self._number = None

    def _tiles(self) -> int:
        """Return how many threads of the wide kernel there are: each does the work of a piece of a strip of threads."""
        width = self.wide.tile // 4
        return threads_of(width, -(-self._count // (width * PER_THREAD)), self.wide.tile)

    def provide(self, sample: int, camera: Any, scene: Any, settings: Any) -> int:
        """Have the photons for a sample in the kernels' PathSettings; return the first sample that needs others."""
        number = sample // self.samples
        end = (number + 1) * self.samples
        if self._number == number:
            return end
        self._number = None
        photon_map, backend, (follow, arrange, spread) = settings.photon_map, self._device.backend, self.kernels
        photon_map.photons, photon_map.places, photon_map.starts = self._arranged, self._places, self._starts
        shrinkage = squared_shrinkage(number * self._share)
        photon_map.radius = self._first_radius * math.sqrt(shrinkage)
        photon_map.crowd = FIRST_CROWD * shrinkage * self._share
        begun = time.perf_counter()
        share, threads = 1, self._count
        if self.wide.kernel is not None:
            follow, share, threads = self.wide.kernel, PER_THREAD, self._tiles()
        inputs = [share, number, self._seed, camera, scene, settings, self._casters.data, self._found, self._keys]
        self._device.launch(follow, threads, inputs, spared=int(self.wide.is_being_compiled))
        self._seconds += time.perf_counter() - begun
        if self._device.is_cpu:
            self._keys.numpy().sort()
        else:
            backend.sort_pairs(*self._room, 2 * self._count)
        # No two keys of photons are equal: there is one order, whatever the device.
        unsorted = backend.zeros(1, int, self._device.name)
        inputs = [self._keys, self._found, self._arranged, self._places, self._starts, unsorted]
        self._device.launch(arrange, 2 * self._count + 1, inputs)
        if not self._device.is_cpu and backend.fetch(unsorted)[0]:
            raise ran_out(self._device.name)
        self._device.launch(spread, 2 * self._count, [photon_map, self._places])
        self._number = number
        return end
