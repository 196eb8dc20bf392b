"""Read bump and normal maps, which wrt applies by Mitsuba's conventions."""

from __future__ import annotations

import dataclasses

import numpy as np

from wrt.io.mitsuba.materials.textures import LUMINANCE, Textures
from wrt.io.mitsuba.plugin import Plugin
from wrt.linalg import weighted_sum
from wrt.scene.materials import Material, Mix, TwoSided
from wrt.scene.textures import ImageTexture, NormalMap


def with_bumps(plugin: Plugin, material: Material, textures: Textures) -> Material:
    """Return a material with the normals of a `normalmap` or `bumpmap`, or unchanged if the map cannot be used."""
    texture = next(plugin.of_kind("texture"), None)
    if texture is None:
        raise plugin.error("has no texture")
    image = textures.data(texture)
    if image is None:
        plugin.warn("only a bitmap can be a bump or normal map; left out")
        return material
    if not np.allclose(image.placement, np.eye(2, 3)):
        plugin.warn("'to_uv' of a bump or normal map is left out")
    flips, shadows = (plugin.boolean(name, True) for name in ("flip_invalid_normals", "use_shadowing_function"))
    if flips != shadows:
        plugin.warn("'flip_invalid_normals' and 'use_shadowing_function' are taken as both true or both false; as true")
    convention = "mitsuba" if flips or shadows else "right-handed"
    if plugin.type == "normalmap":
        normals = _as_given(plugin, image, convention)
    else:
        normals = _of_heights(image, plugin.number("scale", 1.0), convention)
    return _with_normals(plugin, material, normals)


def _as_given(plugin: Plugin, image: ImageTexture, convention: str) -> NormalMap:
    pixels = np.clip(image.pixels, 0.0, 1.0)
    if (pixels[..., 2] < 0.5).any():
        plugin.warn("normals that point below the surface are clamped to it")
        pixels = np.where(pixels[..., 2:] < 0.5, np.maximum(pixels, (0.0, 0.0, 0.5)), pixels).astype(np.float32)
    return NormalMap(pixels, name=image.name, wrap=image.wrap, convention=convention)


def _of_heights(image: ImageTexture, scale: float, convention: str) -> NormalMap:
    """Return the normals of a surface displaced by the luminance of an image, in metres, times `scale`."""
    heights = weighted_sum(image.pixels, LUMINANCE)
    most = max(float(heights.max()), 1.0)
    pixels = np.repeat(np.minimum(heights / np.float32(most), np.float32(1.0))[..., None], 3, axis=2)
    return NormalMap(pixels, scale * most, name=image.name, wrap=image.wrap, heights=True, convention=convention)


def _with_normals(plugin: Plugin, material: Material, normals: NormalMap) -> Material:
    """Return a material with a normal map, set on each part of a compound material."""
    if isinstance(material, Mix):
        first, second = (_with_normals(plugin, part, normals) for part in material.parts)
        return dataclasses.replace(material, first=first, second=second)
    if isinstance(material, TwoSided):
        front, back = (_with_normals(plugin, part, normals) for part in material.parts)
        return dataclasses.replace(material, front=front, back=back)
    if material.normal_map is not None:
        plugin.warn("a bump or normal map within another is left out")
        return material
    return dataclasses.replace(material, normal_map=normals)
