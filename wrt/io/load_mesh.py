"""Load mesh files and trimesh objects as scenes.

Units become metres where a file states them: in 3MF, COLLADA, STEP and USD; glTF has metres. Axes are kept, because
formats disagree about them and most do not state them; only those of USD are converted.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from wrt.errors import OF_TRIMESH, InputError
from wrt.io import memory_limits
from wrt.io.archives import unpacked, unpacking
from wrt.io.cameras import unique
from wrt.io.file_type import (
    ANIMATED_SUFFIXES,
    ARRAYS_SUFFIX,
    GLTF_SUFFIXES,
    MESH_SUFFIXES,
    STEP_SUFFIXES,
    USD_SUFFIXES,
    advice_on,
    hinting,
)
from wrt.io.mesh.parts import NO_ANIMATION, Contents
from wrt.io.mesh.repair import bare_shape, near_origin, to_shapes
from wrt.io.safe_read import PathLike, naming_file, read_file, require_file
from wrt.scene.exact.spheres import Spheres
from wrt.scene.mesh import Mesh, merge
from wrt.scene.scene import Scene, Shape, bake_transforms


def load_mesh(source: Any, *, smooth_degrees: float | None = None, file_type: str | None = None) -> Mesh:
    """Read all triangles of a file or a trimesh object as one mesh in world space, without its materials.

    Args:
        source: the path of a mesh file or of an archive with one; bytes or an open file; or an object of trimesh,
            PyVista, Open3D, or with `vertices` and `faces`.
        smooth_degrees: as for `load`.
        file_type: type of bytes, or of an open file without a name, such as "stl".

    Raises:
        InputError: when the file cannot be read, is damaged, or has no triangles, or the source is another type.
    """
    with unpacked(source, file_type) as file:
        if isinstance(file, (str, os.PathLike)):
            shapes, name = load_shapes(file, smooth_degrees=smooth_degrees), Path(file).name
        else:
            shapes, name = bake_transforms(from_trimesh(source, smooth_degrees=smooth_degrees)), OF_TRIMESH
    meshes = [shape.mesh for shape in shapes if not isinstance(shape.mesh, Spheres)]
    if not meshes:
        raise InputError(f"{name}: it has points and no triangles; wrt.load makes spheres of them")
    return merge(meshes, name)


def load_shapes(path: PathLike, *, smooth_degrees: float | None = None) -> list[Shape]:
    """Read a file as one shape for each of its parts, in world space; see `load_file`."""
    return bake_transforms(load_file(path, smooth_degrees=smooth_degrees).shapes)


@unpacking
@memory_limits.one_load()
def load_file(
    path: PathLike,
    *,
    smooth_degrees: float | None = None,
    time: float | None = None,
    standalone: bool = False,
    in_place: bool = False,
    point_radius: float | None = None,
    up: str | None = None,
) -> Scene:
    """Read a file as one shape for each of its parts, with its materials, its lights and its first camera.

    Instances are shapes that share a mesh, each with a transform.

    The reflectance is the first of these that the file has: a texture, vertex or face colours, a constant,
    DEFAULT_REFLECTANCE. A missing texture or material file causes an InputWarning, and the next of these is used.

    Args:
        path: the file; see `load_mesh`.
        smooth_degrees: see `load_mesh`.
        time: the time of the file's first animation, seconds; None for the scene at rest, of USD at the first time.
        standalone: whether the file is shown by itself. If it lies far from the origin, such as a map in metres, it is
            then moved there unless it has lights or cameras: positions are exact to a part of its size, not of the
            distance.
            Arrays have the material of mesh files instead of a shape's default.
        in_place: whether it stays where it is all the same.
        point_radius: the radius of points, in the file's units; by default it follows from their distances.
        up: the axis that points up in a USD file, instead of the one that it declares.
    """
    file = Path(path)
    suffix = file.suffix.lower()
    require_file(file)
    if time is not None and suffix not in ANIMATED_SUFFIXES:
        raise InputError(f"{file}: {NO_ANIMATION}")
    if suffix == ARRAYS_SUFFIX:
        from wrt.io.npy import read_mesh_arrays

        with hinting(file):
            mesh = read_mesh_arrays(file)
            return Scene([bare_shape(mesh) if standalone else Shape(mesh, name=file.stem)])
    if suffix in USD_SUFFIXES:
        from wrt.io.usd.reader import read_usd

        with naming_file(file):
            contents, environment = read_usd(file, time, up)
            scene = _scene(str(file), contents, smooth_degrees, point_radius=point_radius)
            scene.environment = environment
            return scene
    if suffix not in MESH_SUFFIXES:
        unknown = f"not a known mesh format; the name must end in {', '.join(MESH_SUFFIXES)}"
        raise InputError(f"{file}: {advice_on(file) or unknown}")
    with naming_file(file), hinting(file):
        contents = _contents(file, read_file(file), time)
        return _scene(
            str(file), contents, smooth_degrees, movable=standalone and not in_place, point_radius=point_radius
        )


def _contents(file: Path, data: bytes, time: float | None) -> Contents:
    """Return what a file contains. Each reader is imported when it is needed, since all of them take 0.03 s."""
    suffix = file.suffix.lower()
    if suffix in GLTF_SUFFIXES:
        from wrt.io.gltf.reader import read_gltf

        return read_gltf(file, data, time)
    if suffix == ".3mf":
        from wrt.io.mesh.threemf import read_3mf

        return read_3mf(file, data)
    if suffix in STEP_SUFFIXES:
        from wrt.io.gltf.step import read_step

        return read_step(file, data)
    if suffix == ".dae":
        from wrt.io.mesh.collada import read_collada

        return read_collada(file, data)
    if suffix == ".obj":
        from wrt.io.mesh.obj import read_obj as read
    elif suffix == ".ply":
        from wrt.io.mesh.ply import read_ply as read
    elif suffix == ".stl":
        from wrt.io.mesh.stl import read_stl as read
    else:
        from wrt.io.mesh.off import read_off as read
    return Contents(read(file, data))


@unpacking
@memory_limits.one_load()
def animation_of(path: PathLike) -> tuple[float, float] | None:
    """Return the times of the first and last keyframe of a file's first animation, seconds; None if there is none.

    Raises:
        InputError: when the file cannot be read or is damaged.
    """
    file = Path(path)
    suffix = file.suffix.lower()
    if suffix not in ANIMATED_SUFFIXES:
        return None
    require_file(file)
    if suffix in USD_SUFFIXES:
        from wrt.io.usd import reader as usd

        with naming_file(file):
            return usd.animation_ends(file)
    from wrt.io.gltf.reader import animation_ends

    with naming_file(file), hinting(file):
        return animation_ends(file, read_file(file))


def load_object(
    source: Any,
    *,
    smooth_degrees: float | None = None,
    standalone: bool = False,
    in_place: bool = False,
    point_radius: float | None = None,
) -> Scene:
    """Read a `trimesh.Trimesh` or `trimesh.Scene` as `load_file` would read its file; see `wrt.io.trimesh_objects`.

    Objects of other libraries become those of trimesh, see `wrt.io.other_libraries`.

    Instances become shapes that share a mesh, each with a transform; all others are in world space. Vertex and face
    colours are sRGB, or linear if the object was loaded from glTF or has a PBRMaterial. Given normals are kept; normals
    that trimesh computes are not, because they smooth every edge. Points are drawn as
    spheres, and paths left out with a warning.
    """
    from wrt.io.other_libraries import as_trimesh
    from wrt.io.trimesh_objects import read_object

    contents = read_object(as_trimesh(source))
    return _scene(OF_TRIMESH, contents, smooth_degrees, movable=standalone and not in_place, point_radius=point_radius)


def from_trimesh(source: Any, *, smooth_degrees: float | None = None) -> list[Shape]:
    """Return the shapes of a `trimesh.Trimesh` or `trimesh.Scene`; see `load_object`."""
    return load_object(source, smooth_degrees=smooth_degrees).shapes


def _scene(
    path: str,
    contents: Contents,
    smooth_degrees: float | None,
    *,
    movable: bool = False,
    point_radius: float | None = None,
) -> Scene:
    movable = movable and not (contents.lights or contents.cameras)
    shapes = to_shapes(path, near_origin(contents.parts) if movable else contents.parts, smooth_degrees, point_radius)
    names = unique(name for name, _ in contents.cameras)
    cameras = dict(zip(names, (camera for _, camera in contents.cameras), strict=True))
    return Scene(shapes, contents.lights, camera=next(iter(cameras.values()), None), cameras=cameras)
