"""Read mesh files as Mitsuba does: without materials, and smooth by default."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import did_you_mean
from wrt.io.file_type import hinting
from wrt.io.mesh.obj import read_obj
from wrt.io.mesh.parts import Part
from wrt.io.mesh.ply import read_ply
from wrt.io.mesh.repair import to_shapes
from wrt.io.mesh.trimesh_loaders import load, part_of
from wrt.io.mitsuba.plugin import Plugin
from wrt.io.mitsuba.serialized import read_serialized
from wrt.io.safe_read import as_utf8, read_file
from wrt.scene.mesh import Mesh, merge
from wrt.scene.normals import vertex_normals

MESH_FILES = ("obj", "ply", "serialized")  # shapes whose triangles are in a file
_POSTFIXES = frozenset("xyzwrgba01234")  # ends of the names of properties that together are an attribute


def read_mesh(plugin: Plugin, attribute: str | None = None) -> Mesh:
    """Return the triangles of an `obj`, a `ply` or a `serialized` in world space.

    Normals in the file are kept; otherwise each is the mean of the faces around its vertex (Thürmer and Wüthrich 1998),
    without creases. With `face_normals` there are none. An attribute, "vertex_NAME" or "face_NAME", becomes colours.
    """
    path = plugin.file()
    matrix = plugin.transform()
    upside_down = plugin.boolean("flip_tex_coords", plugin.type == "obj")
    index = plugin.integer("shape_index", 0) if plugin.type == "serialized" else 0
    with plugin.locating(), hinting(path):
        parts, flat = _parts(plugin, path, index, attribute)
        shapes = to_shapes(str(path), parts, 0.0)
    flat = plugin.boolean("face_normals", flat)
    mesh = merge([shape.mesh for shape in shapes], path.name)
    if upside_down and mesh.uvs is not None:
        mesh = dataclasses.replace(mesh, uvs=np.array([0.0, 1.0]) + mesh.uvs * np.array([1.0, -1.0]))
    if not flat and mesh.normals is not None:
        return mesh.transformed(matrix)
    # Without normals the winding stays, so that mirroring swaps the sides.
    moved = dataclasses.replace(dataclasses.replace(mesh, normals=None).transformed(matrix), faces=mesh.faces)
    return moved if flat else dataclasses.replace(moved, normals=vertex_normals(moved).astype(np.float32))


def _parts(plugin: Plugin, path: Path, index: int, attribute: str | None) -> tuple[list[Part], bool]:
    """Return the parts of a mesh file, coloured by an attribute, and whether the file says that they are flat."""
    data = read_file(path)
    if plugin.type == "obj":
        return read_obj(path, _without_materials(as_utf8(data))), False
    if plugin.type == "serialized":
        found = read_serialized(path, data, index)
        part, flat, attributes = found.part, found.face_normals, found.attributes
    else:
        parts, attributes = _read_ply(path, as_utf8(data))
        if not parts:
            return [], False
        part, flat = parts[0], False
    if attribute is not None:
        _color_by(plugin, part, attributes, attribute)
    return [part], flat


def _color_by(plugin: Plugin, part: Part, attributes: dict[str, NDArray[Any]], name: str) -> None:
    """Set the colours of a part to an attribute of its vertices or faces."""
    values = attributes.get(name)
    of_faces = name.startswith("face_")
    if values is None or len(values) != len(part.faces if of_faces else part.vertices):
        if name != "vertex_color" or part.colors is None:
            plugin.warn(f"its file has no attribute {name!r}{did_you_mean(name, attributes)}; white stands in for it")
            part.colors = part.face_colors = None
        return
    colors = np.repeat(values, 3, axis=1) if values.shape[1] == 1 else values[:, :3]
    if not ((colors >= 0.0) & (colors <= 1.0)).all():
        plugin.warn(f"values of the attribute {name!r} are clipped to 0 up to 1")
    part.colors, part.face_colors = (None, colors) if of_faces else (colors, None)
    if of_faces and part.normals is None and not plugin.boolean("face_normals", False):
        # Faces of their own colours share no corners, so they are smoothed beforehand.
        part.normals = vertex_normals(Mesh(part.vertices, part.faces))


def _without_materials(data: bytes) -> bytes:
    """Return the text of an OBJ file without its materials, which the scene replaces."""
    lines = data.replace(b"\r\n", b"\n").split(b"\n")
    return b"\n".join(line for line in lines if not line.lstrip().startswith((b"mtllib", b"usemtl")))


def _read_ply(path: Path, data: bytes) -> tuple[list[Part], dict[str, NDArray[Any]]]:
    """Return the surface of a PLY file and the attributes of its vertices and faces, as Mitsuba names them.

    The colours r, g and b of Mitsuba's own files are linear.
    """
    header = data[: data.find(b"end_header")].split(b"\n")
    names = {line.split()[-1] for line in header if line.startswith(b"property") and b"list" not in line}
    if not {b"r", b"g", b"b"} <= names and not {b"u", b"v"} <= names and not any(b"_" in name for name in names):
        return read_ply(path, data), {}
    fields = load(path, data, "ply", fix_texture=False)
    part = part_of(path, path.stem, fields)
    if part is None:
        return [], {}
    elements = fields["metadata"]["_ply_raw"]
    vertex = _columns(elements, "vertex")
    attributes = {
        f"{kind}_{name}": values
        for kind in ("vertex", "face")
        for name, values in _attributes(_columns(elements, kind)).items()
    }
    part.colors = attributes.get("vertex_color", part.colors)
    if part.uvs is None and {"u", "v"} <= vertex.keys():
        part.uvs = np.stack([vertex["u"], vertex["v"]], axis=-1)
    return [part], attributes


def _columns(elements: dict[str, Any], name: str) -> dict[str, NDArray[np.float64]]:
    """Return the properties of an element of a PLY file that are numbers."""
    data = elements.get(name, {}).get("data")
    keys = (data.dtype.names or ()) if isinstance(data, np.ndarray) else (data or {})
    found = {}
    for key in keys:
        column = data[key]
        if isinstance(column, np.ndarray) and column.dtype.kind in "fiu" and column.size == len(column):
            found[key] = column.astype(np.float64).reshape(-1)
    return found


def _attributes(columns: dict[str, NDArray[np.float64]]) -> dict[str, NDArray[np.float64]]:
    """Return the attributes that columns such as r, g, b or heat_0 make up, by the names that Mitsuba gives them."""
    found: dict[str, list[NDArray[np.float64]]] = {}
    if {"r", "g", "b"} <= columns.keys():
        found["color"] = [columns[key] for key in "rgb"]
    for key, values in columns.items():
        prefix, _, postfix = key.rpartition("_")
        if prefix and postfix in _POSTFIXES:
            found.setdefault(prefix + ("_color" if postfix in "rgba" else ""), []).append(values)
    return {name: np.stack(values, axis=-1) for name, values in found.items()}
