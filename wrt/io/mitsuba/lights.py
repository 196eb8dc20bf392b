"""Read Mitsuba's emitters without a shape: point, spot and directional lights, projectors, and environments."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from wrt.io.images import read_image
from wrt.io.mitsuba.cameras import vertical_degrees
from wrt.io.mitsuba.daylight import daylight
from wrt.io.mitsuba.plugin import Plugin
from wrt.io.mitsuba.textures import Textures
from wrt.io.mitsuba.transforms import axis_and_degrees
from wrt.linalg import determinant, norm, product
from wrt.scene.environment import ConstantEnvironment, Environment, ImageEnvironment
from wrt.scene.lights import DirectionalLight, Light, PointLight, ProjectorLight, SpotLight
from wrt.scene.textures import ImageTexture
from wrt.values import Vec3, sealed, vec3

_TURNED = np.diag([-1.0, 1.0, -1.0])
"""Rotation from wrt's environment images to Mitsuba's: the middle column is −z in wrt, +z in Mitsuba."""

_SMOOTH_ROWS = 512
"""Smaller environments are resampled to this many rows, because Mitsuba's rows lie elsewhere and are interpolated."""

ON_SHAPES = ("area", "directionalarea")  # emitters that are part of a shape


def emitters_of(plugins: Iterable[Plugin], textures: Textures) -> tuple[list[Light], Environment | None]:
    """Return the lights and the environment of `emitter` plugins."""
    lights: list[Light] = []
    environment: Environment | None = None
    for plugin in plugins:
        plugin.ignore("sampling_weight")
        with plugin.locating():
            made = _made(plugin, textures)
        if not made:
            plugin.warn("this kind of emitter is not known; left out")
        for each in made:
            if isinstance(each, Light):
                lights.append(each)
            elif environment is not None:
                plugin.warn("the scene already has an environment; left out")
            else:
                environment = each
    return lights, environment


def _made(plugin: Plugin, textures: Textures) -> Sequence[Light | Environment]:
    """Return the light or the environment of an emitter, or both; nothing if its type is not known."""

    def color(name: str) -> Vec3:
        return textures.constant(plugin, name, 1.0, emits=True)

    if plugin.type == "constant":
        return [ConstantEnvironment(color("radiance"))]
    if plugin.type == "envmap":
        return [_image(plugin)]
    if plugin.type in ("sunsky", "sky", "sun"):
        return daylight(plugin, textures)
    if plugin.type not in ("point", "directional", "spot", "projector"):
        return []
    matrix = plugin.transform()
    position, up, forward = vec3(matrix[:3, 3]), matrix[:3, 1], vec3(matrix[:3, 2])
    if plugin.type == "point":
        return [PointLight(plugin.point("position", position), intensity=color("intensity"))]
    if plugin.type == "directional":
        return [DirectionalLight(plugin.point("direction", forward), irradiance=color("irradiance"))]
    if plugin.type == "spot":
        cutoff = plugin.number("cutoff_angle", 20.0)
        texture = _texture(plugin, textures, "texture")
        spot = SpotLight(
            position,
            forward,
            intensity=color("intensity"),
            inner_degrees=plugin.number("beam_width", 0.75 * cutoff),
            outer_degrees=cutoff,
            falloff="linear",
            texture=_mirrored(texture, u=determinant(matrix[:3, :3]) > 0.0),
            up=_across(up, forward),
        )
        return [spot]
    texture = _texture(plugin, textures, "irradiance")
    scale = plugin.number("scale", 1.0)
    height, width = (1, 1) if texture is None else texture.pixels.shape[:2]
    vertical = vertical_degrees(plugin, width / height)
    projector = ProjectorLight(
        position,
        forward,
        vec3(up),
        texture=_mirrored(texture, v=True),  # v points down, as in a camera
        color=scale if texture is not None else vec3(scale * np.array(color("irradiance"))),
        fov_degrees=2.0 * math.degrees(math.atan(math.tan(0.5 * math.radians(vertical)) * width / height)),
    )
    return [projector]


def _texture(plugin: Plugin, textures: Textures, name: str) -> ImageTexture | None:
    """Return the image of a lamp, or None if there is none."""
    if plugin.named(name) is None:
        return None
    made = textures.color(plugin, name, 1.0)
    return made if isinstance(made, ImageTexture) else ImageTexture(np.full((1, 1, 3), made, np.float32))


def _image(plugin: Plugin) -> ImageEnvironment:
    file = plugin.file()
    pixels = _rows_between(read_image(file))
    axes, stretch = plugin.axes()
    if stretch[0] < 0.0:  # mirrored along x
        pixels = pixels[:, ::-1]
    axis, degrees = axis_and_degrees(product(axes, _TURNED))
    scale = plugin.number("scale", 1.0)
    plugin.ignore("mis_compensation")
    return ImageEnvironment(sealed(np.ascontiguousarray(pixels)), scale, degrees, file.name, axis)


def _mirrored(texture: ImageTexture | None, *, u: bool = False, v: bool = False) -> ImageTexture | None:
    """Return a texture with its coordinates u or v counted from the other end."""
    if texture is None or not (u or v):
        return texture
    signs = np.where([u, v], -1.0, 1.0)
    offset = product(texture.placement, np.array([float(u), float(v), 1.0]))
    return dataclasses.replace(texture, scale=tuple(signs * texture.scale), offset=tuple(offset.tolist()))


def _across(up: NDArray[np.float64], forward: Vec3) -> Vec3:
    """Return `up`, or another axis if that is parallel to `forward`."""
    if norm(np.cross(up, forward)) > 1e-6 * norm(up) * norm(forward):
        return vec3(up)
    return vec3(np.eye(3)[np.abs(forward).argmin()])


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
