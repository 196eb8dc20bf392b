"""Flatten material descriptions to the tables that kernels read."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
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
    WRAPS,
    ColorSource,
    FirstAlike,
    ImageTexture,
    NormalMap,
    VertexColor,
)
from wrt.upload.arrays import packed
from wrt.upload.tables.material_tables import pack_tables
from wrt.upload.textures.pyramid import normals_of, pyramid, slope_pyramid
from wrt.upload.textures.texels import Texels


@dataclass
class MaterialTable:
    """The distinct materials of a scene, with the parts of composite ones after them.

    Attributes:
        materials: the materials.
        numbers: index in `materials` by identity.
        of_shapes: (shapes,) number of each shape's material.
        emissions: emission of each shape, then the textures of lights.
        emission_slots: slot of each that varies, otherwise −1; known after the upload.
        models: names of all reflection models, sorted.
        textured: whether any value is an image or a vertex colour.
        uv2_alpha: whether any texture uses second texture coordinates or the alpha of vertex colours.
        opacity: whether any material has holes.
        composite: which composite materials there are, as in Features.
        mipmapped: whether any image has mip levels.
        tangents: whether any material depends on the direction of texture coordinates, or has a normal map.
    """

    materials: list[Material] = field(default_factory=list)
    numbers: dict[int, int] = field(default_factory=dict)
    of_shapes: list[int] = field(default_factory=list)
    emissions: list[ColorSource] = field(default_factory=list)
    emission_slots: list[int] = field(default_factory=list)
    models: tuple[str, ...] = ()
    textured: bool = False
    uv2_alpha: bool = False
    opacity: bool = False
    composite: str = "none"
    tangents: bool = False
    mipmapped: bool = False
    _made: tuple[_Slots, NDArray[Any], Texels] | None = None

    def add(self, material: Material) -> int:
        """Return the number of a material, which is added if new."""
        if id(material) not in self.numbers:
            self.numbers[id(material)] = len(self.materials)
            self.materials.append(material)
            for part in material.parts:
                self.add(part)
        return self.numbers[id(material)]

    @property
    def bytes(self) -> int:
        """Bytes that materials and images will take on a device, without the tables of reflection models."""
        k = current_backend().kernels("wrt.kernels.core.scene_data")
        slots, records, texels = self._prepared()
        tables = (slots.rows, k.ColorSlot), (slots.images, k.ImageRecord), (slots.normal_maps, k.NormalMapRecord)
        sizes = (len(rows) * int(np.dtype(struct.numpy_dtype()).itemsize) for rows, struct in tables)
        return records.nbytes + texels.bytes + sum(sizes)

    def _prepared(self) -> tuple[_Slots, NDArray[Any], Texels]:
        """Return all values, records still without tables, and the texels of all images; made once."""
        if self._made is None:
            k = current_backend().kernels("wrt.kernels.core.scene_data")
            slots, records = _Slots(), np.zeros(len(self.materials), k.MaterialRecord.numpy_dtype())
            for record, material in zip(records, self.materials, strict=True):
                self._describe(record, material, slots)
            self.emission_slots = [slots.add(emission) if _varies(emission) else -1 for emission in self.emissions]
            self._made = slots, records, Texels(slots.pixels)
        return self._made

    def upload(self, data: Any, device: Device) -> None:
        """Fill the tables of a SceneData struct: materials, slots, images, texels, normal maps, tables."""
        backend = current_backend()
        k = backend.kernels("wrt.kernels.core.scene_data")

        slots, records, texels = self._prepared()
        tables, places = pack_tables([material.table_key for material in self.materials], device)
        for record, material in zip(records, self.materials, strict=True):
            record["table"] = 0 if material.table_key is None else places[material.table_key]
        data.aligns_tangents = int(self.tangents)
        data.materials = backend.array(records, k.MaterialRecord, device.name)
        data.slots = backend.array(packed(slots.rows, k.ColorSlot), k.ColorSlot, device.name)
        data.tables = backend.array(tables, float, device.name)
        if slots.images:
            data.images = backend.array(packed(slots.image_rows(texels), k.ImageRecord), k.ImageRecord, device.name)
            data.texels = backend.array(texels.colors, "vec3", device.name)
            data.texel_codes = backend.array(texels.codes, "uint32", device.name)
            data.palettes = backend.array(np.ravel(texels.palettes), float, device.name)
        if slots.normal_maps:
            normal_maps = packed(slots.normal_maps, k.NormalMapRecord)
            data.normal_maps = backend.array(normal_maps, k.NormalMapRecord, device.name)
        self._made = None  # release the pixels

    def _describe(self, record: Any, material: Material, slots: _Slots) -> None:
        from wrt.kernels.core.registry import model_number

        k = current_backend().kernels("wrt.kernels.core.scene_data")
        record["first_slot"] = len(slots.rows)
        for value in material.slots:
            slots.add(value)
        record["opacity_slot"] = -1 if material.opacity == 1.0 else slots.add(material.opacity)
        if material.parts:
            if not isinstance(material, (Mix, TwoSided)):
                raise InputError(f"{type(material).__name__}: only a Mix or a TwoSided can be made of other materials")
            record["kind"] = k.MATERIAL_MIX if isinstance(material, Mix) else k.MATERIAL_SIDES
            record["first"], record["second"] = (self.numbers[id(part)] for part in material.parts)
            return
        name = model_name(material)
        model = _bsdf("model_of", name)
        if len(material.slots) != model.slots:
            count = f"{type(material).__name__} gives {len(material.slots)} values"
            raise InputError(f"{count}, but {material.model} reads {model.slots}")
        record["kind"] = k.MATERIAL_MODEL
        record["model"] = model_number(name)
        record["matt"] = model.matt
        record["normal_map"] = -1
        if material.normal_map is not None:
            filtered = material.normal_map.filter and model.widens
            record["normal_map"] = slots.add_normal_map(material.normal_map, filtered)
            along = k.NORMALS_FILTERED_ALONG_TEXTURE if material.needs_tangents else k.NORMALS_FILTERED
            record["normal_filter"] = along if filtered else k.NORMALS_AT_POINT


def _bsdf(function: str, *arguments: Any) -> Any:
    """Call a function of `kernels/bsdf`."""
    return current_backend().call("wrt.kernels.bsdf", function, *arguments)


def model_name(material: Material) -> str:
    """Return the name of a material's model in kernels, current, and with its normal map filtered if it is."""
    name: str = _bsdf("current_name", material.model)
    if material.normal_map is not None and material.normal_map.filter:
        name = _bsdf("filtered_name", name)
    return name


def describe_materials(materials: list[Material], emissions: Sequence[ColorSource] = ()) -> MaterialTable:
    """Return the table of the shapes' materials and emissions.

    Raises:
        InputError: when a material names an unknown reflection model.
    """
    table = MaterialTable(emissions=list(emissions))
    table.of_shapes = [table.add(material) for material in materials]
    simple = [material for material in table.materials if not material.parts]
    table.models = tuple(sorted({model_name(material) for material in simple}))
    for material in simple:
        try:
            _bsdf("model_of", model_name(material))
        except (KeyError, TypeError, ValueError):
            raise InputError(f"{type(material).__name__}: there is no reflection model {material.model!r}") from None
    values = [value for material in table.materials for value in (*material.slots, material.opacity)]
    varying = [value for value in (*values, *emissions) if _varies(value)]
    table.textured = bool(varying)
    table.uv2_alpha = any(_needs_uv2_alpha(value) for value in varying)
    table.mipmapped = any(isinstance(value, ImageTexture) and value.has_levels for value in varying)
    table.opacity = any(material.opacity != 1.0 for material in table.materials)
    if not table.opacity and any(material.parts for material in table.materials):
        mixed = any(isinstance(material, Mix) for material in table.materials)
        table.composite = "mixed" if mixed else "sides"
    table.tangents = any(material.needs_tangents or material.normal_map is not None for material in simple)
    return table


def _varies(value: ColorSource) -> bool:
    return isinstance(value, (ImageTexture, VertexColor))


def _needs_uv2_alpha(value: ColorSource) -> bool:
    if isinstance(value, ImageTexture):
        return value.vertex_alpha or value.uv_set == 1
    return isinstance(value, VertexColor) and value.alpha


class _Slots:
    """Rows of ColorSlot, ImageRecord and NormalMapRecord, and the pixels that they read."""

    def __init__(self) -> None:
        self.rows: list[tuple[Any, ...]] = []
        self.images: list[tuple[Any, ...]] = []
        self.pixels: list[NDArray[np.float32]] = []
        self.normal_maps: list[tuple[int, ...]] = []
        self._pixel_numbers: dict[int, int] = {}
        self._first_alike = FirstAlike()
        self._levels: dict[int, list[int]] = {}
        self._image_numbers: dict[tuple[Any, ...], int] = {}
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
            image, uv_set = self.add_image(self._first_alike(value.pixels), value), value.uv_set
            channel = -1 if value.channel is None else CHANNELS.index(value.channel)
            if value.vertex_colors or value.vertex_alpha:
                colors = k.VERTEX_COLOR if value.vertex_colors else k.VERTEX_ALPHA
        elif isinstance(value, VertexColor):
            colors = k.VERTEX_ALPHA if value.alpha else k.VERTEX_COLOR
        self.rows.append((factor, image, channel, int(colors), -1.0 if cutoff is None else cutoff, uv_set))
        return len(self.rows) - 1

    def add_image(self, pixels: NDArray[np.float32], mapping: ImageTexture | NormalMap) -> int:
        """Return the number of the image record for pixels and their mapping; equal records share one."""
        number = self._add_pixels(pixels)
        placement = mapping.placement if isinstance(mapping, ImageTexture) else np.eye(2, 3)
        nearest = isinstance(mapping, ImageTexture) and mapping.filter == "nearest"
        wraps = (WRAPS.index(wrap) for wrap in mapping.wrap)
        record = (number, *wraps, nearest, *(tuple(row) for row in placement.tolist()))
        levels = self._add_levels(number) if isinstance(mapping, ImageTexture) and mapping.has_levels else []
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

    def _add_levels(self, number: int) -> list[int]:
        """Return the numbers of the mip levels: the pixels at half the size, a quarter, and so on."""
        if number not in self._levels:
            self._levels[number] = [self._add_pixels(level) for level in pyramid(self.pixels[number])]
        return self._levels[number]

    def add_normal_map(self, normal_map: NormalMap, filtered: bool) -> int:
        """Add a normal map and the images for filtering it, and return its number."""
        key = (id(normal_map), filtered)
        if key not in self._normal_map_numbers:
            self._normal_map_numbers[key] = len(self.normal_maps)
            normals = normals_of(normal_map)
            first = self.add_image(normals, normal_map)
            levels = slope_pyramid(normals) if filtered else ()
            for image in (image for level in levels for image in level):
                self.add_image(image, normal_map)
            kind = int(normal_map.heights), NORMAL_CONVENTIONS.index(normal_map.convention)
            self.normal_maps.append((first, first + 1, (len(self.images) - first) // 2, *kind))
        return self._normal_map_numbers[key]

    def image_rows(self, texels: Texels) -> Iterator[tuple[Any, ...]]:
        """Yield the values of each image's record."""
        for number, *mapping in self.images:
            height, width = self.pixels[number].shape[:2]
            first, palette = texels.places[number]
            yield first, 3 * 256 * palette if palette >= 0 else -1, width, height, *mapping
