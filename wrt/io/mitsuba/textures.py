"""Read Mitsuba's textures: images, checkerboards, vertex colours, bump and normal maps.

The first row of an image is at v = 0 in Mitsuba, at v = 1 in wrt. Images are flipped and texture coordinates kept, so
that coordinate transforms and directions along v keep their meaning.
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.io.images import read_image
from wrt.io.measured.measurement import load_measurement
from wrt.io.mitsuba.plugin import Plugin
from wrt.io.mitsuba.spectra import COLOR_TAGS, color_of
from wrt.linalg import norm, weighted_sum
from wrt.scene.materials.measured import Measurement
from wrt.scene.textures import ColorSource, ImageTexture, NormalMap, VertexColor
from wrt.values import Vec3, sealed, vec3

LUMINANCE = np.array([0.212671, 0.715160, 0.072169]) / (0.212671 + 0.715160 + 0.072169)
"""Weights of linear Rec. 709 (ITU-R BT.709) in luminance, which Mitsuba takes where a colour stands for a number or a
height; their sum is 1."""


class Textures:
    """The textures of a scene; one element always gives the same object, and a file is read once."""

    def __init__(self) -> None:
        self._pixels: dict[tuple[Path, bool], NDArray[np.float32]] = {}
        self._measurements: dict[Path, Measurement] = {}
        self._textures: dict[tuple[Plugin, str], ColorSource] = {}

    def color(
        self, plugin: Plugin, name: str, default: float | Vec3, *, emits: bool = False, most: float = 1.0
    ) -> ColorSource:
        """Return a colour that may vary over the surface; constants above `most` are clipped with a warning."""
        color = self._source(plugin, name, "color", emits=emits)
        if not isinstance(color, tuple):
            return default if color is None else color
        if min(color) < 0.0:
            raise plugin.error(f"{name!r} must not be negative")
        if max(color) > 1.001 * most:  # rounding can take a spectrum of ones slightly above 1
            plugin.warn(f"{name!r} is clipped to {most:g}")
        return vec3(np.minimum(color, most))

    def constant(self, plugin: Plugin, name: str, default: float | Vec3, *, emits: bool = False) -> Vec3:
        """Return a colour that cannot vary; a texture is replaced by its mean, with a warning."""
        color = self.color(plugin, name, default, emits=emits, most=math.inf)
        if isinstance(color, (ImageTexture, VertexColor)):
            plugin.warn(f"{name!r} cannot vary here; its mean is used")
            mean = color.pixels.mean(axis=(0, 1)) * color.factor if isinstance(color, ImageTexture) else (0.5,) * 3
            return vec3(mean)
        return vec3(np.broadcast_to(np.asarray(color, np.float64), 3))

    def number(
        self, plugin: Plugin, name: str, default: float, *, least: float = 0.0, most: float = 1.0
    ) -> ColorSource:
        """Return a number that may vary, the luminance of a colour; constants are clipped to a range with a warning."""
        color = self._source(plugin, name, "number")
        if not isinstance(color, tuple):
            return default if color is None else color
        value = _luminance(color)
        if not least <= value <= most:
            plugin.warn(f"{name!r} is clipped to {least:g} up to {most:g}")
        return min(max(value, least), most)

    def _source(self, plugin: Plugin, name: str, use: str, *, emits: bool = False) -> ColorSource | Vec3 | None:
        """Return the texture or the constant colour of a parameter, or None if it is not given."""
        texture = plugin.named(name)
        if texture is not None:
            return self._texture(texture, use)
        element = plugin.value(name, *COLOR_TAGS)
        return None if element is None else color_of(element, plugin.document, emits=emits)

    def measurement(self, file: Path) -> Measurement:
        """Return a measured reflectance."""
        if file not in self._measurements:
            self._measurements[file] = load_measurement(file)
        return self._measurements[file]

    def normals(self, plugin: Plugin) -> NormalMap | None:
        """Return the map of a `normalmap` or `bumpmap`, or None if it cannot be used."""
        texture = next(plugin.of_kind("texture"), None)
        if texture is None:
            raise plugin.error("has no texture")
        image = self._texture(texture, "data")
        if not isinstance(image, ImageTexture):
            plugin.warn("only a bitmap can be a bump or normal map; left out")
            return None
        if not np.allclose(image.placement, np.eye(2, 3)):
            plugin.warn("'to_uv' of a bump or normal map is left out")
        flips, shadows = (plugin.boolean(name, True) for name in ("flip_invalid_normals", "use_shadowing_function"))
        if flips != shadows:
            plugin.warn("'flip_invalid_normals' and 'use_shadowing_function' must match; both are treated as true")
        options: dict[str, Any] = {
            "name": image.name,
            "wrap": image.wrap,
            "convention": "mitsuba" if flips or shadows else "right-handed",
        }
        if plugin.type == "normalmap":
            pixels = np.clip(image.pixels, 0.0, 1.0)
            below = pixels[..., 2:] < 0.5
            if below.any():
                plugin.warn("normals that point below the surface are clamped to it")
                pixels = np.where(below, np.maximum(pixels, (0.0, 0.0, 0.5)), pixels).astype(np.float32)
            return NormalMap(pixels, **options)
        heights = weighted_sum(image.pixels, LUMINANCE)  # metres, times `scale`
        most = max(float(heights.max()), 1.0)
        pixels = np.repeat(np.minimum(heights / np.float32(most), np.float32(1.0))[..., None], 3, axis=2)
        return NormalMap(pixels, plugin.number("scale", 1.0) * most, heights=True, **options)

    def _texture(self, texture: Plugin, use: str) -> ColorSource:
        """Return a texture as a "color", a "number" (its luminance), or "data" (its linear pixels)."""
        key = texture, use
        if key not in self._textures:
            made = self._made(texture, use)
            if use == "number" and isinstance(made, ImageTexture):
                grey = weighted_sum(made.pixels, LUMINANCE)
                made = dataclasses.replace(made, pixels=np.repeat(grey[..., None], 3, axis=2))
            self._textures[key] = made
        return self._textures[key]

    def _made(self, texture: Plugin, use: str) -> ColorSource:
        made: ColorSource
        if texture.type == "bitmap":
            made = self._bitmap(texture)
        elif texture.type == "checkerboard":
            made = self._checkerboard(texture, use)
        elif texture.type == "mesh_attribute":
            if not texture.text("name", "").startswith(("vertex_", "face_")):
                raise texture.error("its 'name' must begin with vertex_ or face_")
            made = VertexColor(texture.number("scale", 1.0))
        else:
            texture.warn("this kind of texture is not known; 0.5 stands in for it")
            made = (0.5, 0.5, 0.5)
        return made

    def _bitmap(self, texture: Plugin) -> ImageTexture:
        file = texture.file()
        # Mitsuba 0.x has a gamma of 1 in place of `raw`.
        raw = texture.boolean("raw", texture.number("gamma", 0.0) == 1.0)
        texture.ignore("format", "accel")
        if (file, raw) not in self._pixels:
            with texture.locating():
                pixels = read_image(file, linear=raw)
            if not np.isfinite(pixels).all() or (pixels < 0.0).any():
                texture.warn(f"{file.name} has negative or non-finite values; they are set to 0")
                pixels = np.maximum(np.nan_to_num(pixels, nan=0.0, posinf=0.0, neginf=0.0), 0.0)
            self._pixels[file, raw] = sealed(np.ascontiguousarray(pixels[::-1]))
        wrap = texture.choice("wrap_mode", "repeat", "mirror", "clamp")
        # Two filters are of version 0.6.
        kind = texture.choice("filter_type", "bilinear", "nearest", "trilinear", "ewa")
        kind = "trilinear" if kind == "ewa" else kind
        return _placed(texture, ImageTexture(self._pixels[file, raw], file.name, wrap=wrap, filter=kind))

    def _checkerboard(self, texture: Plugin, use: str) -> ImageTexture:
        """Return a checkerboard as an image of four texels, which is exact.

        Where a number is wanted, Mitsuba (up to 3.9) has the two colours the other way round.
        """
        first, second = (self.constant(texture, name, value) for name, value in (("color0", 0.4), ("color1", 0.2)))
        if use == "number":
            first, second = second, first
        pixels = np.array([[second, first], [first, second]], np.float32)
        return _placed(texture, ImageTexture(pixels, "checkerboard", filter="nearest"))


def _luminance(color: Vec3) -> float:
    """Return the luminance of a colour; a grey's is its value, without a rounding error."""
    red, green, blue = color
    if red == green == blue:
        return float(red)
    return float(weighted_sum(np.asarray(color, np.float64), LUMINANCE))


def _placed(texture: Plugin, image: ImageTexture) -> ImageTexture:
    """Return an image with the scale, rotation and offset of a texture's `to_uv`."""
    matrix = texture.transform("to_uv")[:2]
    # Mitsuba 0.x has four numbers in its place.
    scale = np.array([texture.number(name, 1.0) for name in ("uscale", "vscale")])
    shift = np.array([texture.number(name, 0.0) for name in ("uoffset", "voffset")])
    linear, offset = matrix[:, :2] * scale, matrix[:, 3] + shift
    if np.allclose(linear, np.eye(2)) and not offset.any():
        return image
    along_u = norm(linear[:, 0])
    if along_u == 0.0:
        raise texture.error("'to_uv' must not flatten u")
    c, s = linear[:, 0] / along_u
    along_v, slant = float(c * linear[1, 1] - s * linear[0, 1]), float(c * linear[0, 1] + s * linear[1, 1])
    if abs(slant) > 1e-4 * abs(along_v):
        texture.warn("'to_uv' has shear, which is left out")
    return dataclasses.replace(
        image,
        scale=(along_u, along_v),
        rotation_degrees=math.degrees(math.atan2(s, c)),
        offset=(float(offset[0]), float(offset[1])),
    )
