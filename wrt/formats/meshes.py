"""Reads mesh files and trimesh objects as scenes.

OBJ, PLY, STL, OFF, glTF and GLB, all loaded by trimesh, and arrays. No axis is turned and no unit scaled: formats do
not agree on either, and most do not say.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from wrt.errors import InputError
from wrt.files import PathLike, naming, read_file, require_file
from wrt.formats import growth
from wrt.formats.arrays import read_mesh_arrays
from wrt.formats.encodings import as_text, as_utf8
from wrt.formats.gltf import read_gltf
from wrt.formats.kinds import hint, hinting
from wrt.formats.obj import read_obj
from wrt.formats.parts import (
    DEFAULT_REFLECTANCE,
    Contents,
    InputWarning,
    Part,
    in_the_world,
    merge,
    positions_of,
    to_shapes,
    warn,
)
from wrt.formats.ply import read_ply
from wrt.formats.trimesh_files import load, part_of
from wrt.mesh import Mesh
from wrt.normals import CREASE_DEGREES, same_positions
from wrt.scene import Scene, Shape

__all__ = [
    "DEFAULT_REFLECTANCE",
    "MESH_SUFFIXES",
    "InputWarning",
    "from_trimesh",
    "load_file",
    "load_mesh",
    "load_object",
    "load_shapes",
]


def _read_stl(path: Path, data: bytes) -> list[Part]:
    """Return a part for each solid, corners at one position merged."""
    with contextlib.suppress(InputError):  # a binary file may begin with the bytes of a mark
        plain = as_utf8(data)
        data = plain if plain.lstrip()[:5].lower() == b"solid" else data
    count = int.from_bytes(data[80:84], "little")
    size = 84 + 50 * count
    text = data.lstrip()[:5].lower() == b"solid" and b"facet" in data[:4096].lower()
    if not text and count and len(data) < size:
        raise InputError(f"{path}: the STL header says {count} triangles, which the file is too short for: truncated")
    if text and b"endsolid" not in data[-4096:].lower():
        raise InputError(f"{path}: the text of the STL file ends inside a solid; it is truncated")
    # trimesh takes a binary file with something behind the triangles for text.
    if not text and count:
        data = data[:size]
    loaded = load(path, as_text(data).encode("utf-8", "replace") if text else data, "stl")
    parts, solids = [], loaded.get("geometry", {path.stem: loaded}).values()
    if not any(np.any(fields.get("face_normals", 1.0)) for fields in solids):
        warn(f"{path}: the STL file has no normals; which side is the front is taken from the order of corners")
    for fields in solids:
        name = fields.get("metadata", {}).get("name") or path.stem
        part = part_of(path, str(name), fields)
        if part is not None:
            positions = positions_of(path, part.vertices, part.faces, "a corner of triangle {} (counted from 0)", 3)
            same = same_positions(positions)
            _, first = np.unique(same, return_index=True)
            parts.append(Part(part.name, part.vertices[first], same[part.faces]))
    return parts


def _read_off(path: Path, data: bytes) -> list[Part]:
    text = as_text(data)
    if text.lstrip()[:4].upper() == "COFF":
        warn(f"{path}: the vertex colours of the OFF file are left out")
    part = part_of(path, path.stem, load(path, text, "off"))
    return [] if part is None else [part]


def _of_parts(read: Callable[[Path, bytes], list[Part]]) -> Callable[[Path, bytes], Contents]:
    """Return the reader of a format that knows nothing but meshes."""
    return lambda path, data: Contents(read(path, data))


_READERS: dict[str, Callable[[Path, bytes], Contents]] = {
    ".obj": _of_parts(read_obj),
    ".ply": _of_parts(read_ply),
    ".stl": _of_parts(_read_stl),
    ".off": _of_parts(_read_off),
    ".gltf": read_gltf,
    ".glb": read_gltf,
}

ARRAYS_SUFFIX = ".npz"
"""Of meshes as arrays, which nothing is done to."""

MESH_SUFFIXES = (*_READERS, ARRAYS_SUFFIX)
"""Names of mesh files end in one of these, in small or capital letters."""


def load_mesh(path: PathLike, *, smooth_degrees: float | None = CREASE_DEGREES) -> Mesh:
    """Read all triangles of a file as one mesh in world space, without its materials.

    Args:
        path: the file; its suffix is one of MESH_SUFFIXES.
        smooth_degrees: where the file has no normals, folds of up to this angle look smooth
            (see `wrt.normals.with_normals`); None leaves such a mesh flat.

    Raises:
        InputError: when the file cannot be read, is damaged, or has no triangles.
    """
    shapes = load_shapes(path, smooth_degrees=smooth_degrees)
    return merge([shape.mesh for shape in shapes], Path(path).name)


def load_shapes(path: PathLike, *, smooth_degrees: float | None = CREASE_DEGREES) -> list[Shape]:
    """Read a file as one shape for each of its parts, in world space; see `load_file`."""
    return in_the_world(load_file(path, smooth_degrees=smooth_degrees).shapes)


@growth.one_load()
def load_file(path: PathLike, *, smooth_degrees: float | None = CREASE_DEGREES) -> Scene:
    """Read a file as one shape for each of its parts, with its materials, its lights and its first camera.

    What stands in several places are shapes that share a mesh, each with a transform.

    What a surface reflects is the file's texture, its vertex or face colours, its constant, or
    DEFAULT_REFLECTANCE, whichever it has first. A texture or material file that is missing is
    told as an InputWarning, and the next in that list is used.

    Args:
        path: see `load_mesh`.
        smooth_degrees: see `load_mesh`.

    Raises:
        InputError: see `load_mesh`.
    """
    file = Path(path)
    reader = _READERS.get(file.suffix.lower())
    require_file(file)
    if file.suffix.lower() == ARRAYS_SUFFIX:
        with hinting(file):
            return Scene([Shape(read_mesh_arrays(file), name=file.stem)])
    if reader is None:
        kind = hint(file)
        known = f"the name must end in {', '.join(MESH_SUFFIXES)}"
        raise InputError(f"{file}: not a mesh format that is known; {known}" + (f"; {kind}" if kind else ""))
    with naming(file), hinting(file):
        return _scene(str(file), reader(file, read_file(file)), smooth_degrees)


def load_object(source: Any, *, smooth_degrees: float | None = CREASE_DEGREES) -> Scene:
    """Read a `trimesh.Trimesh` or `trimesh.Scene` as `load_file` would read its file.

    Materials, textures, colours with their alpha, cameras and lights are those of the file, as far as trimesh keeps
    them: see `wrt.formats.trimesh_objects`. A mesh that stands in several places becomes shapes that share it, each
    with a transform; all others lie in world space. Colours at vertices and faces are sRGB; they are linear if the
    object was loaded from glTF or has a PBRMaterial. Normals that were given to a mesh are kept; the ones that trimesh
    computes are not, as they round off every edge. Points and paths are left out with a warning.

    Args:
        source: the object.
        smooth_degrees: see `load_mesh`.

    Raises:
        InputError: when it is something else, or has no triangles.
    """
    from wrt.formats.trimesh_objects import read_object

    return _scene("trimesh", read_object(source), smooth_degrees)


def from_trimesh(source: Any, *, smooth_degrees: float | None = CREASE_DEGREES) -> list[Shape]:
    """Return the shapes of a `trimesh.Trimesh` or `trimesh.Scene`; see `load_object`."""
    return load_object(source, smooth_degrees=smooth_degrees).shapes


def _scene(path: str, contents: Contents, smooth_degrees: float | None) -> Scene:
    shapes = to_shapes(path, contents.parts, smooth_degrees)
    return Scene(shapes, contents.lights, camera=contents.cameras[0] if contents.cameras else None)
