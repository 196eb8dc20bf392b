"""The kernels of a pass: the scalar one, and the wide one that replaces it on CPUs that can run it."""

from __future__ import annotations

import math
import os
import time
from typing import Any

from wrt.backend.device import Device
from wrt.backend.processor import lanes_here
from wrt.compiling import general
from wrt.compiling.kernel import SCALAR, declaration
from wrt.rendering.wide_kernel import SPEEDUP, SPEEDUP_OF_OWN, WideKernel, threads_of
from wrt.upload.accel.bvh import kernels_of_building

REGENERATE = "WRT_REGENERATE"
"""Environment variable: 0 has a GPU follow each path in a loop of its own (`kernels/regeneration.py`)."""

FIRST_PICTURE_SECONDS = 3.0
"""Time for which no other process compiles where a general kernel renders: the first picture is then on the disk."""

OF_GPU = "wrt.kernels.regeneration", "make_gpu_render_kernel"
"""Module and name of the function that declares the kernels of GPUs."""


class RenderKernel:
    """The kernels of one picture.

    A general kernel may stand in for the scalar one while that is not compiled, until the scene's own
    wide kernel is (see `wrt.compiling.general`).

    Attributes:
        features: the features of the scene.
        scalar: the kernel that runs a thread for each pixel; None while another stands in for it.
        read: the features that the kernels read of the scene, which may have fewer.
        records: its arguments that hold arrays, from `start` on.
        wide: the scene's own wide kernel, from `start` on.
        seconds_after: time that other pictures of the same kernel take after this one.
        gradients: the kernels of the picture's gradients, by what these are by (`wrt.gradients.kernels.By`), once there
            are some.
    """

    def __init__(self, device: Device, features: Any, width: int, height: int, *, read: Any = None) -> None:
        """Create the kernels for the features of a scene and a film of width x height pixels.

        Args:
            device: the device.
            features: the features.
            width: pixels.
            height: pixels.
            read: the features for which the scene was uploaded; None if it can still be uploaded for any.
        """
        self.records: tuple[Any, ...] = ()
        self.seconds_after = 0.0
        self.gradients: dict[str, Any] = {}
        self._device, self.features = device, features
        self._width, self._height = width, height
        self._stand_in: WideKernel | None = None
        can_launch = device.is_cpu and device.backend.artefacts.can_launch
        found = general.compiled_for(features, lanes_here()) if can_launch else None
        if found is not None and read is not None and not read.has_uploads_of(found):
            found = None
        self.read = features if found is None else found
        self.scalar: Any = None
        if found is None or features.guides:
            self._use_scalar()

    def _use_scalar(self) -> None:
        regenerates = os.environ.get(REGENERATE) != "0"
        call = declaration(self.read, SCALAR) if self._device.is_cpu else (*OF_GPU, self.read, regenerates)
        self.scalar = self._device.backend.call(*call)

    def to_compile(self) -> list[Any]:
        """Return the kernels to compile beside the build of the tree: the scalar one if needed, the film's, the tree's.

        The largest is first, then those of the tree from its last on, as the build itself begins with its first.
        """
        film = self._device.backend.kernels("wrt.kernels.film.film")
        scalar = [] if self.scalar is None else [self.scalar]
        return [*scalar, film.film_noise, *reversed(kernels_of_building(self._device))]

    def start(self, records: tuple[Any, ...]) -> None:
        """Load the kernel that stands in for the scalar one, if it must, now that the arguments are known.

        If that is impossible, for instance because an array is too large for it, use the scalar one.
        """
        self.records, self.wide = records, WideKernel(self._device, self.features, records)
        self._started = time.perf_counter()
        if self.scalar is None:
            is_own = self.read == self.features
            self._stand_in = self.wide if is_own else WideKernel(self._device, self.read, records)
            self._stand_in.expect(math.inf)
            if self._stand_in.kernel is None:
                self._stand_in = None
                self._use_scalar()

    def expect(self, seconds: float) -> None:
        """Load the wide kernel before the first pass, if that is quick, for a render that takes so long at least."""
        self.wide.expect(seconds + self.seconds_after)

    def launch(self, inputs: list[Any], seconds_left: float) -> None:
        """Render a pass with the kernel's arguments; `seconds_left` decides whether to load the wide kernel."""
        seconds_left += self.seconds_after
        stands_in = self._stand_in is not None
        may_compile = not stands_in or time.perf_counter() - self._started > FIRST_PICTURE_SECONDS
        self.wide.prepare(seconds_left, SPEEDUP_OF_OWN if stands_in else SPEEDUP, may_compile=may_compile)
        threads, best = self._width * self._height, self._best()
        if best.kernel is not None:
            threads = threads_of(self._width, self._height, best.tile)
        spared = int(self.wide.is_being_compiled)
        self._device.launch(best.kernel or self.scalar, threads, inputs, spared=spared, cancellable=True)

    def features_for(self, scene: Any) -> Any:
        """Return the features of this kernel if it can render a scene with the features `scene`, else those."""
        return self.features if self.features.covers(scene) else scene

    def share_wide(self, source: RenderKernel) -> None:
        """Use the wide kernel of `source` if it is for the same features, instead of loading another."""
        if source.features == self.features:
            self.wide = source.wide

    @property
    def lanes(self) -> int:
        """Paths that the kernel of the next pass follows at once."""
        return self._best().lanes

    def _best(self) -> WideKernel:
        """Return the fastest of the wide kernels; its `kernel` is None if only the scalar one can run."""
        return self.wide if self.wide.kernel is not None or self._stand_in is None else self._stand_in
