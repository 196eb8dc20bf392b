"""Read Mitsuba's emitters without a shape: point, spot and directional lights, and environments."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.io.images import read_image
from wrt.io.mitsuba.daylight import daylight
from wrt.io.mitsuba.materials.textures import Textures
from wrt.io.mitsuba.plugin import Plugin
from wrt.io.mitsuba.transforms import axis_and_degrees, rotation_part
from wrt.scene.environment import ConstantEnvironment, Environment, ImageEnvironment
from wrt.scene.lights import DirectionalLight, Light, PointLight, SpotLight
from wrt.values import Vec3, sealed, vec3

_TURNED = np.diag([-1.0, 1.0, -1.0])
"""Rotation from wrt's environment images to Mitsuba's: the middle column is −z in wrt, +z in Mitsuba."""

_SMOOTH_ROWS = 512
"""Smaller environments are resampled to this many rows, because Mitsuba's rows lie elsewhere and are interpolated."""


ON_SHAPES = ("area", "directionalarea")
"""Emitters that are part of a shape."""


class Emitters:
    """Turns `emitter` plugins into wrt's lights and environment."""

    def __init__(self, textures: Textures) -> None:
        self.textures = textures
        self.lights: list[Light] = []
        self.environment: Environment | None = None

    def add(self, plugin: Plugin) -> None:
        """Add an emitter.

        Raises:
            InputError: naming file and line, when a value in it cannot be used.
        """
        plugin.ignore("sampling_weight")
        try:
            light = self._light(plugin)
            environment = None if light else self._environment(plugin)
        except InputError as error:
            raise plugin.placed(error) from None
        if light is None and environment is None:
            plugin.warn("this kind of emitter is not known; left out")
            return
        plugin.finish()
        if light is not None:
            self.lights.append(light)
        elif self.environment is not None:
            plugin.warn("the scene already has an environment; left out")
        else:
            self.environment = environment

    def _color(self, plugin: Plugin, name: str) -> Vec3:
        return self.textures.constant(plugin, name, 1.0, shines=True)

    def _light(self, plugin: Plugin) -> Light | None:
        matrix = plugin.transform() if plugin.type in ("point", "spot", "directional") else np.eye(4)
        position, forward = vec3(matrix[:3, 3]), vec3(matrix[:3, 2])
        if plugin.type == "point":
            return PointLight(plugin.point("position", position), intensity=self._color(plugin, "intensity"))
        if plugin.type == "directional":
            direction = plugin.point("direction", forward)
            return DirectionalLight(direction, irradiance=self._color(plugin, "irradiance"))
        if plugin.type == "spot":
            if plugin.named("texture") is not None:
                plugin.warn("the texture of a spot light is left out")
            cutoff = plugin.number("cutoff_angle", 20.0)
            return SpotLight(
                position,
                forward,
                intensity=self._color(plugin, "intensity"),
                inner_degrees=plugin.number("beam_width", 0.75 * cutoff),
                outer_degrees=cutoff,
                falloff="linear",
            )
        return None

    def _environment(self, plugin: Plugin) -> Environment | None:
        if plugin.type == "constant":
            return ConstantEnvironment(self._color(plugin, "radiance"))
        if plugin.type == "envmap":
            return self._image(plugin)
        if plugin.type in ("sunsky", "sky", "sun"):
            sky, sun = daylight(plugin, self.textures)
            self.lights.extend([] if sun is None else [sun])
            return sky
        return None

    def _image(self, plugin: Plugin) -> ImageEnvironment:
        file = plugin.file()
        pixels = _rows_between(read_image(file))
        axes, stretch, plain = rotation_part(plugin.transform())
        if not plain:
            plugin.warn("'to_world' has shear, which is left out")
        if stretch[0] < 0.0:  # mirrored along x
            pixels = pixels[:, ::-1]
        axis, degrees = axis_and_degrees(axes @ _TURNED)
        scale = plugin.number("scale", 1.0)
        plugin.ignore("mis_compensation")
        return ImageEnvironment(sealed(np.ascontiguousarray(pixels)), scale, degrees, file.name, axis)


def _rows_between(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Resample an environment whose first and last rows are the poles to rows that begin half a row from the poles."""
    height = len(pixels)
    if height < 2:
        return pixels
    finer = height * math.ceil(_SMOOTH_ROWS / height) if height < _SMOOTH_ROWS else height
    place = (np.arange(finer) + 0.5) / finer * (height - 1)
    row = np.minimum(place.astype(np.int64), height - 2)
    share = (place - row)[:, None, None]
    return np.asarray(pixels[row] * (1.0 - share) + pixels[row + 1] * share, np.float32)
