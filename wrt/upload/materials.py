"""Flatten material descriptions to the tables that kernels read."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.backend import current_backend
from wrt.backend.device import Device
from wrt.errors import InputError
from wrt.scene.materials import Material, Mix, TwoSided
from wrt.scene.textures import (
    CHANNELS,
    NORMAL_CONVENTIONS,
    VARYING,
    WRAPS,
    ColorSource,
    FirstAlike,
    ImageTexture,
    NormalMap,
    Texture,
    VertexColor,
)
from wrt.upload.arrays import packed
from wrt.upload.tables.material_tables import pack_tables
from wrt.upload.textures.pyramid import DerivedImages
from wrt.upload.textures.texels import Texels


class MaterialTable:
    """The distinct materials of a scene, with the parts of composite ones after them.

    Attributes:
        materials: the materials.
        of_shapes: (shapes,) number of each shape's material.
        transmits: (shapes,) whether light passes through the material of each shape, other than by its opacity.
        first_slots: the first slot of each material.
        emission_slots: slot of each emission that varies, otherwise −1.
        is_editable: whether each array of pixels has float32 texels of its own.
        editable_texels: number of texels of all images, mip levels and normal maps where it is.
        models: names of all reflection models, sorted.
        textured: whether any value is an image or a vertex colour.
        uv2_alpha: whether any texture uses second texture coordinates or the alpha of vertex colours.
        mipmapped: whether any image has mip levels, or a procedural texture is filtered.
        procedures: names of the models of all procedural textures, sorted.
        composite: which composite materials there are, as in Features.
        tangents: whether any material depends on the direction of texture coordinates, or has a normal map.
    """

    def __init__(
        self,
        materials: list[Material],
        emissions: Sequence[ColorSource] = (),
        *,
        editable: bool = False,
        before: MaterialTable | None = None,
        caustics: bool = False,
    ) -> None:
        """Flatten the shapes' materials, and emissions: those of the shapes, then the textures of lights.

        Args:
            materials: the materials.
            emissions: the emissions.
            editable: whether each array of pixels has float32 texels of its own, also where another is equal.
            before: the table of the same scene with other values, if it is uploaded already.
            caustics: whether nearly smooth materials throw caustics.

        Raises:
            InputError: when a material names an unknown reflection model, or does not fit its model.
        """
        self.materials: list[Material] = []
        self._numbers: dict[int, int] = {}
        self.of_shapes = [self._add(material) for material in materials]
        self.transmits = np.array([self._transmits(material) for material in materials])
        simple = [material for material in self.materials if not material.parts]
        self._caustics = caustics
        self.models = tuple(sorted({self._model_name(material) for material in simple}))
        values = [value for material in self.materials for value in (*material.slots, material.opacity)]
        varying = [value for value in (*values, *emissions) if _varies(value)]
        self.textured = bool(varying) or bool(vary_by_place(self.models))
        textures = [value for value in varying if isinstance(value, Texture)]
        self.procedures = tuple(sorted({procedure_name(texture) for texture in textures}))
        self.uv2_alpha = any(_needs_uv2_alpha(value) for value in varying)
        self.uv2_alpha |= any(normals.uv_set == 1 for material in simple for normals in material.normal_maps)
        self.mipmapped = any(isinstance(value, ImageTexture) and value.has_levels for value in varying)
        self.mipmapped |= bool(textures)
        self.composite = "none"
        if any(material.opacity != 1.0 for material in self.materials):
            self.composite = "holes"
        elif len(simple) < len(self.materials):
            mixed = any(isinstance(material, Mix) for material in self.materials)
            self.composite = "mixed" if mixed else "sides"
        self.tangents = any(material.needs_tangents or material.normal_maps for material in simple)
        k = current_backend().kernels("wrt.kernels.core.scene_data")
        self.is_editable = editable
        self._before = before
        self._keys: list[Any] = []
        self._tables: tuple[Any, dict[Any, int]] = (None, {})
        self._derived: DerivedImages = DerivedImages() if before is None else before._derived
        self._derived.begin()
        self._slots = _Slots(self._derived, alike=not editable)
        self._records = packed([self._record(material) for material in self.materials], k.MaterialRecord)
        self.first_slots: list[int] = self._records["first_slot"].tolist()
        self.emission_slots = [self._slots.add(emission) if _varies(emission) else -1 for emission in emissions]
        self.editable_texels = self._slots.editable_texels
        self._uploaded: dict[str, Any] = {}
        self._pixels = self._slots.pixels if editable else []
        if before is not None and self._has_pixels_of(before):
            self._texels: Texels = before._texels
            self._uploaded = before._uploaded
        else:
            self._texels = Texels(self._slots.pixels, coded=not editable)

    def _has_pixels_of(self, other: MaterialTable) -> bool:
        """Return whether this table and another, both editable, have the same arrays of pixels."""
        if not (self.is_editable and other.is_editable) or len(self._pixels) != len(other._pixels):
            return False
        return all(a is b for a, b in zip(self._pixels, other._pixels, strict=True))

    def number_of(self, material: Material) -> int:
        """Return the number of one of the materials or of their parts."""
        return self._numbers[id(material)]

    def _add(self, material: Material) -> int:
        """Return the number of a material, which is added if new."""
        if id(material) not in self._numbers:
            self._numbers[id(material)] = len(self.materials)
            self.materials.append(material)
            for part in material.parts:
                self._add(part)
        return self._numbers[id(material)]

    def _model_name(self, material: Material) -> str:
        name = model_name(material)
        return _bsdf("caster_name", name) if self._caustics and material.is_nearly_smooth else name

    def _transmits(self, material: Material) -> bool:
        """Return whether a material, or a part of it, has a reflection model that transmits light."""
        if material.parts:
            return any(self._transmits(part) for part in material.parts)
        return bool(_model_of(material).transmits)

    def _record(self, material: Material) -> dict[str, Any]:
        """Return the record of a material, still without its table, and add its values to the slots."""
        from wrt.kernels.core.registry import model_number

        k = current_backend().kernels("wrt.kernels.core.scene_data")
        for value in (*material.slots, material.opacity):
            if isinstance(value, Texture):
                self._slots.add_values(value)
        record: dict[str, Any] = {"first_slot": len(self._slots.rows)}
        for value in material.slots:
            self._slots.add(value)
        record["opacity_slot"] = -1 if material.opacity == 1.0 else self._slots.add(material.opacity)
        if material.parts:
            if not isinstance(material, (Mix, TwoSided)):
                raise InputError(f"{type(material).__name__}: only a Mix or a TwoSided can be made of other materials")
            record["kind"] = k.MATERIAL_MIX if isinstance(material, Mix) else k.MATERIAL_SIDES
            record["first"], record["second"] = (self._numbers[id(part)] for part in material.parts)
            return record
        model = _model_of(material)
        if len(material.slots) != model.slots:
            count = f"{type(material).__name__} gives {len(material.slots)} values"
            raise InputError(f"{count}, but {material.model} reads {model.slots}")
        record |= {
            "kind": k.MATERIAL_MODEL,
            "model": model_number(self._model_name(material)),
            "matt": model.matt,
            "normal_map": -1,
            "coat_normal_map": -1,
        }
        if material.normal_map is not None:
            filtered = material.normal_map.filter and model.widens
            record["normal_map"] = self._slots.add_normal_map(material.normal_map, filtered)
            along = k.NORMALS_FILTERED_ALONG_TEXTURE if material.needs_tangents else k.NORMALS_FILTERED
            record["normal_filter"] = along if filtered else k.NORMALS_AT_POINT
        if model.coat_slot >= 0:
            record["coat_normal_map"] = self._slots.add_normal_map(material.normal_maps[-1], filtered=False)
        return record

    @property
    def bytes(self) -> int:
        """Bytes that materials and images will take on a device, without the tables of reflection models."""
        k, slots = current_backend().kernels("wrt.kernels.core.scene_data"), self._slots
        tables = (slots.rows, k.ColorSlot), (slots.images, k.ImageRecord), (slots.normal_maps, k.NormalMapRecord)
        sizes = (len(rows) * int(np.dtype(struct.numpy_dtype()).itemsize) for rows, struct in tables)
        return self._records.nbytes + self._texels.bytes + sum(sizes)

    def upload(self, data: Any, device: Device) -> None:
        """Fill the tables of a SceneData struct: materials, slots, images, texels, normal maps, tables."""
        backend = current_backend()
        k, slots, texels = backend.kernels("wrt.kernels.core.scene_data"), self._slots, self._texels
        keys = [material.table_key for material in self.materials]
        if self._before is None or self._before._keys != keys:
            tables, places = pack_tables(keys, device)
            self._tables = backend.array(tables, float, device.name), places
        else:
            self._tables = self._before._tables
        self._keys, places = keys, self._tables[1]
        for record, material in zip(self._records, self.materials, strict=True):
            record["table"] = 0 if material.table_key is None else places[material.table_key]
        data.aligns_tangents = int(self.tangents)
        data.materials = backend.array(self._records, k.MaterialRecord, device.name)
        data.slots = backend.array(packed(slots.rows, k.ColorSlot), k.ColorSlot, device.name)
        data.tables = self._tables[0]
        if slots.images:
            data.images = backend.array(packed(slots.image_rows(texels), k.ImageRecord), k.ImageRecord, device.name)
            if not self._uploaded:
                self._uploaded = {
                    "texels": backend.array(texels.colors, "vec3", device.name),
                    "texel_codes": backend.array(texels.codes, "uint32", device.name),
                    "palettes": backend.array(np.ravel(texels.palettes), float, device.name),
                }
            for name, array in self._uploaded.items():
                setattr(data, name, array)
        if slots.normal_maps:
            normal_maps = packed(slots.normal_maps, k.NormalMapRecord)
            data.normal_maps = backend.array(normal_maps, k.NormalMapRecord, device.name)
        # Release the pixels.
        del self._slots
        self._before = None
        if not self.is_editable:
            self._texels.colors, self._texels.codes = self._texels.colors[:0], self._texels.codes[:0]
            self._derived, self._uploaded = DerivedImages(), {}


def _bsdf(function: str, *arguments: Any) -> Any:
    """Call a function of `kernels/bsdf`."""
    return current_backend().call("wrt.kernels.bsdf", function, *arguments)


def _model_of(material: Material) -> Any:
    """Return the reflection model of a material that is not made of others."""
    try:
        return _bsdf("model_of", model_name(material))
    except (KeyError, TypeError, ValueError):
        raise InputError(f"{type(material).__name__}: there is no reflection model {material.model!r}") from None


def model_name(material: Material) -> str:
    """Return the name of a material's model in kernels, current, and with its normal map filtered if it is."""
    name: str = _bsdf("current_name", material.model)
    if material.normal_map is not None and material.normal_map.filter:
        name = _bsdf("filtered_name", name)
    return name


def vary_by_place(models: tuple[str, ...]) -> tuple[str, ...]:
    """Return those reflection models that make their values from the place on the surface; no built-in one does."""
    from wrt.kernels.core.registry import from_outside

    return _bsdf("models_with", models, "at") if from_outside(models) else ()


def procedure_name(texture: Texture) -> str:
    """Return the name of a procedural texture's model in kernels.

    Raises:
        InputError: if its class is not registered.
    """
    procedures = "wrt.kernels.textures.procedures"
    try:
        name: str = current_backend().call(procedures, "current_name", texture.model)
        current_backend().call(procedures, "model_of", name)
    except KeyError:
        raise InputError(f"{type(texture).__name__}: there is no texture {texture.model!r}; register it") from None
    return name


def _varies(value: ColorSource) -> bool:
    return isinstance(value, VARYING)


def _needs_uv2_alpha(value: ColorSource) -> bool:
    if isinstance(value, ImageTexture):
        return value.vertex_alpha or value.uv_set == 1
    return isinstance(value, VertexColor) and value.alpha


def _texels_in(pixels: NDArray[np.float32]) -> int:
    return int(pixels.shape[0]) * int(pixels.shape[1])


class _Slots:
    """Rows of ColorSlot, ImageRecord and NormalMapRecord, and the pixels that they read."""

    def __init__(self, derived: DerivedImages, *, alike: bool) -> None:
        """Start without rows; `alike`: whether equal images share texels, not only one and the same array."""
        self.rows: list[tuple[Any, ...]] = []
        self.images: list[tuple[Any, ...]] = []
        self.pixels: list[NDArray[np.float32]] = []
        self.normal_maps: list[tuple[int, ...]] = []
        self._pixel_numbers: dict[int, int] = {}
        self._texels_of: dict[tuple[int, bool], int] = {}
        self._first_alike = FirstAlike() if alike else None
        self._derived = derived
        self._levels: dict[int, list[int]] = {}
        self._image_numbers: dict[tuple[Any, ...], int] = {}
        self._values_of: dict[int, int] = {}
        self._normal_map_numbers: dict[tuple[int, bool], int] = {}

    def add(self, value: ColorSource) -> int:
        """Append a value, and return its number."""
        k = current_backend().kernels("wrt.kernels.core.scene_data")
        image = channel = -1
        uv_set, colors = 0, k.VERTEX_COLOR_NONE
        factor, cutoff = np.broadcast_to(np.asarray(getattr(value, "factor", value), np.float64), 3), None
        if isinstance(value, (ImageTexture, VertexColor)):
            cutoff = value.cutoff
        if isinstance(value, ImageTexture):
            pixels = value.pixels if self._first_alike is None else self._first_alike(value.pixels)
            image, uv_set = self.add_image(pixels, value), value.uv_set
            if pixels is not value.pixels:
                self._count_copy(value, self._pixel_numbers[id(pixels)])
            channel = -1 if value.channel is None else CHANNELS.index(value.channel)
            if value.vertex_colors or value.vertex_alpha:
                colors = k.VERTEX_COLOR if value.vertex_colors else k.VERTEX_ALPHA
        elif isinstance(value, VertexColor):
            colors = k.VERTEX_ALPHA if value.alpha else k.VERTEX_COLOR
        elif isinstance(value, Texture):
            from wrt.kernels.core.registry import model_number

            image, uv_set = k.FIRST_PROCEDURE - self._values_of[id(value)], model_number(procedure_name(value))
        self.rows.append((factor, image, channel, int(colors), -1.0 if cutoff is None else cutoff, uv_set))
        return len(self.rows) - 1

    def add_values(self, texture: Texture) -> None:
        """Append what a procedural texture reads, in rows that only `add` names."""
        if id(texture) not in self._values_of:
            self._values_of[id(texture)] = len(self.rows)
            for value in texture.slots:
                self.add(value)

    @property
    def editable_texels(self) -> int:
        """Number of texels if none are shared between arrays."""
        return sum(map(_texels_in, self.pixels)) + sum(self._texels_of.values())

    def _count_copy(self, texture: ImageTexture, number: int) -> None:
        """Remember the texels of an image that shares those of an equal one, and of its mip levels."""
        self._texels_of[id(texture.pixels), False] = _texels_in(texture.pixels)
        if texture.has_levels:
            levels = (self.pixels[level] for level in self._levels[number])
            self._texels_of[id(texture.pixels), True] = sum(map(_texels_in, levels))

    def add_image(self, pixels: NDArray[np.float32], mapping: ImageTexture | NormalMap) -> int:
        """Return the number of the image record for pixels and their mapping; equal records share one."""
        number = self._add_pixels(pixels)
        nearest = isinstance(mapping, ImageTexture) and mapping.filter == "nearest"
        wraps = (WRAPS.index(wrap) for wrap in mapping.wrap)
        record = (number, *wraps, nearest, *(tuple(row) for row in mapping.placement.tolist()))
        levels: list[int] = []
        if isinstance(mapping, ImageTexture) and mapping.has_levels:
            if number not in self._levels:
                self._levels[number] = [self._add_pixels(level) for level in self._derived.levels(pixels)]
            levels = self._levels[number]
        key = (*record, len(levels))
        if key not in self._image_numbers:
            self._image_numbers[key] = len(self.images)
            self.images.append((*record, len(levels), len(self.images) + 1))
            self.images += [(level, *record[1:], 0, 0) for level in levels]
        return self._image_numbers[key]

    def _add_pixels(self, pixels: NDArray[np.float32]) -> int:
        """Return the number of an array of pixels."""
        number = self._pixel_numbers.setdefault(id(pixels), len(self.pixels))
        if number == len(self.pixels):
            self.pixels.append(pixels)
        return number

    def add_normal_map(self, normal_map: NormalMap, filtered: bool) -> int:
        """Add a normal map and the images for filtering it, and return its number."""
        key = (id(normal_map), filtered)
        if key not in self._normal_map_numbers:
            self._normal_map_numbers[key] = len(self.normal_maps)
            normals, *slopes = self._derived.of_normal_map(normal_map, filtered)
            first = self.add_image(normals, normal_map)
            for image in slopes:
                self.add_image(image, normal_map)
            convention = NORMAL_CONVENTIONS.index(normal_map.convention)
            kind = int(normal_map.heights), convention, normal_map.uv_set
            self.normal_maps.append((first, first + 1, (len(self.images) - first) // 2, *kind))
        return self._normal_map_numbers[key]

    def image_rows(self, texels: Texels) -> Iterator[tuple[Any, ...]]:
        """Yield the values of each image's record."""
        for number, *mapping in self.images:
            height, width = self.pixels[number].shape[:2]
            first, palette = texels.places[number]
            yield first, 3 * 256 * palette if palette >= 0 else -1, width, height, *mapping
