"""The kernels of gradients: the scalar one, and on CPUs the two wide ones that do its work in two parts.

A wide kernel follows each path by itself, so one writes what each path finds to memory, and another replays the paths.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import Any, Literal, TypeAlias

from wrt.backend.device import Device
from wrt.rendering.wide_kernel import WideKernel, threads_of

By: TypeAlias = Literal["values", "vertices", "index"]
"""What there are derivatives by: values alone, or vertices and normals, or the index of one smooth glass as well."""

PER_LAUNCH = 1 << 20
"""Samples of a launch, between which an interrupt takes effect, and whose radiance is kept: 12 MB."""

MULTIPLE = 16
"""A wide kernel takes any multiple of this number of samples of a pixel at once, or else a power of two."""

STILL_TO_COME = 5.0
"""How much longer gradients are expected to take than so far, as few descents end after some steps."""

SPEEDUP = 2.5
"""How much faster the wide kernels are than the scalar one."""


def portions(spp: int, most: int) -> Iterator[tuple[int, int]]:
    """Yield the first sample of each launch, and the one after its last; a launch takes `most` samples at most."""
    first = 0
    while first < spp:
        left = min(most, spp - first)
        last = first + (left // MULTIPLE * MULTIPLE or 1 << (left.bit_length() - 1))
        yield first, last
        first = last


class GradientKernels:
    """The kernels for the gradients of one picture."""

    def __init__(self, device: Device, features: Any, records: tuple[Any, ...], by: By = "values") -> None:
        """Declare the kernels for these features, and load the wide ones if they are compiled.

        `records` are the arguments of the render kernel that hold arrays. By more than values there are no wide
        kernels.
        """
        self._device = device
        self._scalar = device.backend.call(
            "wrt.kernels.gradients.gradient_pass", "make_gradient_kernel", features, *[by] * (by != "values")
        )
        parts = ("radiance", "replay") if by == "values" else ()
        self._wide = [WideKernel(device, features, records, part) for part in parts]
        self._seconds = 0.0
        for wide in self._wide:
            wide.expect(math.inf)

    @property
    def lanes(self) -> int:
        """Paths that the kernels follow at once."""
        return min((wide.lanes for wide in self._wide), default=1)

    def wait(self) -> None:
        """Compile the wide kernels if necessary, and load them if possible."""
        for wide in self._wide:
            wide.wait()

    def run(self, spp: int, seed: int, shared: list[Any], upstream: Any, sums: Any, width: int, height: int) -> None:
        """Add the derivatives of samples 0 to `spp` − 1 of each pixel to `sums`.

        Args:
            spp: samples.
            seed: the seed of their random numbers.
            shared: arguments of the render kernel between the seed and the film.
            upstream: the derivative of the loss by the radiance of a sample, for each pixel.
            sums: a GradientSums.
            width: pixels.
            height: pixels.
        """
        backend, pixels = self._device.backend, width * height
        most = max(1, PER_LAUNCH // pixels)
        wide = self._wide if self.lanes > 1 else []
        kept = pixels * min(most, spp) if wide else 1
        self._device.require_memory(12 * kept, "replaying paths")
        radiances = backend.empty(kept, "vec3", self._device.name)
        for first, last in portions(spp, most):
            begun = time.perf_counter()
            inputs = [first, last, seed, *shared, upstream, radiances, sums]
            for part in wide:
                self._device.launch(part.kernel, threads_of(width, height, part.tile), inputs)
            if not wide:
                spared = int(any(part.is_being_compiled for part in self._wide))
                self._device.launch(self._scalar, pixels, inputs, spared=spared)
            self._seconds += time.perf_counter() - begun
        if not wide:
            for part in self._wide:
                part.prepare(STILL_TO_COME * self._seconds, SPEEDUP)
