"""Description of a scene's contents, for `wrt info`."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Any, TypeAlias

import numpy as np

from wrt.errors import one_line
from wrt.scene.exact.analytic import Analytic
from wrt.scene.materials import Material
from wrt.scene.materials.measured import Measurement
from wrt.scene.mesh import VERTEX_ATTRIBUTES
from wrt.scene.scene import Scene, Shape
from wrt.scene.textures import FirstAlike, ImageTexture, NormalMap, VertexColor

Row: TypeAlias = tuple[str, ...]

MOST_ROWS = 40
"""Maximum rows of a table; the rest is only counted."""


def scene_text(scene: Scene) -> str:
    """Return a summary of a scene, and tables of its shapes, materials, textures and lights."""
    meshes = list({id(shape.mesh): shape.mesh for shape in scene.shapes}.values())
    numbers: dict[int, int] = {}
    materials: list[Material] = []
    for shape in scene.shapes:
        _number(shape.material, numbers, materials)
    textures = _textures([*materials, *scene.shapes])
    arrays = [getattr(mesh, name) for mesh in meshes for name in ("vertices", "faces", *VERTEX_ATTRIBUTES)]
    used = sum(array.nbytes for array in (*arrays, *(pixels for _, pixels, _ in textures)) if array is not None)
    vertices = sum(len(mesh.vertices) for mesh in meshes if not isinstance(mesh, Analytic))
    low, high = scene.bounds
    lines = [
        f"{_count(len(scene.shapes), 'shape')} of {_count(len(meshes), 'mesh', 'meshes')}, "
        f"{_faces(scene.shapes)}, "
        f"{_count(vertices, 'vertex', 'vertices')}, "
        f"{_count(len(materials), 'material')}, {_count(len(textures), 'texture')}; {used / 1e6:.1f} MB",
        f"bounds      {_vector(low)} to {_vector(high)}, size {' x '.join(f'{x:.4g}' for x in high - low)}",
        f"camera      {'none; the renderer frames the shapes' if scene.camera is None else _summary(scene.camera)}",
        f"environment {'none' if scene.environment is None else _summary(scene.environment)}",
    ]
    if len(scene.cameras) > 1:
        rows: list[Row] = [(f"{i} {name}", _summary(scene.cameras[name])) for i, name in enumerate(scene.cameras)]
        lines += _table("cameras", ("", ""), rows)
    rows = [_shape_row(shape, numbers[id(shape.material)]) for shape in scene.shapes]
    lines += _table("shapes", ("", "triangles", "vertices", "with", "material"), rows)
    rows = [
        (str(number), material.type_name, ", ".join(_values(material, numbers)) or "-")
        for number, material in enumerate(materials)
    ]
    lines += _table("materials", ("", "type", "values"), rows)
    rows = [(name, f"{pixels.shape[1]} x {pixels.shape[0]}", ", ".join(uses)) for name, pixels, uses in textures]
    lines += _table("textures", ("", "pixels", "used as"), rows)
    lines += _table("lights", ("",), [(_summary(light),) for light in scene.lights])
    return "\n".join(lines)


def _number(material: Material, numbers: dict[int, int], materials: list[Material]) -> None:
    """Give a material and its parts the next numbers, unless it has one already."""
    if id(material) not in numbers:
        numbers[id(material)] = len(materials)
        materials.append(material)
        for part in material.parts:
            _number(part, numbers, materials)


def _faces(shapes: Iterable[Shape]) -> str:
    counts: Counter[str] = Counter()
    for mesh in (shape.mesh for shape in shapes):
        counts.update(mesh.counts if isinstance(mesh, Analytic) else {"triangle": len(mesh.faces)})
    exact = [_count(counts[noun], f"exact {noun}") for noun in ("sphere", "disk", "cylinder") if counts[noun]]
    return ", ".join([_count(counts["triangle"], "triangle"), *exact])


def _textures(owners: Iterable[Any]) -> list[tuple[str, np.ndarray, list[str]]]:
    """Return name, pixels and uses of each image, once."""
    textures: dict[int, tuple[str, np.ndarray, list[str]]] = {}
    first_alike = FirstAlike()
    for owner in owners:
        for field in dataclasses.fields(owner):
            value = getattr(owner, field.name)
            if isinstance(value, (ImageTexture, NormalMap)):
                pixels = value.pixels.pixels if isinstance(value.pixels, ImageTexture) else value.pixels
                pixels = first_alike(pixels)
                _, _, uses = textures.setdefault(id(pixels), (value.name, pixels, []))
                if field.name not in uses:
                    uses.append(field.name)
    return list(textures.values())


def _shape_row(shape: Shape, material: int) -> Row:
    mesh = shape.mesh
    attributes = ("colors",) if isinstance(mesh, Analytic) else VERTEX_ATTRIBUTES
    extras = [name for name in attributes if getattr(mesh, name) is not None] + ["emission"] * shape.emits
    extras += ["shadow-catcher"] * shape.shadow_catcher
    faces, vertices = f"{len(mesh.faces):,}", f"{len(mesh.vertices):,}"
    if isinstance(mesh, Analytic):
        faces, vertices = ", ".join(_count(count, noun) for noun, count in mesh.counts.items()), "-"
    return shape.name, faces, vertices, ", ".join(extras) or "-", str(material)


def _summary(thing: Any) -> str:
    """Return the name of a dataclass, and its fields that differ from their defaults."""
    return ": ".join(filter(None, [type(thing).__name__, ", ".join(_values(thing, {}))]))


def _values(thing: Any, numbers: dict[int, int]) -> Iterator[str]:
    """Yield the fields of a dataclass that differ from their defaults, materials by their numbers."""
    for field in dataclasses.fields(thing):
        value = getattr(thing, field.name)
        if isinstance(value, Material):
            yield f"{field.name} {numbers[id(value)]}"
        elif field.name != "name" and not _is_default(value, field):
            yield f"{field.name} {_value(value)}"


def _is_default(value: Any, field: dataclasses.Field[Any]) -> bool:
    if isinstance(value, (ImageTexture, NormalMap, VertexColor)) or field.default is dataclasses.MISSING:
        return False
    if value is None or field.default is None:
        return value is field.default
    try:
        # The default of a colour may be a single number, a grey.
        return bool(np.all(np.asarray(value) == np.asarray(field.default)))
    except ValueError:
        return False


def _value(value: Any) -> str:
    if isinstance(value, (ImageTexture, NormalMap, Measurement)):
        channel = getattr(value, "channel", None)
        return f"from {value.name}" + (f" ({channel})" if channel else "")
    if isinstance(value, VertexColor):
        return "vertex-colors" + " (alpha)" * value.alpha
    if isinstance(value, np.ndarray):
        return " x ".join(str(n) for n in value.shape)
    if isinstance(value, (tuple, list)) and value and all(isinstance(x, (int, float)) for x in value):
        return f"{value[0]:.4g}" if len(set(value)) == 1 and len(value) == 3 else _vector(value)
    if isinstance(value, float):
        return f"{value:.4g}"
    return type(value).__name__ if dataclasses.is_dataclass(value) else str(value)


def _vector(values: Iterable[float]) -> str:
    return f"({', '.join(f'{x:.4g}' for x in values)})"


def _count(number: int, one: str, several: str | None = None) -> str:
    return f"{number:,} {one if number == 1 else several or one + 's'}"


def _table(title: str, heads: tuple[str, ...], rows: list[Row]) -> list[str]:
    """Return the lines of a table with a title, none if there are no rows."""
    if not rows:
        return []
    # Names come from files, and may contain control characters.
    shown = [(title, *heads[1:]), *(tuple(one_line(cell) for cell in row) for row in rows[:MOST_ROWS])]
    widths = [max(map(len, column)) for column in zip(*shown, strict=True)]
    cells = ["  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)).rstrip() for row in shown]
    omitted = [f"  and {len(rows) - MOST_ROWS} more"] if len(rows) > MOST_ROWS else []
    return ["", cells[0], *(f"  {line}" for line in cells[1:]), *omitted]
