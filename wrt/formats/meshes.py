"""Mesh files and trimesh objects as wrt's shapes.

OBJ, PLY, STL, OFF, glTF and GLB, all loaded by trimesh, and arrays. No axis is turned and no unit scaled: formats do
not agree on either, and most do not say.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.files import PathLike, naming, read_file, require_file
from wrt.formats import growth
from wrt.formats.arrays import read_mesh_arrays
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
    placed,
    positions_of,
    to_shapes,
    warn,
)
from wrt.formats.ply import read_ply
from wrt.formats.trimesh_files import as_text, decoded, is_stand_in, load, part_of, reflectance
from wrt.mesh import Mesh
from wrt.normals import CREASE_DEGREES, same_positions, vertex_normals
from wrt.scene import Scene, Shape
from wrt.textures import ColorSource

__all__ = [
    "DEFAULT_REFLECTANCE",
    "MESH_SUFFIXES",
    "InputWarning",
    "from_trimesh",
    "load_file",
    "load_mesh",
    "load_shapes",
]


def _read_stl(path: Path, data: bytes) -> list[Part]:
    """Return a part for each solid, corners at one position merged."""
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
    if data.lstrip()[:4].upper() == b"COFF":
        warn(f"{path}: the vertex colours of the OFF file are left out")
    part = part_of(path, path.stem, load(path, as_text(data), "off"))
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
    growth.reads(file)
    if file.suffix.lower() == ARRAYS_SUFFIX:
        with hinting(file):
            return Scene([Shape(read_mesh_arrays(file), name=file.stem)])
    if reader is None:
        kind = hint(file)
        known = f"the name must end in {', '.join(MESH_SUFFIXES)}"
        raise InputError(f"{file}: not a mesh format that is known; {known}" + (f"; {kind}" if kind else ""))
    with naming(file), hinting(file):
        contents = reader(file, read_file(file))
        shapes = to_shapes(str(file), contents.parts, smooth_degrees)
        return Scene(shapes, contents.lights, camera=contents.cameras[0] if contents.cameras else None)


def from_trimesh(source: Any, *, smooth_degrees: float | None = CREASE_DEGREES) -> list[Shape]:
    """Return the shapes of a `trimesh.Trimesh` or `trimesh.Scene`.

    What stands in several places are shapes that share a mesh, each with a transform; all else lies in world space.

    Colours of vertices and faces are as opaque as their alpha tells. Normals that someone gave the mesh are kept; the
    ones trimesh computes by itself are not, as they round every edge off.

    Args:
        source: the object; points and paths in a scene are left out.
        smooth_degrees: see `load_mesh`.

    Raises:
        InputError: when it is something else, or has no triangles.
    """
    import trimesh

    if isinstance(source, trimesh.Trimesh):
        parts = [_trimesh_part("trimesh", source)]
    elif isinstance(source, trimesh.Scene):
        places: dict[str, list[NDArray[np.float64]]] = {}
        for node in source.graph.nodes_geometry:
            matrix, name = source.graph[node]
            if isinstance(source.geometry[name], trimesh.Trimesh):
                places.setdefault(name, []).append(np.asarray(matrix, np.float64))
        parts = [placed(_trimesh_part(str(name), source.geometry[name]), found) for name, found in places.items()]
    else:
        raise InputError(f"expected a trimesh.Trimesh or trimesh.Scene, not {type(source).__name__}")
    return to_shapes("trimesh", parts, smooth_degrees)


def _trimesh_part(name: str, mesh: Any) -> Part:
    part = Part(name, np.asarray(mesh.vertices), np.asarray(mesh.faces), _given_normals(mesh))
    visual = mesh.visual
    if visual.kind == "texture":
        uv = visual.uv
        if uv is not None and np.shape(uv) == (len(mesh.vertices), 2):
            part.uvs = np.asarray(uv)
        part.reflectance = _trimesh_material(name, visual.material)
    elif visual.kind == "vertex":
        part.colors = _with_alpha(np.asarray(visual.vertex_colors))
    elif visual.kind == "face":
        part.face_colors = _with_alpha(np.asarray(visual.face_colors))
    return part


def _with_alpha(given: NDArray[Any]) -> NDArray[np.float64]:
    """Return 8-bit colours as linear ones, (N, 4) if any is not opaque."""
    alpha = given[:, 3:] / 255.0
    colors = decoded(given)
    return np.column_stack([colors, alpha]) if (alpha < 1.0).any() else np.asarray(colors)


def _given_normals(mesh: Any) -> NDArray[np.float64] | None:
    """Return vertex normals that are not merely what trimesh computes from the faces.

    trimesh keeps both in its cache and has no public way to ask whether a mesh has any: asking for
    them computes them, which without scipy takes a time that is quadratic in the vertices.
    """
    if "vertex_normals" not in mesh._cache.cache:
        return None
    given = np.asarray(mesh.vertex_normals)
    if given.shape != np.shape(mesh.vertices) or not len(mesh.faces):
        return None
    # The same formula as trimesh's (Thürmer and Wüthrich 1998).
    computed = vertex_normals(Mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces)))
    return None if np.allclose(given, computed, atol=1e-5) else given


def _trimesh_material(name: str, material: Any) -> ColorSource | None:
    """Return the base colour of a trimesh material: linear factor times sRGB image."""
    from trimesh.visual.color import DEFAULT_COLOR

    image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    image = None if is_stand_in(image) else image
    value = getattr(material, "baseColorFactor", None)
    value = getattr(material, "diffuse", None) if value is None else value
    if value is not None and np.array_equal(value, DEFAULT_COLOR):
        value = None  # nobody chose it
    factor = None if value is None else np.asarray(value)[:3] / 255.0
    return reflectance("trimesh", name, image, factor)
