"""Mesh files and trimesh objects as wrt's shapes.

OBJ, PLY, STL, OFF, glTF and GLB. No axis is turned and no unit scaled: formats do not agree on
either, and most do not say.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.formats.gltf import read_gltf
from wrt.formats.images import PathLike, first_line, linear_from_srgb, pixels_of, require_file
from wrt.formats.obj import read_obj
from wrt.formats.parts import DEFAULT_REFLECTANCE, InputWarning, Part, merge, to_shapes, warn
from wrt.formats.ply import read_ply
from wrt.formats.soups import read_off, read_stl
from wrt.mesh import Mesh
from wrt.scene import Shape
from wrt.textures import ColorSource, ImageTexture

__all__ = ["DEFAULT_REFLECTANCE", "MESH_SUFFIXES", "InputWarning", "from_trimesh", "load_mesh", "load_shapes"]

_READERS: dict[str, Callable[[Path, bytes], list[Part]]] = {
    ".obj": read_obj,
    ".ply": read_ply,
    ".stl": read_stl,
    ".off": read_off,
    ".gltf": read_gltf,
    ".glb": read_gltf,
}

MESH_SUFFIXES = tuple(_READERS)
"""Names of mesh files end in one of these, in small or capital letters."""


def load_mesh(path: PathLike, *, smooth_degrees: float | None = 40.0) -> Mesh:
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


def load_shapes(path: PathLike, *, smooth_degrees: float | None = 40.0) -> list[Shape]:
    """Read a file as one shape for each of its parts, each with a diffuse material of its own.

    The reflectance is the file's texture, its vertex or face colours, its constant, or
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
    if reader is None:
        raise InputError(f"{file}: not a mesh format that is known; the name must end in {', '.join(MESH_SUFFIXES)}")
    try:
        return to_shapes(str(file), reader(file, file.read_bytes()), smooth_degrees)
    except InputError:
        raise
    except (OSError, MemoryError) as error:
        raise InputError(f"{file}: cannot be read: {first_line(error)}") from None


def from_trimesh(source: Any, *, smooth_degrees: float | None = 40.0) -> list[Shape]:
    """Return the shapes of a `trimesh.Trimesh` or `trimesh.Scene`, moved into world space.

    Normals that someone gave the mesh are kept; the ones trimesh computes by itself are not, as
    they round every edge off.

    Args:
        source: the object; points and paths in a scene are left out.
        smooth_degrees: see `load_mesh`.

    Raises:
        InputError: when it is something else, or has no triangles.
    """
    import trimesh

    if isinstance(source, trimesh.Trimesh):
        pairs = [("trimesh", source, np.eye(4))]
    elif isinstance(source, trimesh.Scene):
        pairs = []
        for node in source.graph.nodes_geometry:
            matrix, name = source.graph[node]
            if isinstance(source.geometry[name], trimesh.Trimesh):
                pairs.append((str(node), source.geometry[name], np.asarray(matrix, np.float64)))
    else:
        raise InputError(f"expected a trimesh.Trimesh or trimesh.Scene, not {type(source).__name__}")
    return to_shapes("trimesh", [_trimesh_part(*pair) for pair in pairs], smooth_degrees)


def _trimesh_part(name: str, mesh: Any, matrix: NDArray[np.float64]) -> Part:
    linear = matrix[:3, :3]
    mirrored = np.linalg.det(linear) < 0.0
    faces = np.asarray(mesh.faces)
    part = Part(name, np.asarray(mesh.vertices) @ linear.T + matrix[:3, 3], faces[:, ::-1] if mirrored else faces)
    normals = _given_normals(mesh)
    if normals is not None:
        a, b, c = linear
        cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)])
        part.normals = (normals @ cofactors.T) * (-1.0 if mirrored else 1.0)
    visual = mesh.visual
    if visual.kind == "texture":
        uv = visual.uv
        if uv is not None and np.shape(uv) == (len(mesh.vertices), 2):
            part.uvs = np.asarray(uv)
        part.reflectance = _trimesh_material(name, visual.material)
    elif visual.kind == "vertex":
        part.colors = linear_from_srgb(np.asarray(visual.vertex_colors)[:, :3] / 255.0)
    elif visual.kind == "face":
        part.face_colors = linear_from_srgb(np.asarray(visual.face_colors)[:, :3] / 255.0)
    return part


def _given_normals(mesh: Any) -> NDArray[np.float64] | None:
    """Return vertex normals that are not merely what trimesh computes from the faces."""
    import trimesh

    if "vertex_normals" not in mesh._cache.cache:
        return None
    given = np.asarray(mesh.vertex_normals)
    computed = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).vertex_normals
    if given.shape != np.shape(mesh.vertices) or np.allclose(given, computed, atol=1e-6):
        return None
    return given


def _trimesh_material(name: str, material: Any) -> ColorSource | None:
    """Return the base colour of a trimesh material: linear factor times sRGB image."""
    import trimesh

    image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    value = getattr(material, "baseColorFactor", None)
    value = getattr(material, "diffuse", None) if value is None else value
    if value is not None and np.array_equal(value, trimesh.visual.color.DEFAULT_COLOR):
        value = None  # nobody chose it
    factor = np.ones(3) if value is None else np.asarray(value)[:3] / 255.0
    r, g, b = (float(x) for x in factor)
    constant = None if value is None else (r, g, b)
    if image is None:
        return constant
    try:
        if image.size == (2, 2) and (np.asarray(image) == trimesh.visual.color.DEFAULT_COLOR[: len(image.mode)]).all():
            return constant  # trimesh's stand-in for an image that is not there
        pixels = pixels_of(image)
    except (OSError, ValueError, SyntaxError) as error:
        warn(f"trimesh: {name}: texture left out: {first_line(error)}")
        return constant
    return ImageTexture(pixels * (factor if factor.any() else np.ones(3)).astype(np.float32), name)
