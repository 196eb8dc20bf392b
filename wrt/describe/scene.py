"""Description of a scene's contents, for `wrt info`."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterable
from typing import Any, TypeAlias

import numpy as np

from wrt.errors import one_line
from wrt.scene.exact.analytic import Analytic
from wrt.scene.materials import Material
from wrt.scene.materials.measured import Measurement
from wrt.scene.mesh import Mesh
from wrt.scene.scene import Scene, Shape
from wrt.scene.textures import FirstAlike, ImageTexture, NormalMap, VertexColor

Row: TypeAlias = tuple[str, ...]

MOST_ROWS = 40
"""Maximum rows of a table; the rest is only counted."""


def scene_text(scene: Scene) -> str:
    """Return a summary of a scene, and tables of its shapes, materials, textures and lights."""
    meshes = list({id(shape.mesh): shape.mesh for shape in scene.shapes}.values())
    materials = _materials(scene.shapes)
    textures = _textures([*materials, *scene.shapes])
    low, high = scene.bounds
    used = sum(_bytes(mesh) for mesh in meshes) + sum(pixels.nbytes for _, pixels, _ in textures)
    lines = [
        f"{_count(len(scene.shapes), 'shape')} of {_count(len(meshes), 'mesh', 'meshes')}, "
        f"{_faces(scene.shapes)}, "
        f"{_count(sum(_vertices(mesh) for mesh in meshes), 'vertex', 'vertices')}, "
        f"{_count(len(materials), 'material')}, {_count(len(textures), 'texture')}; {used / 1e6:.1f} MB",
        f"bounds      {_vector(low)} to {_vector(high)}, size {' x '.join(f'{x:.4g}' for x in high - low)}",
        f"camera      {'none; the renderer frames the shapes' if scene.camera is None else _fields(scene.camera)}",
        f"environment {'none' if scene.environment is None else _fields(scene.environment)}",
    ]
    lines += _table("shapes", ("", "triangles", "vertices", "with", "material"), _shape_rows(scene.shapes, materials))
    lines += _table("materials", ("", "type", "values"), _material_rows(materials))
    rows: list[Row] = [(name, f"{pixels.shape[1]} x {pixels.shape[0]}", use) for name, pixels, use in textures]
    lines += _table("textures", ("", "pixels", "used as"), rows)
    lines += _table("lights", ("",), [(_fields(light),) for light in scene.lights])
    return "\n".join(lines)


def _faces(shapes: Iterable[Shape]) -> str:
    counts: Counter[str] = Counter()
    for shape in shapes:
        mesh = shape.mesh
        counts.update(mesh.counts if isinstance(mesh, Analytic) else {"triangle": len(mesh.faces)})
    exact = [_count(counts[noun], f"exact {noun}") for noun in ("sphere", "disk", "cylinder") if counts[noun]]
    return ", ".join([_count(counts["triangle"], "triangle"), *exact])


def _vertices(mesh: Mesh) -> int:
    return 0 if isinstance(mesh, Analytic) else len(mesh.vertices)


def _materials(shapes: Iterable[Shape]) -> list[Material]:
    """Return the materials, each once, composite ones followed by their parts."""
    found: dict[int, Material] = {}

    def add(material: Material) -> None:
        if id(material) not in found:
            found[id(material)] = material
            for part in material.parts:
                add(part)

    for shape in shapes:
        add(shape.material)
    return list(found.values())


def _textures(owners: Iterable[Any]) -> list[tuple[str, np.ndarray, str]]:
    """Return name, pixels and uses of each image, once."""
    found: dict[int, tuple[str, np.ndarray, list[str]]] = {}
    first_alike = FirstAlike()
    for owner in owners:
        for field in dataclasses.fields(owner):
            value = getattr(owner, field.name)
            if isinstance(value, (ImageTexture, NormalMap)):
                pixels = value.pixels.pixels if isinstance(value.pixels, ImageTexture) else value.pixels
                pixels = first_alike(pixels)
                _, _, uses = found.setdefault(id(pixels), (value.name, pixels, []))
                if field.name not in uses:
                    uses.append(field.name)
    return [(name, pixels, ", ".join(uses)) for name, pixels, uses in found.values()]


def _shape_rows(shapes: Iterable[Shape], materials: list[Material]) -> list[Row]:
    numbers = {id(material): number for number, material in enumerate(materials)}
    rows: list[Row] = []
    for shape in shapes:
        mesh = shape.mesh
        of_vertices = ("colors",) if isinstance(mesh, Analytic) else ("normals", "uvs", "colors")
        has = [name for name in of_vertices if getattr(mesh, name) is not None]
        has += ["emission"] * shape.emits
        faces, vertices = f"{len(mesh.faces):,}", f"{len(mesh.vertices):,}"
        if isinstance(mesh, Analytic):
            faces, vertices = ", ".join(_count(count, noun) for noun, count in mesh.counts.items()), "-"
        rows.append((shape.name, faces, vertices, ", ".join(has) or "-", str(numbers[id(shape.material)])))
    return rows


def _material_rows(materials: list[Material]) -> list[Row]:
    numbers = {id(material): number for number, material in enumerate(materials)}
    rows: list[Row] = []
    for number, material in enumerate(materials):
        values = []
        for field in dataclasses.fields(material):
            value = getattr(material, field.name)
            if isinstance(value, Material):
                values.append(f"{field.name} {numbers[id(value)]}")
            elif not _is_default(value, field):
                values.append(f"{field.name} {_value(value)}")
        rows.append((str(number), material.type_name, ", ".join(values) or "-"))
    return rows


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


def _fields(thing: Any) -> str:
    """Return the name of a dataclass, and its fields that differ from their defaults."""
    values = [
        f"{field.name} {_value(getattr(thing, field.name))}"
        for field in dataclasses.fields(thing)
        if field.name != "name" and not _is_default(getattr(thing, field.name), field)
    ]
    return f"{type(thing).__name__}: {', '.join(values)}" if values else type(thing).__name__


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
    return "(" + ", ".join(f"{x:.4g}" for x in values) + ")"


def _bytes(mesh: Mesh) -> int:
    arrays = (mesh.vertices, mesh.faces, mesh.normals, mesh.uvs, mesh.colors)
    return sum(array.nbytes for array in arrays if array is not None)


def _count(number: int, one: str, several: str | None = None) -> str:
    return f"{number:,} {one if number == 1 else several or one + 's'}"


def _table(title: str, heads: tuple[str, ...], rows: list[Row]) -> list[str]:
    """Return the lines of a table with a title, none if there are no rows."""
    if not rows:
        return []
    # Names come from files, and may contain control characters.
    shown = [(title, *heads[1:]), *(tuple(one_line(cell) for cell in row) for row in rows[:MOST_ROWS])]
    widths = [max(len(row[k]) for row in shown) for k in range(len(heads))]
    lines = [""]
    for row in shown:
        cells = [f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)]
        lines.append(("  ".join(cells) if row is shown[0] else "  " + "  ".join(cells)).rstrip())
    if len(rows) > MOST_ROWS:
        lines.append(f"  and {len(rows) - MOST_ROWS} more")
    return lines
