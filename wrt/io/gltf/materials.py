"""Materials of glTF files.

Formats: Khronos Group 2021, "glTF 2.0 Specification", section 3.9, and EXTENSIONS. Ignored: the occlusion texture,
since a path tracer computes occlusion.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
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
from wrt.scene.materials import Material, Principled, Unlit
from wrt.scene.materials.dispersion import MOST as MOST_DISPERSION
from wrt.scene.materials.material import HIGHEST_FILM_INDEX, THICKEST_FILM
from wrt.scene.medium import Medium
from wrt.scene.textures import ColorSource, ImageTexture, NormalMap, VertexColor, shines

WHITE, BLACK = (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)

TEXTURED: dict[str, tuple[tuple[str, str, str, Any], ...]] = {
    "specular": (("specular", "specular", "a", 1.0), ("specular_color", "specularColor", "rgb", WHITE)),
    "transmission": (("transmission", "transmission", "r", 0.0),),
    "iridescence": (("film", "iridescence", "r", 0.0),),
    "clearcoat": (("coat", "clearcoat", "r", 0.0), ("coat_roughness", "clearcoatRoughness", "g", 0.0)),
    "sheen": (("sheen_color", "sheenColor", "rgb", BLACK), ("sheen_roughness", "sheenRoughness", "a", 0.0)),
}
"""Values of KHR_materials_... that are a factor times a texture. For each attribute of a Principled: the name before
"Factor" and "Texture" in the file, the channels of the texture, and the factor where the file gives none."""

EXTENSIONS = (
    *TEXTURED,
    *("anisotropy", "dispersion", "emissive_strength", "ior", "pbrSpecularGlossiness", "unlit", "volume"),
)
"""The extensions KHR_materials_... that are read."""

_USUAL_REFLECTANCE = 0.04
"""Of an index of 1.5, at normal incidence."""

_LEAST_TRANSMITTANCE = 1e-6
"""Of a medium; 0 would need infinite absorption."""


class Attributes(NamedTuple):
    """Which attributes the vertices of a mesh have, as far as they matter to its material.

    Attributes:
        uvs: texture coordinates; without them textures are left out.
        second_uvs: a second set of these.
        colors: colours, which multiply the base colour.
        alpha: an alpha that multiplies the opacity.
        tangents: tangents, which normal maps follow in place of the texture coordinates.
    """

    uvs: bool
    second_uvs: bool
    colors: bool
    alpha: bool
    tangents: bool


class _Description:
    """A material of a file's JSON, and what follows from it for every mesh."""

    def __init__(self, tree: Tree) -> None:
        self.tree = tree
        self.extensions: Tree = tree.get("extensions", {})
        self.pbr: Tree = tree.get("pbrMetallicRoughness", {})
        self.gloss: Tree | None = self.extensions.get("KHR_materials_pbrSpecularGlossiness")
        base, name = (self.pbr, "baseColor") if self.gloss is None else (self.gloss, "diffuse")
        *factor, self.alpha = (*base.get(f"{name}Factor", ()), 1.0, 1.0, 1.0, 1.0)[:4]
        self.base_factor = np.clip(np.asarray(factor, np.float64), 0.0, 1.0)
        self.base_texture: Tree | None = base.get(f"{name}Texture")
        self.has_alpha = tree.get("alphaMode", "OPAQUE") in ("MASK", "BLEND")  # section 3.9.4
        self.textures = _texture_references(tree)
        coat: Tree = self.extensions.get("KHR_materials_clearcoat", {})
        normals_of_coat: Tree | None = coat.get("clearcoatNormalTexture")
        self.coat_normal = normals_of_coat if coat.get("clearcoatFactor") else None
        # The normal texture, whose tangents follow its coordinates, has the first set.
        normal = tree.get("normalTexture") or self.coat_normal
        first = normal or self.pbr.get("baseColorTexture")
        by_rank = sorted(self.textures, key=lambda info: info is not first)
        self.uv_sets = list(dict.fromkeys(_uv_set(info) for info in by_rank))
        self.normal_placement = placement_of(normal or {})
        is_moved = self.normal_placement != placement_of({})
        if is_moved and len(self.uv_sets) == 1 and self.shared_placement is None:
            # The coordinates that it transforms are the first, and those in the file the second, for the others.
            self.uv_sets *= 2
            self.shared_placement = _matrix(self.normal_placement)

    @functools.cached_property
    def shared_placement(self) -> NDArray[np.float64] | None:
        """The (2, 3) placement of all textures that use the first coordinates, or None where they differ.

        It is applied to the mesh's coordinates, so that the tangents of normal maps follow it.
        """
        placements = [placement_of(info) for info in self.textures if [_uv_set(info)] != self.uv_sets[1:2]]
        if any(placement != placements[0] for placement in placements):
            return None
        return _matrix(placements[0]) if placements else np.eye(2, 3)


class GltfMaterials:
    """The materials of one file: each is made once per set of vertex attributes."""

    def __init__(self, path: Path, described: list[Tree], images: GltfImages) -> None:
        """Take the materials of a file's JSON; more may be appended to the list later."""
        self._path, self._described, self._images = path, described, images
        self._descriptions: dict[tuple[int, frozenset[int]], _Description] = {}
        self._made: dict[tuple[int, frozenset[int], Attributes], Material] = {}

    def uv_sets(self, number: int) -> list[int]:
        """Return the numbers of the texture coordinates that a material uses; 0 if it has no textures."""
        return self._description(number).uv_sets or [0]

    def dressed(self, part: Part, number: int, sets: Mapping[int, NDArray[Any]]) -> Part:
        """Return a part with a material, and with the colours and texture coordinates that the material needs.

        Args:
            part: the mesh without texture coordinates. Its colours, with or without alpha, are not yet multiplied by
                the base colour.
            number: the number of the material.
            sets: (N, 2) texture coordinates, v up, by the number of their set; others than `uv_sets` are not needed.
        """
        lacking = frozenset(self.uv_sets(number)).difference(sets) if sets else frozenset()
        for each in sorted(lacking):
            warn(f"{self._path}: there is no TEXCOORD_{each}, by which textures of material {number} lie")
        description = self._description(number, lacking)
        uv_sets = description.uv_sets or [0]
        if len(uv_sets) > 2:
            which = f"all but those of set {uv_sets[1]} are laid by set {uv_sets[0]}"
            warn(f"{self._path}: textures of material {number} lie by more than two sets of coordinates; {which}")
        uvs, second = ([sets.get(each) for each in uv_sets] + [None])[:2]
        colors, has_alpha = part.colors, False
        if colors is not None:
            alpha = colors[:, 3:]
            has_alpha = description.has_alpha and bool((alpha < 1.0).any())
            colors = colors[:, :3] * description.base_factor
            if has_alpha:
                colors = np.column_stack([colors, alpha])
        has_tangents = part.tangents is not None
        attributes = Attributes(uvs is not None, second is not None, colors is not None, has_alpha, has_tangents)
        key = number, lacking, attributes
        if key not in self._made:
            self._made[key] = _Reader(self._path, self._images, number, description, attributes).material()
            if isinstance(name := description.tree.get("name"), str):
                self._made[key] = self._made[key].named(name)
        material = self._made[key]
        if uvs is not None and (placement := description.shared_placement) is not None:
            uvs = product(np.asarray(uvs, np.float64), placement[:, :2].T) + placement[:, 2]
        if uvs is not None and second is not None:
            uvs = np.column_stack([uvs, second])
        double_sided = bool(description.tree.get("doubleSided", False))  # section 3.9.6
        two_sided = double_sided and shines(material.emission)
        part = replace(part, double_sided=double_sided, two_sided=two_sided)
        return replace(part, material=material, colors=colors, uvs=uvs)

    def _description(self, number: int, lacking: frozenset[int] = frozenset()) -> _Description:
        """Return the description of a material without its textures that lie by sets that a mesh lacks."""
        key = number, lacking
        if key not in self._descriptions:
            self._descriptions[key] = _Description(_without_textures(self._described[number], lacking))
        return self._descriptions[key]


class _Reader:
    """Reads one material for meshes with the given attributes."""

    def __init__(
        self, path: Path, images: GltfImages, number: int, description: _Description, attributes: Attributes
    ) -> None:
        self._path, self._images, self._name = path, images, f"material {number}"
        self._description, self._attributes = description, attributes
        self._normal: Tree | None = description.tree.get("normalTexture")
        self._placed = description.shared_placement is None  # textures then apply their own transforms

    def material(self) -> Material:
        description, attributes = self._description, self._attributes
        if not attributes.uvs and description.textures:
            which = "" if description.uv_sets == [0] else f" of set {description.uv_sets[0]}"
            warn(f"{self._path}: the textures of {self._name} are left out: its mesh has no texture coordinates{which}")
        opacity = self._opacity()
        base = self._color(description.base_texture, description.base_factor, colored=attributes.colors)
        if "KHR_materials_unlit" in description.extensions:
            return Unlit(base, opacity=opacity)
        values: dict[str, Any] = {"base_color": base, "opacity": opacity}
        if description.gloss is not None:
            values |= self._specular_glossiness(description.gloss)
        else:
            texture = description.pbr.get("metallicRoughnessTexture")
            for name, channel in (("metallic", "b"), ("roughness", "g")):
                values[name] = self._number(texture, channel, description.pbr.get(f"{name}Factor", 1.0))
        values |= self._extended()
        strength = self._extension("emissive_strength").get("emissiveStrength", 1.0)
        factor = np.asarray(description.tree.get("emissiveFactor", BLACK), np.float64) * strength
        if factor.any():
            values["emission"] = self._color(description.tree.get("emissiveTexture"), factor)
        if self._normal and attributes.uvs:
            if self._placed and description.normal_placement != placement_of({}):
                reason = "its textures lie by two sets of coordinates and unlike transforms"
                warn(f"{self._path}: the transform of the normal texture of {self._name} is left out: {reason}")
            values["normal_map"] = self._normal_map(self._normal, "normal texture")
        if values.get("coat") and description.coat_normal != self._normal:
            values["coat_normal_map"] = self._coat_normal_map()
        return Principled(**values)

    def _normal_map(self, info: Tree, what: str, **mapping: Any) -> NormalMap | None:
        pixels = self._images.pixels(info, "data")
        if pixels is None:
            return None
        if self._images.is_nearest(info):
            warn(f"{self._path}: the {what} of {self._name} is smoothed, although its sampler takes the nearest")
        label, wrap = self._images.label(info), self._images.wrap(info)
        return NormalMap(pixels, scale=info.get("scale", 1.0), name=label, wrap=wrap, **mapping)

    def _coat_normal_map(self) -> NormalMap | None:
        """Return the normals of a coat that has other ones than its base; flat where the file gives none."""
        description, info = self._description, self._description.coat_normal
        normals = None
        if info is not None and self._attributes.uvs:
            set_number, placement = _uv_set(info), placement_of(info)
            follows_tangents = set_number == description.uv_sets[0] and placement == description.normal_placement
            if follows_tangents and not self._placed:
                normals = self._normal_map(info, "coat's normal texture")
            else:
                if set_number != description.uv_sets[0]:
                    reason = "which the tangents of its normal texture follow"
                    warn(f"{self._path}: the clear coat of {self._name} has other coordinates than those {reason}")
                second = [set_number] == description.uv_sets[1:2]
                mapping = {f"uv_{name}": value for name, value in placement.items()} | {"uv_set": int(second)}
                normals = self._normal_map(info, "coat's normal texture", **mapping)
                if normals is not None and not self._attributes.tangents:
                    laid_by = np.eye(2, 3) if description.shared_placement is None else description.shared_placement
                    normals = _turned(normals, normals.placement[:, :2], laid_by[:, :2])
        if normals is None and self._normal is not None and self._attributes.uvs:
            return NormalMap(np.array([[[0.5, 0.5, 1.0]]], np.float32), name="no bumps")
        return normals

    def _opacity(self) -> ColorSource:
        """Return the opacity by alpha mode (section 3.9.4)."""
        description = self._description
        if not description.has_alpha:
            return 1.0
        factor, info, alpha = description.alpha, description.base_texture, self._attributes.alpha
        cutoff = description.tree.get("alphaCutoff", 0.5) if description.tree["alphaMode"] == "MASK" else None
        if self._attributes.uvs and self._images.has_alpha(info):
            texture = self._texture(info, "alpha", channel="r", factor=factor, cutoff=cutoff, vertex_alpha=alpha)
            if texture is not None:
                return texture
        if alpha:
            return VertexColor(factor, alpha=True, cutoff=cutoff)
        if cutoff is not None:
            return 1.0 if factor >= cutoff else 0.0
        return float(np.clip(factor, 0.0, 1.0))

    def _specular_glossiness(self, gloss: Tree) -> dict[str, Any]:
        """Return a dielectric of index 1.5 whose reflectance of 0.04 at normal incidence is tinted."""
        info = gloss.get("specularGlossinessTexture")
        tint = np.asarray(gloss.get("specularFactor", WHITE), np.float64) / _USUAL_REFLECTANCE
        factor = float(np.clip(gloss.get("glossinessFactor", 1.0), 0.0, 1.0))
        texture = self._texture(info, "alpha", channel="r")
        return {
            "metallic": 0.0,
            "roughness": 1.0 - factor if texture is None else replace(texture, pixels=1.0 - factor * texture.pixels),
            "specular_color": self._color(info, tint),
        }

    # --- Extensions --------------------------------------------------------------------------------

    def _extension(self, name: str) -> Tree:
        found: Tree = self._description.extensions.get(f"KHR_materials_{name}", {})
        return found

    def _extended(self) -> dict[str, Any]:
        """Return what extensions add to the metallic-roughness material."""
        values: dict[str, Any] = {}
        ior = self._extension("ior").get("ior", 1.5)
        is_full = ior == 0.0  # reflects all light at normal incidence, apart from its tint
        values["ior"] = 1.5 if is_full else ior
        for extension, rows in TEXTURED.items():
            found = self._extension(extension)
            for attribute, key, channels, default in rows if found or (is_full and extension == "specular") else ():
                factor, info = found.get(f"{key}Factor", default), found.get(f"{key}Texture")
                if channels == "rgb":
                    limit = 1.0 if attribute == "sheen_color" else math.inf
                    share = _USUAL_REFLECTANCE if is_full and attribute == "specular_color" else 1.0
                    values[attribute] = self._color(info, np.minimum(factor, limit) / share)
                else:
                    values[attribute] = self._number(info, channels, factor)
        if film := values.pop("film", None):
            values |= {"film": film, **self._film(self._extension("iridescence"))}
        if "transmission" in values:
            volume = self._extension("volume")
            values["thin_walled"] = volume.get("thicknessFactor", 0.0) == 0.0
            if not values["thin_walled"]:
                dispersion = self._extension("dispersion").get("dispersion", 0.0)
                values["dispersion"] = min(max(float(dispersion), 0.0), MOST_DISPERSION)
                values["interior"] = _interior(volume) if values["transmission"] else None
        if found := self._extension("anisotropy"):
            strength = float(found.get("anisotropyStrength", 0.0))
            info = found.get("anisotropyTexture") if strength else None
            texture = self._texture(info, "data", factor=(1.0, 1.0, strength))
            values["anisotropy"] = strength if texture is None else texture
            values["anisotropy_rotation"] = found.get("anisotropyRotation", 0.0)
        return values

    def _film(self, found: Tree) -> dict[str, Any]:
        """Return the index and the thickness of a film; green of its texture is 0 at the least thickness, else 1."""
        least, most = (
            float(np.clip(found.get(f"iridescenceThickness{end}", usual), 0.0, THICKEST_FILM))
            for end, usual in (("Minimum", 100.0), ("Maximum", 400.0))
        )
        # Drafts of the extension had capital letters.
        index = found.get("iridescenceIor") or found.get("iridescenceIOR") or 1.3
        thickness: ColorSource = most
        texture = self._texture(found.get("iridescenceThicknessTexture"), "data", channel="g")
        if texture is not None and max(least, most) > 0.0:
            factor = max(least, most)
            pixels = (least + (most - least) * texture.pixels) / np.float32(factor)
            thickness = replace(texture, pixels=pixels.astype(np.float32), factor=(factor,) * 3)
        return {"film_thickness": thickness, "film_ior": min(max(float(index), 1.0), HIGHEST_FILM_INDEX)}

    # --- Factors times textures --------------------------------------------------------------------

    def _texture(self, info: Tree | None, kind: str, **options: Any) -> ImageTexture | None:
        second = bool(info) and [_uv_set(info or {})] == self._description.uv_sets[1:2]
        if not (self._attributes.second_uvs if second else self._attributes.uvs):
            return None
        return self._images.texture(info, kind, placed=self._placed or second, uv_set=int(second), **options)

    def _color(self, info: Tree | None, factor: Any, *, colored: bool = False) -> ColorSource:
        """Return a colour; a `colored` mesh has its colours already multiplied by the factor."""
        factor = WHITE if colored else tuple(np.maximum(np.asarray(factor, np.float64)[:3], 0.0).tolist())
        texture = self._texture(info, "color", factor=factor, vertex_colors=colored)
        if texture is not None:
            return texture
        return VertexColor() if colored else factor

    def _number(self, info: Tree | None, channel: str, factor: Any) -> ColorSource:
        """Return a number from 0 to 1 whose texture is in one channel, "a" for alpha."""
        factor = float(np.clip(factor, 0.0, 1.0))
        kind, channel = ("alpha", "r") if channel == "a" else ("data", channel)
        texture = self._texture(info, kind, channel=channel, factor=factor) if factor > 0.0 else None
        return factor if texture is None else texture


def _interior(volume: Tree) -> Medium | None:
    """Return the medium that fills a body; a path tracer takes its thickness from the mesh."""
    distance = float(volume.get("attenuationDistance", math.inf))
    color = np.clip(np.asarray(volume.get("attenuationColor", WHITE), np.float64), _LEAST_TRANSMITTANCE, 1.0)
    if not math.isfinite(distance) or (color == 1.0).all():
        return None
    return Medium.from_color(tuple(color.tolist()), distance)


def _matrix(placement: Tree) -> NDArray[np.float64]:
    """Return the (2, 3) matrix of what `placement_of` returns."""
    return ImageTexture(np.zeros((1, 1, 3), np.float32), **placement).placement


def _turned(normals: NormalMap, placement: NDArray[np.float64], laid_by: NDArray[np.float64]) -> NormalMap:
    """Return a map whose x and y point along u and v of the mesh instead of those of the image.

    Args:
        normals: the map.
        placement: (2, 2) from the coordinates of the file to those of the image.
        laid_by: (2, 2) from the coordinates of the file to those of the mesh.
    """
    (a, b), (c, d) = placement.tolist()
    side = np.sign(a * d - b * c)
    x = product(laid_by, np.array([d, -c])) * side  # where u of the image grows
    if not x.any():
        return normals
    x = x / math.hypot(*x)
    y = np.array([-x[1], x[0]]) * side * np.sign(laid_by[0, 0] * laid_by[1, 1] - laid_by[0, 1] * laid_by[1, 0])
    if np.allclose([x, y], np.eye(2), atol=1e-12):
        return normals
    pixels = np.array(normals.pixels, np.float32)
    pixels[..., :2] = np.clip(0.5 + product(pixels[..., :2] - 0.5, np.array([x, y])), 0.0, 1.0)
    return replace(normals, pixels=pixels)


def _uv_set(info: Tree) -> int:
    """Return the number of the texture coordinates of a texture reference."""
    transform = info.get("extensions", {}).get("KHR_texture_transform", {})
    number: int = transform.get("texCoord", info.get("texCoord", 0))
    return number


def _without_textures(described: Any, uv_sets: frozenset[int]) -> Any:
    """Return a material's JSON without references to textures that lie by some sets of coordinates."""
    if not isinstance(described, dict) or not uv_sets:
        return described
    return {
        key: _without_textures(value, uv_sets)
        for key, value in described.items()
        if not (key.endswith("Texture") and isinstance(value, dict) and _uv_set(value) in uv_sets)
    }


def _texture_references(described: Any) -> list[Tree]:
    """Return all texture references in a material except for the occlusion."""
    found: list[Tree] = []
    if isinstance(described, dict):
        for key, value in described.items():
            if key.endswith("Texture") and isinstance(value, dict):
                if key != "occlusionTexture":
                    found.append(value)
            else:
                found += _texture_references(value)
    return found
