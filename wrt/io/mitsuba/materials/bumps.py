"""Read bump and normal maps, which depend on the texture coordinates of the mesh."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wrt.io.mitsuba.materials.textures import Textures
from wrt.io.mitsuba.plugin import Plugin
from wrt.scene.materials import Material, Mix, TwoSided
from wrt.scene.mesh import Mesh
from wrt.scene.textures import ImageTexture, NormalMap


@dataclass(frozen=True)
class UvLayout:
    """The texture coordinates of a mesh, in summary.

    Attributes:
        mirrored: whether ∂p/∂u, ∂p/∂v and the normal form a left-handed frame.
        along_u, along_v: |∂p/∂u| and |∂p/∂v| in metres, the area-weighted mean over the mesh.
        even: whether these are constant to 1 % and the two directions perpendicular.
    """

    mirrored: bool = False
    along_u: float = 1.0
    along_v: float = 1.0
    even: bool = True


def uv_layout(mesh: Mesh) -> UvLayout:
    """Return the summary of a mesh; without texture coordinates, one unit is one metre."""
    if mesh.uvs is None:
        return UvLayout()
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(np.float64) for k in range(3))
    s, t, w = (mesh.uvs[mesh.faces[:, k]].astype(np.float64) for k in range(3))
    e, f, g, h = b - a, c - a, t - s, w - s
    determinant = g[:, 0] * h[:, 1] - g[:, 1] * h[:, 0]
    area = np.linalg.norm(np.cross(e, f), axis=1)
    usable = (np.abs(determinant) > 1e-30) & (area > 0.0)
    if not usable.any():
        return UvLayout()
    e, f, g, h, determinant, area = (x[usable] for x in (e, f, g, h, determinant, area))
    by_u = (e * h[:, 1:] - f * g[:, 1:]) / determinant[:, None]
    by_v = (f * g[:, :1] - e * h[:, :1]) / determinant[:, None]
    lengths = np.stack([np.linalg.norm(by_u, axis=1), np.linalg.norm(by_v, axis=1)])
    means = lengths @ area / area.sum()
    straight = np.abs(np.einsum("ij,ij->i", by_u, by_v)) < 0.01 * lengths[0] * lengths[1]
    mirrored = determinant < 0.0
    even = bool(straight.all() and (np.abs(lengths / means[:, None] - 1.0) < 0.01).all())
    share = float(area[mirrored].sum() / area.sum())
    return UvLayout(share > 0.5, float(means[0]), float(means[1]), even and share in (0.0, 1.0))


def with_bumps(plugin: Plugin, material: Material, layout: UvLayout, textures: Textures) -> Material:
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
    if plugin.type == "normalmap":
        if plugin.boolean("flip_invalid_normals", True) or plugin.boolean("use_shadowing_function", True):
            plugin.warn(
                "wrt handles normals that face away from the viewer in its own way, not by flip_invalid_normals or "
                "use_shadowing_function"
            )
        if layout.mirrored and not layout.even:
            plugin.warn("texture coordinates are mirrored on a part of the mesh, where normals tilt the wrong way")
        normals = _as_given(plugin, image, layout.mirrored)
    else:
        if not layout.even:
            plugin.warn("texture coordinates are stretched unevenly over the mesh; bumps use the mean")
        normals = _of_heights(image, plugin.number("scale", 1.0), layout)
    return _with_normals(plugin, material, normals)


def _as_given(plugin: Plugin, image: ImageTexture, mirrored: bool) -> NormalMap:
    pixels = np.clip(image.pixels, 0.0, 1.0)
    if (pixels[..., 2] < 0.5).any():
        plugin.warn("normals that point below the surface are clamped to it")
        pixels = np.where(pixels[..., 2:] < 0.5, np.maximum(pixels, (0.0, 0.0, 0.5)), pixels).astype(np.float32)
    if mirrored:
        # Mitsuba's y is the cross product of the normal and x; wrt's points along growing v.
        pixels = pixels.copy()
        pixels[..., 1] = 1.0 - pixels[..., 1]
    return NormalMap(pixels, name=image.name, wrap=image.wrap)


def _of_heights(image: ImageTexture, scale: float, layout: UvLayout) -> NormalMap:
    """Return the normals of a surface displaced by the luminance of an image, in metres, times `scale`."""
    heights = scale * (image.pixels.astype(np.float64) @ (0.212671, 0.715160, 0.072169))
    rows, columns = heights.shape

    def slope(axis: int, wrap: str) -> NDArray[np.float64]:
        mode = {"repeat": "wrap", "mirror": "symmetric", "clamp": "edge"}[wrap]
        width = [(1, 1) if k == axis else (0, 0) for k in range(2)]
        padded = np.pad(heights, width, mode=mode)  # type: ignore[call-overload]
        return np.asarray(0.5 * (np.roll(padded, -1, axis) - np.roll(padded, 1, axis)))

    wrap_u, wrap_v = image.wrap
    x = -slope(1, wrap_u)[:, 1:-1] * columns / layout.along_u
    # Rows run down, v runs up.
    y = slope(0, wrap_v)[1:-1] * rows / layout.along_v
    normals = np.stack([x, y, np.ones_like(x)], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return NormalMap((0.5 * normals + 0.5).astype(np.float32), name=image.name, wrap=image.wrap)


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
