"""Guides for a denoiser: albedo and normals of what is seen, in mirrors and through glass as well."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from wrt.rendering.film import Film
from wrt.rendering.render_kernel import RenderKernel
from wrt.scene.scene import RenderSettings
from wrt.upload.camera import outside_cameras
from wrt.upload.integrators import integrator_features

if TYPE_CHECKING:
    from wrt.rendering.renderer import Renderer

LAYERS = ("albedo", "normal")

MOST_SAMPLES = 64
"""Samples per pixel of the guides: they have little noise, and are filtered before use."""


def guide_features(features: Any, settings: RenderSettings) -> Any:
    """Return the features of the kernel for the guides of a scene with these features."""
    guided = dataclasses.replace(features, guides=True)
    of_guides = dataclasses.replace(settings, layers=LAYERS, edges=False, wireframe=False)
    return integrator_features(guided, "aov", of_guides)


class Guides:
    """The guides of one picture; their samples are those of the picture.

    They have a kernel and a film of their own, so that rendering is as fast as without them.
    """

    def __init__(self, renderer: Renderer) -> None:
        """Prepare the guides of a renderer's picture, and compile their kernel."""
        settings, device, built = renderer.settings, renderer.device, renderer._built
        of_picture = {"sampler": settings.sampler, "cameras": outside_cameras(renderer.camera)}
        features = guide_features(dataclasses.replace(built.features, **of_picture), settings)
        self._renderer = renderer
        self._film = Film(renderer.film.width, renderer.film.height, device, LAYERS, reading=renderer.film.reading)
        self._kernel = RenderKernel(device, features, self._film.width, self._film.height, read=built.read)
        with device.compiling(self._kernel.to_compile()):
            self._kernel.start((built.data, self._film.data, self._film.aovs.data))

    def layers(self) -> dict[str, NDArray[Any]]:
        """Return means of albedo and normals in the film's pixels by name, (H, W, 3) float32.

        They have as many samples as the picture has by now.
        """
        target = min(max(self._renderer.spp, 1), MOST_SAMPLES)
        if self._film.tally().least < target:
            self._kernel.launch([target, *self._renderer.arguments_for(self._film)], 0.0)
        arrays = self._film.aovs.arrays(self._film.fetch("count"), blended=False)
        return {name: np.ascontiguousarray(arrays[name]) for name in LAYERS}

    def clear(self) -> None:
        """Restart, for another camera or other vertices."""
        self._film.clear()
