"""Emitters that are no shapes: lights at a place or from a direction, and environments."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wrt.environment import ConstantEnvironment, Environment, ImageEnvironment, SunSkyEnvironment
from wrt.errors import InputError
from wrt.formats.images import load_image
from wrt.formats.mitsuba.plugin import Plugin
from wrt.formats.mitsuba.spectra import LUMINOUS
from wrt.formats.mitsuba.textures import Textures
from wrt.formats.mitsuba.transforms import axis_and_degrees, rotation_part
from wrt.lights import DirectionalLight, Light, PointLight, SpotLight
from wrt.values import Vec3

_TURNED = np.diag([-1.0, 1.0, -1.0])
"""From wrt's environment images to Mitsuba's: the middle column looks along −z here, along +z there."""

_SMOOTH_ROWS = 512
"""Environments of fewer rows get as many: theirs lie elsewhere, and what is between them is straight."""


class Emitters:
    """Turns `emitter` plugins into wrt's lights and environment."""

    def __init__(self, textures: Textures) -> None:
        self.textures = textures
        self.lights: list[Light] = []
        self.environment: Environment | None = None

    def add(self, plugin: Plugin) -> None:
        """Take up an emitter.

        Raises:
            InputError: naming file and line, where something in it cannot be used.
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
            plugin.warn("there is an environment before it; left out")
        else:
            self.environment = environment

    def _color(self, plugin: Plugin, name: str) -> Vec3:
        return self.textures.constant(plugin, name, 1.0, shines=True)

    def _light(self, plugin: Plugin) -> Light | None:
        matrix = plugin.transform() if plugin.type in ("point", "spot", "directional") else np.eye(4)
        position, forward = _vec(matrix[:3, 3]), _vec(matrix[:3, 2])
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
            return self._sky(plugin)
        return None

    def _image(self, plugin: Plugin) -> ImageEnvironment:
        file = plugin.file()
        pixels = _rows_between(load_image(file))
        axes, stretch, plain = rotation_part(plugin.transform())
        if not plain:
            plugin.warn("'to_world' slants, which is left out")
        if stretch[0] < 0.0:  # mirrored along x
            pixels = pixels[:, ::-1]
        axis, degrees = axis_and_degrees(axes @ _TURNED)
        scale = plugin.number("scale", 1.0)
        plugin.ignore("mis_compensation")
        return ImageEnvironment(np.ascontiguousarray(pixels), scale, degrees, file.name, axis)

    def _sky(self, plugin: Plugin) -> Environment:
        """Return a clear sky: another model of it, by the same sun, haze and ground."""
        plugin.warn("Preetham's model of sun and sky (1999) stands in for Mitsuba's")
        axes, _, plain = rotation_part(plugin.transform())
        if not plain:
            plugin.warn("'to_world' slants, which is left out")
        plugin.ignore("sun_aperture", "complex_sun", "sun_radius_scale", "resolution", "stretch", "extend")
        if not plugin.has("sun_direction"):
            plugin.warn("the sun's place by date and time is not computed; it stands 45 degrees high in the south")
        plugin.ignore(*("latitude", "longitude", "timezone", "year", "month", "day", "hour", "minute", "second"))
        to_sun = np.array(plugin.point("sun_direction", (0.0, -1.0, 1.0)))
        upright = _upright(axes, plugin)
        direction = upright @ to_sun / max(float(np.linalg.norm(to_sun)), 1e-30)
        if direction[1] < 0.01:
            plugin.warn("a sun below the horizon is put just above it")
            direction[1] = 0.01
        scale = 1.0 / LUMINOUS  # Mitsuba's radiance is a mean over wavelengths, wrt's the sum
        turbidity = min(max(plugin.number("turbidity", 3.0), 2.0), 10.0)
        sky, sun = plugin.number("sky_scale", 1.0), plugin.number("sun_scale", 1.0)
        common = plugin.number("scale", 1.0)
        made = SunSkyEnvironment(
            sun_direction=_vec(direction),
            turbidity=turbidity,
            ground_albedo=self.textures.constant(plugin, "albedo", 0.3),
            sky_scale=0.0 if plugin.type == "sun" else scale * common * sky,
            sun_scale=0.0 if plugin.type == "sky" else scale * common * sun,
        )
        if np.allclose(upright, np.eye(3)):
            return made
        image, light = made.image_and_sun()
        back = upright.T
        axis, degrees = axis_and_degrees(back)
        if light is not None:
            direction_of_light = _vec(back @ np.array(light.direction))
            self.lights.append(
                DirectionalLight(direction_of_light, light.irradiance, angle_degrees=light.angle_degrees)
            )
        return ImageEnvironment(image.pixels, image.scale, degrees, image.name, axis)


def _upright(axes: NDArray[np.float64], plugin: Plugin) -> NDArray[np.float64]:
    """Return the turn by which the sky's own up, z in `sunsky`, becomes y."""
    if plugin.type != "sunsky":
        return np.eye(3)
    up = axes @ (0.0, 0.0, 1.0)
    if np.allclose(up, (0.0, 1.0, 0.0), atol=1e-6):
        return np.eye(3)
    # The rows are where x, y and z of the upright world are.
    side = np.cross(up, (1.0, 0.0, 0.0) if abs(up[0]) < 0.9 else (0.0, 0.0, 1.0))
    side /= np.linalg.norm(side)
    return np.stack([side, up, np.cross(side, up)])


def _rows_between(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return an environment with rows half a row from the poles, from one whose outermost rows are the poles."""
    height = len(pixels)
    if height < 2:
        return pixels
    finer = height * math.ceil(_SMOOTH_ROWS / height) if height < _SMOOTH_ROWS else height
    place = (np.arange(finer) + 0.5) / finer * (height - 1)
    row = np.minimum(place.astype(np.int64), height - 2)
    share = (place - row)[:, None, None]
    return np.asarray(pixels[row] * (1.0 - share) + pixels[row + 1] * share, np.float32)


def _vec(value: NDArray[np.float64]) -> Vec3:
    x, y, z = (float(each) for each in value)
    return x, y, z
