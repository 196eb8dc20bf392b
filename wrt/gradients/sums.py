"""The derivatives that a kernel sums up, one for each value that it reads of a scene on a device."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.backend import current_backend
from wrt.scene.materials import Material
from wrt.scene.medium import Medium
from wrt.upload.scene_values import SceneValues
from wrt.upload.textures.pyramid import summed_levels

Floats = NDArray[np.float64]

NO_NUMBERS: Mapping[int, int] = MappingProxyType({})


class DeviceSums:
    """Derivatives of a loss by the values of a scene on a device.

    Their arrays, by name, are parallel to those of SceneData: "slots" (S, 3), "texels" (T, 3), "lights" (L, 3),
    "emission" (shapes, 3), "environment" (3,), "environment_texels" (N, 3), "media_absorption", "media_scattering" and
    "media_emission" (media, 3), "vertices" and "normals" (points, 3). Those of lights with triangles are in "emission",
    not in "lights". `indices` are the derivatives by the indices of smooth glasses, by the number of the material.
    """

    def __init__(
        self,
        values: SceneValues,
        data: Any,
        arrays: Mapping[str, Floats],
        first_vertices: Mapping[int, int] = NO_NUMBERS,
        indices: Mapping[int, float] = NO_NUMBERS,
    ) -> None:
        """Keep the arrays of a scene's values, which are those of a SceneData struct.

        `first_vertices` are the numbers of the first vertices of shapes.
        """
        self._values, self._data, self._arrays, self._first = values, data, arrays, first_vertices
        self._indices = indices
        self._fetched: dict[str, NDArray[Any]] = {}

    def __getitem__(self, name: str) -> Floats:
        return self._arrays[name]

    def _records(self, name: str) -> NDArray[Any]:
        """Return an array of records of the scene."""
        if name not in self._fetched:
            self._fetched[name] = current_backend().fetch(getattr(self._data, name))
        return self._fetched[name]

    def _first_slot(self, material: Material) -> int:
        materials = self._values.materials
        return materials.first_slots[materials.number_of(material)]

    def of_material(self, material: Material) -> Floats:
        """Return the derivatives by the slots of a material, (S, 3)."""
        first = self._first_slot(material)
        return self["slots"][first : first + len(material.slots)]

    def of_index(self, material: Material) -> float:
        """Return the derivative by the index of a smooth glass, inside over outside."""
        return self._indices[self._values.materials.number_of(material)]

    def of_texels(self, user: tuple[Material, int] | int) -> Floats:
        """Return the derivative by the pixels of an image, (H, W, 3), by what reads it: see `Texels.user`."""
        if isinstance(user, int):
            slot = self._values.materials.emission_slots[user]
        else:
            slot = self._first_slot(user[0]) + user[1]
        images = self._records("images")
        image = int(self._records("slots")[slot]["image"])
        first, levels = int(images[image]["next_level"]), int(images[image]["levels"])
        return summed_levels([self._pixels(images[each]) for each in (image, *range(first, first + levels))])

    def _pixels(self, image: Any) -> Floats:
        first, width, height = (int(image[name]) for name in ("first", "width", "height"))
        return self["texels"][first : first + width * height].reshape(height, width, 3)

    def of_emission(self, number: int) -> Floats:
        """Return the derivative by the emission of a shape, (3,)."""
        return np.asarray(self["emission"][number])

    def of_points(self, name: str, number: int, count: int) -> Floats:
        """Return the derivative by the "vertices" or the "normals" of a shape that has `count` of them, (count, 3)."""
        return self[name][self._first[number] : self._first[number] + count]

    def of_light(self, number: int) -> Floats:
        """Return the derivative by the value of a light without a mesh, (3,)."""
        return np.asarray(self["lights"][sum(self._values.light_counts) + number])

    def of_medium(self, medium: Medium, coefficient: str) -> Floats:
        """Return the derivative by the "absorption", "scattering" or "emission" of a medium, (3,)."""
        return np.asarray(self[f"media_{coefficient}"][self._values.bodies.media.index(medium)])
