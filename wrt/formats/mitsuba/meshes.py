"""Mesh files as Mitsuba reads them: without materials, smooth unless told otherwise."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.files import first_line, read_file
from wrt.formats import growth
from wrt.formats.mitsuba.plugin import Plugin
from wrt.formats.obj import read_obj
from wrt.formats.parts import Part, merge, to_shapes
from wrt.formats.ply import read_ply
from wrt.formats.trimesh_files import load, part_of
from wrt.mesh import Mesh
from wrt.normals import vertex_normals


def read_mesh(plugin: Plugin) -> Mesh:
    """Return the triangles of an `obj` or a `ply` in the world.

    Normals that the file has are kept; else they are the mean of the faces around each vertex (Thürmer and Wüthrich
    1998), without creases. With `face_normals` there are none.

    Raises:
        InputError: where the file cannot be read.
    """
    path = plugin.file()
    matrix = plugin.transform()
    flat = plugin.boolean("face_normals", False)
    upside_down = plugin.boolean("flip_tex_coords", plugin.type == "obj")
    try:
        data = read_file(path)
        growth.reads(path)
        parts = read_obj(path, _without_materials(data)) if plugin.type == "obj" else _read_ply(path, data)
        meshes = [shape.mesh for shape in to_shapes(str(path), parts, None)]
    except InputError as error:
        raise plugin.error(str(error)) from None
    except (OSError, MemoryError) as error:
        raise plugin.error(f"{path}: cannot be read: {first_line(error)}") from None
    mesh = merge(meshes, path.name)
    if upside_down and mesh.uvs is not None:
        mesh = dataclasses.replace(mesh, uvs=np.array([0.0, 1.0]) + mesh.uvs * np.array([1.0, -1.0]))
    if flat or mesh.normals is None:
        mesh = _moved_flat(mesh, matrix)
        return mesh if flat else dataclasses.replace(mesh, normals=vertex_normals(mesh).astype(np.float32))
    return mesh.transformed(matrix)


def _moved_flat(mesh: Mesh, matrix: NDArray[np.float64]) -> Mesh:
    """Return a mesh whose fronts are where its corners run counter-clockwise after the move: mirroring swaps sides."""
    moved = dataclasses.replace(mesh, normals=None).transformed(matrix)
    return dataclasses.replace(moved, faces=mesh.faces)


def _without_materials(data: bytes) -> bytes:
    """Return the text of an OBJ file without its materials, which the scene names in their place."""
    lines = data.replace(b"\r\n", b"\n").split(b"\n")
    return b"\n".join(line for line in lines if not line.lstrip().startswith((b"mtllib", b"usemtl")))


def _read_ply(path: Any, data: bytes) -> list[Part]:
    """Return a PLY file's surface; colours that Mitsuba's own files have as r, g and b are linear."""
    header = data[: data.find(b"end_header")].split(b"\n")
    names = [line.split()[-1] for line in header if line.startswith(b"property") and b"list" not in line]
    if not {b"r", b"g", b"b"} <= set(names) and not {b"u", b"v"} <= set(names):
        return read_ply(path, data)
    fields = load(path, data, "ply", fix_texture=False)
    part = part_of(path, path.stem, fields)
    if part is None:
        return []
    vertex = fields["metadata"]["_ply_raw"]["vertex"]["data"]

    def columns(*keys: str) -> NDArray[np.float64] | None:
        if not {key.encode() for key in keys} <= set(names):
            return None
        return np.stack([np.asarray(vertex[key], np.float64).reshape(-1) for key in keys], axis=-1)

    part.colors = columns("r", "g", "b")
    part.uvs = columns("u", "v") if part.uvs is None else part.uvs
    return [part]
