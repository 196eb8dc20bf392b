"""The renderers of a view: the picture, its previews while the camera moves, and its layers, over one built scene."""

from __future__ import annotations

import dataclasses
import math
import tempfile
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from wrt.linalg import dot
from wrt.rendering.renderer import Renderer
from wrt.scene.camera import Camera
from wrt.view.controls import Look, Settings

PREVIEW_SECONDS = 0.02
"""Target time of a preview, so that the picture follows the hand."""

FIRST_RATE = 5e5
"""Camera paths per second assumed before any has been traced."""

LARGEST_DIVISOR = 12


class Pictures:
    """Renderers that share one scene on the device.

    Attributes:
        base: the renderer of the scene's own settings.
        main: the renderer of the picture with the settings of the view.
        home: the camera of the scene.
    """

    def __init__(self, base: Renderer) -> None:
        """Begin with a renderer."""
        assert base.scene.camera is not None
        self.base = self.main = base
        self.home: Camera = base.scene.camera
        self._settings = Settings()
        self._layer: tuple[str, Renderer] | None = None
        self._previews: dict[tuple[str, int], Renderer] = {}
        self._aims = WeakKeyDictionary({base: self.home})
        self._rate = FIRST_RATE

    def shown(self, settings: Settings) -> Renderer | None:
        """Return the renderer for the settings, None until `get` has made it."""
        if settings.overrides() != self._settings.overrides():
            return None
        if settings.layer in ("", "noise"):
            return self.main
        return self._layer[1] if self._layer is not None and self._layer[0] == settings.layer else None

    def get(self, settings: Settings) -> Renderer:
        """Return the renderer for the settings."""
        overrides = settings.overrides()
        if overrides != self._settings.overrides():
            self.main = self.base.sharing(**overrides) if overrides else self.base
            self._settings = settings
            self._previews.clear()
        renderer = self.shown(settings)
        if renderer is None:
            renderer = self.base.sharing(integrator="aov", layers=(settings.layer,))
            self._layer = settings.layer, renderer
        return renderer

    def preview(self, settings: Settings) -> Renderer:
        """Return a renderer for the settings with so few pixels that a sample takes PREVIEW_SECONDS."""
        full = self.get(settings)
        pixels = full.width * full.height
        divisor = math.ceil(math.sqrt(pixels / max(self._rate * PREVIEW_SECONDS, 1.0)))
        divisor = max(1, min(divisor, LARGEST_DIVISOR, full.width, full.height))
        layer = "" if full is self.main else settings.layer
        if (layer, divisor) not in self._previews:
            size: dict[str, Any] = {
                "width": -(-full.width // divisor),
                "height": -(-full.height // divisor),
                "crop": None,
            }
            size["edge_width"] = full.settings.edge_width / divisor
            self._previews[layer, divisor] = full.sharing(**size)
        return self._previews[layer, divisor]

    def timed(self, paths_per_second: float) -> None:
        """Learn from the speed of a pass how many pixels a preview can have."""
        self._rate += 0.5 * (paths_per_second - self._rate)

    def is_aimed(self, renderer: Renderer, camera: Camera) -> bool:
        """Return whether a renderer's picture is of this camera."""
        return self._aims.get(renderer) == camera

    def aim(self, renderer: Renderer, camera: Camera) -> Renderer:
        """Look through a camera; the picture restarts if it is another one."""
        if not self.is_aimed(renderer, camera):
            renderer.set_camera(camera)
            renderer.seconds_render, renderer.paths = 0.0, 0
            self._aims[renderer] = camera
        elif renderer.scene.camera != camera:  # another renderer has moved the camera of the shared scene
            renderer.scene.camera = camera
            renderer._built.look_from(camera)
        return renderer

    def pick(self, camera: Camera, x: float, y: float) -> dict[str, Any] | None:
        """Return the position of the surface at a place of the picture, and its shape's name and bounds, or None."""
        column = min(max(int(x * self.base.width), 0), self.base.width - 1)
        row = min(max(int(y * self.base.height), 0), self.base.height - 1)
        crop = (column, row, column + 1, row + 1)
        pixel = self.base.sharing(integrator="aov", layers=("position", "object"), crop=crop)
        pixel.set_camera(camera)
        for _ in pixel.passes(spp=1):
            pass
        layers = pixel.layers()
        number = int(layers["object"].ravel()[0])
        if number == 0:
            return None
        position = layers["position"].reshape(3).astype(float)
        shape = self.base.scene.shapes[number - 1]
        forward = camera.frame()[2]
        return {
            "position": position.tolist(),
            "distance": dot(position - np.asarray(camera.origin), forward),
            "name": shape.name,
            "bounds": shape.bounds.tolist(),
        }


def file_of(renderer: Renderer, suffix: str, look: Look) -> bytes:
    """Return the bytes of a picture file, as `Renderer.save` writes it.

    Args:
        renderer: the renderer.
        suffix: .png, .exr or .npy.
        look: exposure and tone curve, for .png, and whether to denoise.

    Raises:
        InputError: see `Renderer.save`.
    """
    settings = renderer.settings
    renderer.settings = dataclasses.replace(settings, **dataclasses.asdict(look))
    try:
        with tempfile.TemporaryDirectory(prefix="wrt-view-") as folder:
            path = Path(folder) / f"picture{suffix}"
            renderer.save(path)
            return path.read_bytes()
    finally:
        renderer.settings = settings
