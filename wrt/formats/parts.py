"""What every mesh reader returns, and how it becomes shapes: one place for all the repairs."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.camera import Camera
from wrt.errors import InputError, one_line
from wrt.lights import Light
from wrt.materials import Diffuse, Material
from wrt.mesh import LARGEST, SMALLEST, Mesh, box_around, columns
from wrt.normals import CHUNK, with_normals
from wrt.scene import Shape
from wrt.textures import ColorSource, ImageTexture, VertexColor
from wrt.values import array

DEFAULT_REFLECTANCE = (0.62, 0.60, 0.57)
"""Reflectance of a mesh that brings no colour: unglazed clay, light enough to show its shading."""

FARTHEST = 20_000.0
"""Times its size that a mesh may be from the origin before its corners visibly snap to a grid."""

FloatArray = NDArray[np.floating[Any]]
IntArray = NDArray[np.integer[Any]]


class InputWarning(UserWarning):
    """A file is used, but something in it was left out; the message is one line."""


def warn(message: str) -> None:
    """Warn with an InputWarning; the line that it points to is never of interest."""
    warnings.warn(one_line(message), InputWarning, stacklevel=3)


@dataclass
class Part:
    """Triangles of one material as a reader found them: unchecked.

    Attributes:
        name: for messages.
        vertices: (N, 3) positions.
        faces: (M, 3) vertex indices.
        normals: (N, 3) or None; need not be unit or finite.
        uvs: (N, 2), (N, 4) for two sets, or None; v up.
        colors: (N, 3), (N, 4) with alpha, or None; linear Rec. 709; need not be finite.
        face_colors: (M, 3), (M, 4) or None, like `colors`.
        reflectance: a constant, or an image laid over `uvs`; None where the file names none.
        material: all that the file says, where it says more than a reflectance; it fits `uvs` and `colors`.
        two_sided: whether what shines does so on both sides.
        counted: what messages call a vertex, where its number is put in; loaders of some formats renumber them.
        places: (4, 4) matrices of where it stands, if in several places; else it lies in world space.
    """

    name: str
    vertices: FloatArray
    faces: IntArray
    normals: FloatArray | None = None
    uvs: FloatArray | None = None
    colors: FloatArray | None = None
    face_colors: FloatArray | None = None
    reflectance: ColorSource | None = None
    material: Material | None = None
    places: list[NDArray[np.float64]] = field(default_factory=list)
    two_sided: bool = False
    counted: str = "vertex {} (counted from 0)"


@dataclass
class Contents:
    """What is in a file.

    Attributes:
        parts: its triangles.
        lights: its lights without a mesh.
        cameras: its cameras, in their order.
    """

    parts: list[Part]
    lights: list[Light] = field(default_factory=list)
    cameras: list[Camera] = field(default_factory=list)


def to_shapes(path: str, parts: list[Part], crease_degrees: float | None) -> list[Shape]:
    """Check and repair parts, give them normals, and return a shape for each that has triangles.

    Args:
        path: the file, for messages.
        parts: what the reader found.
        crease_degrees: see `wrt.normals.with_normals`; None leaves meshes without normals flat.

    Raises:
        InputError: on vertices that are not finite, faces that name none, sizes that single precision cannot hold, or
            nothing left.
    """
    total = sum(len(part.faces) for part in parts)
    repaired = [_repaired(path, part) for part in parts if len(part.faces)]
    dropped = total - sum(len(part.faces) for part in repaired)
    repaired = [part for part in repaired if len(part.faces)]
    if not repaired:
        raise InputError(f"{path}: no triangles in it; there is nothing to render")
    if dropped:
        warn(f"{path}: {dropped} of {total} triangles are left out: they have corners at one place, and so no area")
    _check_size(path, repaired)
    meshes = [_mesh(path, part) for part in repaired]
    if crease_degrees is not None:
        meshes = _smooth(meshes, crease_degrees, {i for i, part in enumerate(repaired) if part.places})
    shapes = []
    for part, mesh in zip(repaired, meshes, strict=True):
        shape = _shape(part, mesh)
        shapes += [replace(shape, transform=place) for place in part.places] or [shape]
    return shapes


def placed(part: Part, places: list[NDArray[np.float64]]) -> Part:
    """Return a part as it stands in one place or in several, which is no reason to have it in memory several times."""
    return moved(part, places[0]) if len(places) == 1 else replace(part, places=places)


def in_the_world(shapes: list[Shape]) -> list[Shape]:
    """Return shapes without transforms: copies of what stands in several places."""
    return [s if s.transform is None else replace(s, mesh=s.mesh_at(0.0), transform=None) for s in shapes]


def merge(meshes: list[Mesh], name: str) -> Mesh:
    """Return one mesh of all triangles in order.

    Attributes that only some have are filled in: zeros for `uvs`, white for `colors`; `normals`
    stay only where all have them.
    """
    if len(meshes) == 1:
        return replace(meshes[0], name=name)
    offsets = np.cumsum([0] + [len(m.vertices) for m in meshes[:-1]])
    normals = [m.normals for m in meshes if m.normals is not None]
    return Mesh.taking(
        np.concatenate([m.vertices for m in meshes]),
        np.concatenate([m.faces.astype(np.int64) + o for m, o in zip(meshes, offsets, strict=True)]),
        np.concatenate(normals) if len(normals) == len(meshes) else None,
        _filled(meshes, "uvs", 0.0),
        _filled(meshes, "colors", 1.0),
        name,
    )


def _filled(meshes: list[Mesh], field: str, value: float) -> NDArray[np.float32] | None:
    widths = [getattr(m, field).shape[1] for m in meshes if getattr(m, field) is not None]
    return np.concatenate([columns(m, field, 0, max(widths), value) for m in meshes]) if widths else None


def moved(part: Part, matrix: NDArray[np.float64]) -> Part:
    """Return a part moved by a (4, 4) matrix; a mirrored one is turned so that fronts stay in front."""
    linear = matrix[:3, :3]
    mirrored = np.linalg.det(linear) < 0.0
    normals = part.normals
    if normals is not None:
        # The transposed inverse but for its scale; the cofactors exist for flattening transforms too.
        a, b, c = linear
        cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)])
        normals = (np.asarray(normals, np.float64) @ cofactors.T) * (-1.0 if mirrored else 1.0)
    vertices = np.asarray(part.vertices, np.float64) @ linear.T + matrix[:3, 3]
    return replace(part, vertices=vertices, faces=part.faces[:, ::-1] if mirrored else part.faces, normals=normals)


def rows_of(path: str | Path, value: Any, what: str, width: int) -> NDArray[Any]:
    """Return `value` as (N, width) numbers, or raise InputError: loaders hand on lists of lists of any length."""
    rows = array(value, f"{path}: {what}")
    if rows.ndim != 2 or rows.shape[1] != width or rows.dtype.kind not in "fiu":
        raise InputError(f"{path}: its {what} are not {width} numbers each")
    return rows


def checked_faces(path: str | Path, faces: IntArray, count: int) -> None:
    """Raise an InputError where a face names a vertex that is not one of `count`."""
    if faces.min() < 0 or faces.max() >= count:
        bad = faces.min() if faces.min() < 0 else faces.max()
        raise InputError(f"{path}: a face names vertex {bad}, but there are {count} (counted from 0)")


def positions_of(
    path: str | Path, vertices: FloatArray, faces: IntArray, who: str = "vertex {}", per: int = 1
) -> NDArray[np.float32]:
    """Return positions as float32.

    Args:
        path: the file, for messages.
        vertices: (N, 3) positions.
        faces: what uses them: those not used may be anywhere.
        who: what a message calls one; its number is put in.
        per: vertices to each number.

    Raises:
        InputError: where one that is used is not finite.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        result = np.ascontiguousarray(vertices, np.float32)
    if np.isfinite(result).all():
        return result
    bad = np.flatnonzero(~np.isfinite(result).all(axis=1))
    if len(bad):
        for index in bad[np.isin(bad, faces)][:1]:
            values = " ".join(f"{x:g}" for x in np.asarray(vertices)[index])
            name = who.format(index // per)
            raise InputError(f"{path}: {name} is at {values}; positions must be finite and at most 3.4e38")
    return result


def _check_size(path: str, parts: list[Part]) -> None:
    """Raise InputError where parts together are too large or too small for rays, and warn where they are far off."""
    with np.errstate(all="ignore"):
        corners = np.concatenate([_box_corners(part) for part in parts])
        low, high = corners.min(axis=0), corners.max(axis=0)
        size, reach = float(np.linalg.norm(high - low)), float(np.abs(corners).max())
    if not reach <= LARGEST:
        raise InputError(f"{path}: its vertices reach to {reach:g}, beyond the {LARGEST:g} of rays; scale it down")
    if size < SMALLEST:
        what = f"it is {size:g} across" if size else "all vertices are in one place"
        raise InputError(f"{path}: {what}; rays need a size of {SMALLEST:g} at least; scale it up")
    if reach > FARTHEST * size:
        step = reach * 2.0**-24 / size
        warn(
            f"{path}: it is {size:g} across and up to {reach:g} from the origin, where numbers in single precision are "
            f"{100.0 * step:.2g} % of its size apart; move it to the origin"
        )


def _box_corners(part: Part) -> NDArray[np.float64]:
    """Return (P, 3) corners of the box around a repaired part, in all places where it stands."""
    corners = np.stack(np.meshgrid(*box_around(part.vertices).T, indexing="ij"), axis=-1).reshape(-1, 3)
    return np.concatenate([corners @ m[:3, :3].T + m[:3, 3] for m in part.places] or [corners])


def _repaired(path: str, part: Part) -> Part:
    """Return a part of finite vertices, all in use, and faces that have three different corners."""
    count = len(rows_of(path, part.vertices, "vertices", 3))
    given = np.ascontiguousarray(part.faces)  # before they are looked at, since rows of files are apart
    checked_faces(path, given, count)
    faces = given.astype(np.int32, copy=False)
    vertices = positions_of(path, part.vertices, faces, part.counted)
    solid = _solid(vertices, faces)
    face_colors = part.face_colors
    if not solid.all():
        faces = faces[solid]
        face_colors = None if face_colors is None else np.asarray(face_colors)[solid]
    used, faces = _used(faces, count)

    def finite(what: str, rows: FloatArray | None) -> NDArray[np.float32] | None:
        if rows is not None and np.isfinite(rows).all():
            with np.errstate(over="ignore"):
                return np.asarray(rows, np.float32)
        if rows is not None:
            warn(f"{path}: {what} are left out, as some are not finite")
        return None

    def pick(rows: FloatArray | None) -> FloatArray | None:
        return rows if rows is None or used.all() else np.asarray(rows)[used]

    colors = finite("vertex colours", pick(part.colors))
    return replace(
        part,
        vertices=vertices if used.all() else vertices[used],
        faces=faces,
        normals=pick(part.normals),
        colors=None if colors is None else np.clip(colors, 0.0, 1.0),
        face_colors=finite("face colours", face_colors),
        uvs=finite("texture coordinates", pick(part.uvs)),
    )


def _used(faces: NDArray[np.int32], count: int) -> tuple[NDArray[np.bool_], NDArray[np.int32]]:
    """Return (count,) whether faces use a vertex, and the faces with those numbered that they use."""
    used = np.zeros(count, bool)
    used[faces] = True
    return used, faces if used.all() else (np.cumsum(used, dtype=np.int32) - np.int32(1)).take(faces)


def _solid(vertices: NDArray[np.float32], faces: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Return (M,) whether no two corners of a face are at one position: then they make no area.

    Thin triangles that have some are left alone.
    """
    solid = np.empty(len(faces), bool)
    for start in range(0, len(faces), CHUNK):
        part = slice(start, start + CHUNK)
        a, b, c = vertices.take(faces[part], axis=0).transpose(1, 2, 0)
        same = [(p[0] == q[0]) & (p[1] == q[1]) & (p[2] == q[2]) for p, q in ((a, b), (b, c), (c, a))]
        solid[part] = ~(same[0] | same[1] | same[2])
    return solid


def _mesh(path: str, part: Part) -> Mesh:
    """Return a repaired part as a mesh; normals may still be zero."""
    normals = part.normals
    if normals is not None:
        with np.errstate(over="ignore", invalid="ignore"):
            normals = np.asarray(normals, np.float32)
        # Zero stands for "none": with_normals computes those.
        if not np.isfinite(normals).all():
            normals = np.where(np.isfinite(normals).all(axis=1, keepdims=True), normals, np.float32(0.0))
    return Mesh.taking(part.vertices, part.faces, normals, part.uvs, part.colors, f"{Path(path).name}: {part.name}")


def _smooth(meshes: list[Mesh], crease_degrees: float, alone: set[int]) -> list[Mesh]:
    """Give every mesh normals; the ones without are smoothed together, so no seam shows between materials.

    Those numbered in `alone` lie in other spaces and have no seams with the rest.
    """
    bare = [i for i, mesh in enumerate(meshes) if mesh.normals is None and i not in alone]
    result = [mesh if i in bare else with_normals(mesh, crease_degrees) for i, mesh in enumerate(meshes)]
    if len(bare) == 1:
        result[bare[0]] = with_normals(meshes[bare[0]], crease_degrees)
    if len(bare) <= 1:
        return result
    whole = with_normals(merge([meshes[i] for i in bare], "mesh"), crease_degrees)
    stop = 0
    for i in bare:
        start, stop = stop, stop + len(meshes[i].faces)
        used, faces = _used(whole.faces[start:stop], len(whole.vertices))
        picked = {
            field: getattr(whole, field)[used] if getattr(meshes[i], field) is not None else None
            for field in ("uvs", "colors")
        }
        assert whole.normals is not None
        result[i] = Mesh.taking(whole.vertices[used], faces, whole.normals[used], name=meshes[i].name, **picked)
    return result


def _colored(colors: NDArray[np.float32]) -> Diffuse:
    """Return a matt material of a mesh's colours, as opaque as their alpha, if they have any."""
    return Diffuse(VertexColor(), opacity=VertexColor(alpha=True) if colors.shape[1] == 4 else 1.0)


def _shape(part: Part, mesh: Mesh) -> Shape:
    """Choose the material: a texture if it can be laid, else colours, else the constant."""
    if part.material is not None:
        return Shape(mesh, part.material, two_sided_emission=part.two_sided, name=mesh.name)
    reflectance = part.reflectance
    if isinstance(reflectance, ImageTexture):
        if mesh.uvs is not None:
            return Shape(mesh, Diffuse(reflectance), name=mesh.name)
        # Without coordinates the texture's average is the best constant.
        average = np.clip(reflectance.pixels.mean(axis=(0, 1), dtype=np.float64) * reflectance.factor, 0.0, 1.0)
        reflectance = tuple(float(x) for x in average)
    if part.face_colors is not None:
        corners = mesh.faces.reshape(-1)
        colors = np.repeat(np.clip(part.face_colors, 0.0, 1.0), 3, axis=0).astype(np.float32)
        split = Mesh.taking(
            mesh.vertices[corners],
            np.arange(len(corners), dtype=np.int32).reshape(-1, 3),
            None if mesh.normals is None else mesh.normals[corners],
            None if mesh.uvs is None else mesh.uvs[corners],
            colors,
            mesh.name,
        )
        return Shape(split, _colored(colors), name=mesh.name)
    if mesh.colors is not None:
        return Shape(mesh, _colored(mesh.colors), name=mesh.name)
    return Shape(mesh, Diffuse(DEFAULT_REFLECTANCE if reflectance is None else reflectance), name=mesh.name)
