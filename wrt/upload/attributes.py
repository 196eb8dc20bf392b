"""Check that meshes have the attributes which their materials read, and that these are what a material can have."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator

import numpy as np

from wrt.errors import InputError, warn
from wrt.scene.materials import Material
from wrt.scene.mesh import box_around
from wrt.scene.scene import Shape
from wrt.scene.textures import ImageTexture, NormalMap, VertexColor

UP_TO_ONE = frozenset(
    ["reflectance", "base_color", "specular_reflectance", "specular_transmittance", "sheen_color", "opacity", "weight"]
)
"""Attributes of materials that constants of at most 1 may have."""

TOLERANCE = 1e-3
"""Vertex colours may exceed 1 by what rounding adds; 16-bit floats near 1 are half as far apart."""

VISIBLE = 1.01
"""Images of files may exceed 1 by this factor without a warning: resampling overshoots."""


def check_attributes(shapes: Iterable[Shape]) -> None:
    """Check the vertex attributes and images of shapes.

    Warns of images on meshes without texture coordinates, and of images that reflect more than all light.

    Raises:
        InputError: where vertex colours that a material reads are not from 0 to 1, or those that shine are below 0.
    """
    bright: set[int] = set()
    varying: dict[int, list[tuple[str, object]]] = {}  # of materials, since many shapes share one
    alike = {(id(shape.mesh), id(shape.material), id(shape.emission)): shape for shape in shapes}  # instances are many
    for shape in alike.values():
        if id(shape.material) not in varying:
            varying[id(shape.material)] = [*_varying(shape.material)]
        values = varying[id(shape.material)]
        for name, value in values:
            if isinstance(value, VertexColor) and name in UP_TO_ONE:
                _check_colors(shape, value)
            elif isinstance(value, ImageTexture) and name in UP_TO_ONE and id(value) not in bright:
                bright.add(id(value))
                most = float(value.pixels.max()) * max(value.factor)  # type: ignore[arg-type]
                if most > VISIBLE:
                    warn(f"texture {value.name}: as {name} it must be at most 1, but it reaches {most:g}")
        if isinstance(shape.emission, VertexColor) and (low := _range(shape, shape.emission)[0]) < 0.0:
            raise InputError(f"{shape.name}: vertex colors that shine must be at least 0, not {low:g}")
        read = (*(value for _, value in values), shape.emission)
        if shape.mesh.uvs is None and any(isinstance(value, (ImageTexture, NormalMap)) for value in read):
            warn(f"{shape.name}: its material has an image, but its mesh no texture coordinates; it shows one texel")


def _varying(material: Material) -> Iterator[tuple[str, object]]:
    """Yield the names and values of those attributes of a material, and of its parts, that vary over a surface."""
    for field in dataclasses.fields(material):
        value = getattr(material, field.name)
        if isinstance(value, (ImageTexture, NormalMap, VertexColor)):
            yield field.name, value
    for part in material.parts:
        yield from _varying(part)


def _range(shape: Shape, value: VertexColor) -> tuple[float, float]:
    """Return the least and the greatest number that a value reads of vertex colours; a mesh without any is white."""
    colors = shape.mesh.colors
    if colors is None or (value.alpha and colors.shape[1] < 4):
        return 1.0, 1.0
    bounds = box_around(colors)
    read = bounds[:, 3:] if value.alpha else bounds[:, :3] * np.asarray(value.factor)
    return float(read.min()), float(read.max())


def _check_colors(shape: Shape, value: VertexColor) -> None:
    """Raise InputError unless the vertex colours that a value reads are from 0 to 1."""
    low, high = _range(shape, value)
    if low < 0.0 or high > 1.0 + TOLERANCE:
        raise InputError(f"{shape.name}: vertex colors must be linear, from 0 to 1; they are from {low:g} to {high:g}")
