"""From material descriptions to the flat tables that kernels read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.build.normal_maps import normals_of, slope_pyramid
from wrt.build.pyramid import pyramid
from wrt.build.tables import pack_tables
from wrt.build.texels import Texels
from wrt.device import Device
from wrt.errors import InputError
from wrt.materials import Material, Mix, TwoSided
from wrt.textures import CHANNELS, WRAPS, ColorSource, FirstAlike, ImageTexture, NormalMap, VertexColor


@dataclass
class MaterialTable:
    """The materials of a scene, each once, with the parts of composite ones after them.

    Attributes:
        materials: the distinct materials.
        numbers: place in `materials` by identity.
        of_shapes: (shapes,) number of each shape's material.
        emissions: (shapes,) what each shape gives off.
        emission_slots: (shapes,) number of the slot of an emission that varies, else −1; known once uploaded.
        models: names of all reflection models, sorted.
        textured: whether any value is an image or a vertex colour.
        extras: whether any is laid by second texture coordinates, or multiplied by the alpha of vertex colours.
        layered: whether any material is composite or not opaque.
        mipmapped: whether any image has levels.
        tangents: whether any depends on the direction of texture coordinates, by itself or by a normal map.
    """

    materials: list[Material] = field(default_factory=list)
    numbers: dict[int, int] = field(default_factory=dict)
    of_shapes: list[int] = field(default_factory=list)
    emissions: list[ColorSource] = field(default_factory=list)
    emission_slots: list[int] = field(default_factory=list)
    models: tuple[str, ...] = ()
    textured: bool = False
    extras: bool = False
    layered: bool = False
    tangents: bool = False
    mipmapped: bool = False

    def add(self, material: Material) -> int:
        """Return a material's number; a new one gets the next."""
        if id(material) not in self.numbers:
            self.numbers[id(material)] = len(self.materials)
            self.materials.append(material)
            for part in material.parts:
                self.add(part)
        return self.numbers[id(material)]

    def upload(self, data: Any, device: Device) -> None:
        """Fill the tables of a SceneData struct: materials, slots, images, texels, normal maps, tables."""
        import warp as wp

        from wrt.kernels.scene_data import ColorSlot, ImageRecord, MaterialRecord, NormalMapRecord

        slots = _Slots()
        records = np.zeros(len(self.materials), MaterialRecord.numpy_dtype())
        tables, places = pack_tables([material.table_key for material in self.materials], device)
        for record, material in zip(records, self.materials, strict=True):
            self._describe(record, material, slots)
            record["table"] = 0 if material.table_key is None else places[material.table_key]
        self.emission_slots = [slots.add(emission) if _varies(emission) else -1 for emission in self.emissions]
        rows = np.zeros(len(slots.rows), ColorSlot.numpy_dtype())
        for i, row in enumerate(slots.rows):
            rows[i] = row
        data.materials = wp.array(records, dtype=MaterialRecord, device=device.name)
        data.slots = wp.array(rows, dtype=ColorSlot, device=device.name)
        data.tables = wp.array(tables, dtype=float, device=device.name)
        if slots.images:
            texels = Texels(slots.pixels)
            images = slots.image_table(texels, ImageRecord.numpy_dtype())
            data.images = wp.array(images, dtype=ImageRecord, device=device.name)
            data.texels = wp.array(texels.colors, dtype=wp.vec3, device=device.name)
            data.texel_codes = wp.array(texels.codes, dtype=wp.uint32, device=device.name)
            data.palettes = wp.array(np.ravel(texels.palettes), dtype=float, device=device.name)
        if slots.normal_maps:
            normal_maps = np.zeros(len(slots.normal_maps), NormalMapRecord.numpy_dtype())
            for i, normal_map in enumerate(slots.normal_maps):
                normal_maps[i] = normal_map
            data.normal_maps = wp.array(normal_maps, dtype=NormalMapRecord, device=device.name)

    def _describe(self, record: Any, material: Material, slots: _Slots) -> None:
        from wrt.kernels.bsdf import current_name, model_number, model_of
        from wrt.kernels.scene_data import MATERIAL_MIX, MATERIAL_MODEL, MATERIAL_SIDES

        record["first_slot"] = len(slots.rows)
        for value in material.slots:
            slots.add(value)
        record["opacity_slot"] = -1 if material.opacity == 1.0 else slots.add(material.opacity)
        if material.parts:
            if not isinstance(material, (Mix, TwoSided)):
                raise InputError(f"{type(material).__name__}: only a Mix or a TwoSided can be made of other materials")
            record["kind"] = MATERIAL_MIX if isinstance(material, Mix) else MATERIAL_SIDES
            record["first"], record["second"] = (self.numbers[id(part)] for part in material.parts)
            return
        name = current_name(material.model)
        model = model_of(name)
        if len(material.slots) != model.slots:
            given = f"{type(material).__name__} gives {len(material.slots)} values"
            raise InputError(f"{given}, but {material.model} reads {model.slots}")
        record["kind"] = MATERIAL_MODEL
        record["model"] = model_number(name, self.models)
        record["matt"] = model.matt
        record["normal_map"] = -1
        if material.normal_map is not None:
            filtered = material.normal_map.filter and model.widens
            record["normal_map"] = slots.add_normal_map(material.normal_map, filtered)
            record["normal_filter"] = _normal_filter(material, filtered)


def describe_materials(materials: list[Material], emissions: Sequence[ColorSource] = ()) -> MaterialTable:
    """Return the table of the shapes' materials, and of what the shapes give off.

    Raises:
        InputError: where a material names a reflection model that does not exist.
    """
    from wrt.kernels.bsdf import current_name, model_of

    table = MaterialTable(emissions=list(emissions))
    table.of_shapes = [table.add(material) for material in materials]
    simple = [material for material in table.materials if not material.parts]
    table.models = tuple(sorted({current_name(material.model) for material in simple}))
    for material in simple:
        try:
            model_of(current_name(material.model))
        except (KeyError, TypeError, ValueError):
            raise InputError(f"{type(material).__name__}: there is no reflection model {material.model!r}") from None
    values = [value for material in table.materials for value in (*material.slots, material.opacity)]
    table.textured = any(_varies(value) for value in [*values, *emissions])
    table.extras = any(_needs_extras(value) for value in [*values, *emissions])
    table.mipmapped = any(isinstance(v, ImageTexture) and v.has_levels for v in [*values, *emissions])
    table.layered = any(material.parts or material.opacity != 1.0 for material in table.materials)
    table.tangents = any(material.needs_tangents or material.normal_map is not None for material in simple)
    return table


def _varies(value: ColorSource) -> bool:
    return isinstance(value, (ImageTexture, VertexColor))


def _needs_extras(value: ColorSource) -> bool:
    if isinstance(value, ImageTexture):
        return value.vertex_alpha or value.uv_set == 1
    return isinstance(value, VertexColor) and value.alpha


def _normal_filter(material: Material, filtered: bool) -> int:
    from wrt.kernels.scene_data import NORMALS_AT_POINT, NORMALS_FILTERED, NORMALS_FILTERED_ALONG_TEXTURE

    if not filtered:
        return int(NORMALS_AT_POINT)
    return int(NORMALS_FILTERED_ALONG_TEXTURE if material.needs_tangents else NORMALS_FILTERED)


class _Slots:
    """Rows of ColorSlot, ImageRecord and NormalMapRecord, and the pixels that they read."""

    def __init__(self) -> None:
        self.rows: list[tuple[Any, ...]] = []
        self.images: list[tuple[Any, ...]] = []
        self.pixels: list[NDArray[np.float32]] = []
        self.normal_maps: list[tuple[int, int, int]] = []
        self._pixel_numbers: dict[int, int] = {}
        self._first_alike = FirstAlike()
        self._levels: dict[int, list[int]] = {}
        self._image_numbers: dict[tuple[Any, ...], int] = {}
        self._normal_map_numbers: dict[tuple[int, bool], int] = {}

    def add(self, value: ColorSource) -> int:
        """Append a value; return its number."""
        from wrt.kernels.scene_data import VERTEX_ALPHA, VERTEX_COLOR, VERTEX_COLOR_NONE

        if isinstance(value, ImageTexture):
            image = self.add_image(self._first_alike(value.pixels), value)
            channel = -1 if value.channel is None else CHANNELS.index(value.channel)
            cutoff = -1.0 if value.cutoff is None else value.cutoff
            own = VERTEX_COLOR if value.vertex_colors else VERTEX_ALPHA if value.vertex_alpha else VERTEX_COLOR_NONE
            self.rows.append((value.factor, image, channel, int(own), cutoff, value.uv_set))
        elif isinstance(value, VertexColor):
            cutoff = -1.0 if value.cutoff is None else value.cutoff
            self.rows.append((value.factor, -1, -1, int(VERTEX_ALPHA if value.alpha else VERTEX_COLOR), cutoff, 0))
        else:
            constant = tuple(float(v) for v in np.broadcast_to(np.asarray(value, np.float64), 3))
            self.rows.append((constant, -1, -1, int(VERTEX_COLOR_NONE), -1.0, 0))
        return len(self.rows) - 1

    def add_image(self, pixels: NDArray[np.float32], laid: ImageTexture | NormalMap) -> int:
        """Return the number of the image record for pixels laid as a texture says; the same pixels are there once."""
        number = self._add_pixels(pixels)
        placement = laid.placement if isinstance(laid, ImageTexture) else np.eye(2, 3)
        nearest = isinstance(laid, ImageTexture) and laid.filter == "nearest"
        wraps = (WRAPS.index(wrap) for wrap in laid.wrap)
        record = (number, *wraps, nearest, *(tuple(row) for row in placement.tolist()))
        levels = self._add_levels(number) if isinstance(laid, ImageTexture) and laid.has_levels else []
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
        """Return the numbers of the pixels at half the size, a quarter, and so on."""
        if number not in self._levels:
            self._levels[number] = [self._add_pixels(level) for level in pyramid(self.pixels[number])]
        return self._levels[number]

    def add_normal_map(self, normal_map: NormalMap, filtered: bool) -> int:
        """Append a normal map, with the images that filtering needs; return its number."""
        key = (id(normal_map), filtered)
        if key not in self._normal_map_numbers:
            self._normal_map_numbers[key] = len(self.normal_maps)
            normals = normals_of(normal_map)
            first = self.add_image(normals, normal_map)
            levels = slope_pyramid(normals) if filtered else ()
            for image in (image for level in levels for image in level):
                self.add_image(image, normal_map)
            self.normal_maps.append((first, first + 1, (len(self.images) - first) // 2))
        return self._normal_map_numbers[key]

    def image_table(self, texels: Texels, dtype: Any) -> NDArray[Any]:
        """Return the records of all images."""
        table = np.zeros(len(self.images), dtype)
        for record, (number, *others) in zip(table, self.images, strict=True):
            height, width = self.pixels[number].shape[:2]
            first, palette = texels.places[number]
            values = first, 3 * 256 * palette if palette >= 0 else -1, width, height, *others
            for name, value in zip(dtype["names"], values, strict=True):
                record[name] = value
        return table
