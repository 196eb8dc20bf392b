"""Materials of glTF files.

Formats: Khronos Group 2021, "glTF 2.0 Specification", section 3.9, and the extensions KHR_materials_anisotropy,
_clearcoat, _dispersion, _emissive_strength, _ior, _iridescence, _pbrSpecularGlossiness, _sheen, _specular,
_transmission, _unlit and _volume. Ignored: the occlusion texture, since a path tracer computes occlusion, and backface
culling.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrt.errors import warn
from wrt.io.gltf.buffers import Tree
from wrt.io.gltf.images import GltfImages, placement_of
from wrt.io.mesh.parts import Part
from wrt.linalg import product
from wrt.scene.materials import Emissive, Material, Principled
from wrt.scene.materials.dispersion import MOST as MOST_DISPERSION
from wrt.scene.materials.material import HIGHEST_FILM_INDEX, THICKEST_FILM
from wrt.scene.medium import Medium
from wrt.scene.textures import ColorSource, ImageTexture, NormalMap, VertexColor, shines

_LEAST_LEFT = 1e-6
"""Least transmittance of a medium; 0 would need infinite absorption."""

_NOT_SUPPORTED = {
    "KHR_materials_diffuse_transmission": "diffuse transmission",
}


class Attributes(NamedTuple):
    """The vertex attributes of a mesh that matter to its material.

    Attributes:
        laid: whether there are texture coordinates; otherwise textures are left out.
        second: whether there is a second set.
        colored: whether there are colours, which multiply the base colour.
        alpha: whether their alpha multiplies the opacity.
    """

    laid: bool
    second: bool
    colored: bool
    alpha: bool


class GltfMaterials:
    """The materials of one file: each is made once per set of vertex attributes."""

    def __init__(self, path: Path, described: list[Tree], images: GltfImages) -> None:
        """Take the materials of a file's JSON."""
        self._path, self._described, self._images = path, described, images
        self._made: dict[tuple[int, Attributes], Material] = {}

    def material(self, number: int, attributes: Attributes) -> Material:
        """Return a material, by its number, for meshes with the given attributes."""
        key = number, attributes
        if key not in self._made:
            self._made[key] = self._make(number, attributes)
        return self._made[key]

    def dressed(self, part: Part, number: int, second: NDArray[Any] | None = None) -> Part:
        """Return a part with a material, and with the colours and texture coordinates that the material needs.

        Args:
            part: the mesh. Its first texture coordinates have v up; its colours, with or without alpha, are not yet
                multiplied by the base colour.
            number: the number of the material.
            second: (N, 2) a second set of coordinates, whose v points down, as in the file.
        """
        colors, alpha, uvs = None, None, part.uvs
        if part.colors is not None:
            colors, alpha = part.colors[:, :3], part.colors[:, 3:]
            if not (self.has_alpha(number) and (alpha < 1.0).any()):
                alpha = None
        if uvs is None or second is None or np.shape(second) != np.shape(uvs):
            second = None
        attributes = Attributes(uvs is not None, second is not None, colors is not None, alpha is not None)
        material = self.material(number, attributes)
        if colors is not None:
            colors = colors * self.base_factor(number)
            if alpha is not None:
                colors = np.column_stack([colors, alpha])
        placement = self.shared_placement(number)
        if uvs is not None and placement is not None:
            uvs = product(np.asarray(uvs, np.float64), placement[:, :2].T) + placement[:, 2]
        if uvs is not None and second is not None:
            uvs = np.column_stack([uvs, second * (1.0, -1.0) + (0.0, 1.0)])
        two_sided = self.shines_on_both_sides(number, material)
        return replace(part, material=material, two_sided=two_sided, colors=colors, uvs=uvs)

    def coordinate_sets(self, number: int) -> list[int]:
        """Return the numbers of the texture coordinates of a material; 0 if it has no textures."""
        return coordinate_sets(self._described[number]) or [0]

    def has_alpha(self, number: int) -> bool:
        """Return whether alpha counts in a material (section 3.9.4)."""
        return self._described[number].get("alphaMode", "OPAQUE") in ("MASK", "BLEND")

    def shines_on_both_sides(self, number: int, material: Material) -> bool:
        """Return whether a material gives off light, and as much on its back (section 3.9.6)."""
        return bool(self._described[number].get("doubleSided", False)) and shines(material.emission)

    def base_factor(self, number: int) -> NDArray[np.float64]:
        """Return (3,) what multiplies the base colour."""
        described = self._described[number]
        gloss = described.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness")
        source = described.get("pbrMetallicRoughness", {}) if gloss is None else gloss
        factor = source.get("baseColorFactor" if gloss is None else "diffuseFactor", (1.0, 1.0, 1.0))
        return np.clip(np.asarray(factor, np.float64)[:3], 0.0, 1.0)

    def shared_placement(self, number: int) -> NDArray[np.float64] | None:
        """Return the (2, 3) placement of all textures by a material's first coordinates, or None where they differ.

        It is for the mesh's coordinates then, so that tangents of normal maps follow it too.
        """
        described = self._described[number]
        second = coordinate_sets(described)[1:2]
        references = [info for info in texture_references(described) if [coordinate_set(info)] != second]
        placements = [placement_of(info) for info in references]
        if any(placement != placements[0] for placement in placements):
            return None
        return ImageTexture(np.zeros((1, 1, 3), np.float32), **placements[0]).placement if placements else np.eye(2, 3)

    def _make(self, number: int, attributes: Attributes) -> Material:
        described, name = self._described[number], f"material {number}"
        extensions = described.get("extensions", {})
        placed = self.shared_placement(number) is None
        for key, words in _NOT_SUPPORTED.items():
            if key in extensions:
                warn(f"{self._path}: {words} of {name} is left out")
        if not (attributes.laid or attributes.second) and texture_references(described):
            warn(f"{self._path}: the textures of {name} are left out: its mesh has no texture coordinates")
        read = _Reader(self._images, attributes, coordinate_sets(described), placed)
        values: dict[str, Any] = {"opacity": self._opacity(number, read)}
        colored = attributes.colored
        if "KHR_materials_unlit" in extensions:
            # It looks the same under any light if it gives off what it is to show, and reflects nothing.
            pbr = described.get("pbrMetallicRoughness", {})
            radiance = read.color(pbr.get("baseColorTexture"), self.base_factor(number), colored)
            return Emissive(radiance, opacity=values["opacity"])
        gloss = extensions.get("KHR_materials_pbrSpecularGlossiness")
        if gloss is not None:
            values |= _specular_glossiness(gloss, read)
            values["base_color"] = read.color(gloss.get("diffuseTexture"), self.base_factor(number), colored)
        else:
            pbr = described.get("pbrMetallicRoughness", {})
            orm = pbr.get("metallicRoughnessTexture")
            values |= {
                "base_color": read.color(pbr.get("baseColorTexture"), self.base_factor(number), colored),
                "metallic": read.number(orm, "b", pbr.get("metallicFactor", 1.0)),
                "roughness": read.number(orm, "g", pbr.get("roughnessFactor", 1.0)),
            }
        values |= _extended(extensions, read)
        strength = extensions.get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1.0)
        factor = np.asarray(described.get("emissiveFactor", (0.0, 0.0, 0.0)), np.float64) * strength
        if factor.any():
            values["emission"] = read.color(described.get("emissiveTexture"), factor)
        normal = described.get("normalTexture")
        if normal and attributes.laid:
            pixels = self._images.pixels(normal, "data")
            if placed and placement_of(normal) != placement_of({}):
                warn(f"{self._path}: the transform of the normal texture of {name} is left out")
            if pixels is not None:
                values["normal_map"] = NormalMap(
                    pixels,
                    scale=normal.get("scale", 1.0),
                    name=self._images.label(normal),
                    wrap=self._images.wrap(normal),
                )
        return Principled(**values)

    def _opacity(self, number: int, read: _Reader) -> ColorSource:
        """Return what of the surface is there, by alpha mode (section 3.9.4)."""
        if not self.has_alpha(number):
            return 1.0
        described = self._described[number]
        pbr = described.get("pbrMetallicRoughness", {})
        factor, info = (tuple(pbr.get("baseColorFactor", ())) + (1.0, 1.0, 1.0, 1.0))[3], pbr.get("baseColorTexture")
        gloss = described.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness")
        if gloss is not None:
            factor, info = tuple(gloss.get("diffuseFactor", (1.0,) * 4))[3], gloss.get("diffuseTexture")
        cutoff = described.get("alphaCutoff", 0.5) if described["alphaMode"] == "MASK" else None
        alpha = read.attributes.alpha
        if read.attributes.laid and self._images.has_alpha(info):
            texture = read.texture(info, "alpha", channel="r", factor=factor, cutoff=cutoff, vertex_alpha=alpha)
            if texture is not None:
                return texture
        if alpha:
            return VertexColor(factor, alpha=True, cutoff=cutoff)
        if cutoff is not None:
            return 1.0 if factor >= cutoff else 0.0
        return float(np.clip(factor, 0.0, 1.0))


class _Reader:
    """Factors times textures, as one value."""

    def __init__(self, images: GltfImages, attributes: Attributes, sets: list[int], placed: bool) -> None:
        self.images, self.attributes, self.placed = images, attributes, placed
        self.second = sets[1:2]

    def texture(self, info: Tree | None, kind: str, **options: Any) -> ImageTexture | None:
        second = bool(info) and [coordinate_set(info or {})] == self.second
        if not (self.attributes.second if second else self.attributes.laid):
            return None
        return self.images.texture(info, kind, placed=self.placed or second, uv_set=int(second), **options)

    def color(self, info: Tree | None, factor: Any, colored: bool = False) -> ColorSource:
        """Return a colour; the reader has multiplied the mesh's own by the factor already."""
        factor = (1.0, 1.0, 1.0) if colored else tuple(np.maximum(np.asarray(factor, np.float64)[:3], 0.0).tolist())
        texture = self.texture(info, "color", factor=factor, vertex_colors=colored)
        if texture is not None:
            return texture
        return VertexColor() if colored else factor

    def number(self, info: Tree | None, channel: str, factor: Any) -> ColorSource:
        """Return a number from 0 to 1 that lies in one channel, "a" for alpha."""
        factor = float(np.clip(factor, 0.0, 1.0))
        kind, channel = ("alpha", "r") if channel == "a" else ("data", channel)
        texture = self.texture(info, kind, channel=channel, factor=factor) if factor > 0.0 else None
        return factor if texture is None else texture


def _extended(extensions: Tree, read: _Reader) -> dict[str, Any]:
    """Return what extensions add to the metallic-roughness material."""
    values: dict[str, Any] = {}
    if "ior" in (found := extensions.get("KHR_materials_ior", {})):
        values["ior"] = found["ior"]
    if found := extensions.get("KHR_materials_specular", {}):
        values["specular"] = read.number(found.get("specularTexture"), "a", found.get("specularFactor", 1.0))
        tint = found.get("specularColorFactor", (1.0, 1.0, 1.0))
        values["specular_color"] = read.color(found.get("specularColorTexture"), tint)
    if found := extensions.get("KHR_materials_transmission", {}):
        share = found.get("transmissionFactor", 0.0)
        values["transmission"] = read.number(found.get("transmissionTexture"), "r", share)
        volume = extensions.get("KHR_materials_volume", {})
        values["thin_walled"] = volume.get("thicknessFactor", 0.0) == 0.0
        if not values["thin_walled"] and share > 0.0:
            values["interior"] = _interior(volume)
        if not values["thin_walled"]:
            dispersion = extensions.get("KHR_materials_dispersion", {}).get("dispersion", 0.0)
            values["dispersion"] = min(max(float(dispersion), 0.0), MOST_DISPERSION)
    if found := extensions.get("KHR_materials_clearcoat", {}):
        values["coat"] = read.number(found.get("clearcoatTexture"), "r", found.get("clearcoatFactor", 0.0))
        values["coat_roughness"] = read.number(
            found.get("clearcoatRoughnessTexture"), "g", found.get("clearcoatRoughnessFactor", 0.0)
        )
    if found := extensions.get("KHR_materials_sheen", {}):
        tint = found.get("sheenColorFactor", (0.0, 0.0, 0.0))
        if any(tint):
            values["sheen_color"] = read.color(found.get("sheenColorTexture"), np.minimum(tint, 1.0))
            values["sheen_roughness"] = read.number(
                found.get("sheenRoughnessTexture"), "a", found.get("sheenRoughnessFactor", 0.0)
            )
    values |= _film(extensions.get("KHR_materials_iridescence", {}), read)
    if found := extensions.get("KHR_materials_anisotropy", {}):
        strength = float(found.get("anisotropyStrength", 0.0))
        texture = (
            read.texture(found.get("anisotropyTexture"), "data", factor=(1.0, 1.0, strength)) if strength else None
        )
        values["anisotropy"] = strength if texture is None else texture
        values["anisotropy_rotation"] = found.get("anisotropyRotation", 0.0)
    return values


def _film(found: Tree, read: _Reader) -> dict[str, Any]:
    """Return a film; the green of its texture leads from the least thickness to the greatest."""
    if not found.get("iridescenceFactor", 0.0) > 0.0:
        return {}
    least, most = (
        float(np.clip(found.get(f"iridescenceThickness{end}", usual), 0.0, THICKEST_FILM))
        for end, usual in (("Minimum", 100.0), ("Maximum", 400.0))
    )
    # Drafts of the extension had capital letters.
    index = found.get("iridescenceIor") or found.get("iridescenceIOR") or 1.3
    thickness: ColorSource = most
    texture = read.texture(found.get("iridescenceThicknessTexture"), "data", channel="g")
    if texture is not None and max(least, most) > 0.0:
        factor = max(least, most)
        pixels = (least + (most - least) * texture.pixels) / np.float32(factor)
        thickness = replace(texture, pixels=pixels.astype(np.float32), factor=(factor,) * 3)
    return {
        "film": read.number(found.get("iridescenceTexture"), "r", found["iridescenceFactor"]),
        "film_thickness": thickness,
        "film_ior": min(max(float(index), 1.0), HIGHEST_FILM_INDEX),
    }


def _interior(volume: Tree) -> Medium | None:
    """Return what a body is filled with; its thickness is that of the mesh."""
    distance = float(volume.get("attenuationDistance", math.inf))
    color = np.clip(np.asarray(volume.get("attenuationColor", (1.0, 1.0, 1.0)), np.float64), _LEAST_LEFT, 1.0)
    if not math.isfinite(distance) or (color == 1.0).all():
        return None
    return Medium.from_color(tuple(color.tolist()), distance)


def _specular_glossiness(gloss: Tree, read: _Reader) -> dict[str, Any]:
    """Return the same as a dielectric of index 1.5 whose reflectance of 0.04, straight on, is tinted."""
    info = gloss.get("specularGlossinessTexture")
    tint = np.asarray(gloss.get("specularFactor", (1.0, 1.0, 1.0)), np.float64) / 0.04
    factor = float(np.clip(gloss.get("glossinessFactor", 1.0), 0.0, 1.0))
    texture = read.texture(info, "alpha", channel="r")
    return {
        "metallic": 0.0,
        "roughness": 1.0 - factor if texture is None else replace(texture, pixels=1.0 - factor * texture.pixels),
        "specular_color": read.color(info, tint),
    }


def coordinate_sets(described: Tree) -> list[int]:
    """Return the numbers of the texture coordinates that a material's textures name.

    First those of the normal texture, whose tangents follow them, or else of the base colour.
    """
    base = described.get("pbrMetallicRoughness", {}).get("baseColorTexture")
    first = described.get("normalTexture") or base
    references = sorted(texture_references(described), key=lambda info: info is not first)
    return list(dict.fromkeys(coordinate_set(info) for info in references))


def coordinate_set(info: Tree) -> int:
    """Return the number of the coordinates by which a texture lies."""
    transform = info.get("extensions", {}).get("KHR_texture_transform", {})
    number: int = transform.get("texCoord", info.get("texCoord", 0))
    return number


def texture_references(described: Any) -> list[Tree]:
    """Return all texture references in a material but that of the occlusion."""
    found: list[Tree] = []
    if isinstance(described, dict):
        for key, value in described.items():
            if key.endswith("Texture") and isinstance(value, dict):
                if key != "occlusionTexture":
                    found.append(value)
            else:
                found += texture_references(value)
    return found
