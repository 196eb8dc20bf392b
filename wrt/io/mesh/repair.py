"""From the parts of a mesh file to shapes: all checks and repairs are here."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, warn
from wrt.io.mesh.parts import DEFAULT_REFLECTANCE, FloatArray, Part, checked_faces, moved, positions_of, rows_of
from wrt.linalg import norm, product
from wrt.scene.materials import Diffuse
from wrt.scene.mesh import FARTHEST, LARGEST, SMALLEST, Mesh, box_around, far_away, merge
from wrt.scene.normals import CHUNK, with_normals
from wrt.scene.scene import Shape
from wrt.scene.textures import ImageTexture, VertexColor


def to_shapes(path: str, parts: list[Part], crease_degrees: float | None) -> list[Shape]:
    """Check and repair parts, give them normals, and return a shape for each that has triangles.

    Args:
        path: the file, for messages.
        parts: the output of the reader.
        crease_degrees: see `wrt.scene.normals.with_normals`; None leaves meshes without normals flat.

    Raises:
        InputError: on vertices that are not finite, invalid indices, sizes beyond single precision, or no triangles.
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
    repaired = _visible(path, repaired)
    meshes = [_mesh(path, part) for part in repaired]
    if crease_degrees is not None:
        meshes = _smooth(meshes, crease_degrees, {i for i, part in enumerate(repaired) if part.places})
    shapes = []
    for part, mesh in zip(repaired, meshes, strict=True):
        shape = _shape(part, mesh)
        shapes += [replace(shape, transform=place) for place in part.places] or [shape]
    return shapes


def _visible(path: str, parts: list[Part]) -> list[Part]:
    """Return parts, opaque if all are invisible: some programs write d 0 in MTL files for opaque."""
    unseen = [part for part in parts if getattr(part.material, "opacity", 1.0) == 0.0]
    if len(unseen) < len(parts):
        if unseen:
            first, more = f"{path}: {unseen[0].name!r}", len(unseen) - 1
            warn(
                f"{first} and {more} more are invisible: their opacity is 0"
                if more
                else f"{first} is invisible: its opacity is 0"
            )
        return parts
    warn(f"{path}: all of it would be invisible, as the opacity of its materials is 0; it is shown opaque")
    opaque = {id(part.material): replace(part.material, opacity=1.0) for part in parts if part.material is not None}
    return [replace(part, material=opaque[id(part.material)]) for part in parts]


def near_origin(parts: list[Part]) -> list[Part]:
    """Return parts moved to the origin together, in double precision, if they are too far from it for single."""
    low, high, size, reach = _extent([part for part in parts if len(part.vertices)])
    if not reach > FARTHEST * size:
        return parts
    shift = np.eye(4)
    shift[:3, 3] = -0.5 * (low + high)
    return [
        replace(part, places=[product(shift, place) for place in part.places]) if part.places else moved(part, shift)
        for part in parts
    ]


def _check_size(path: str, parts: list[Part]) -> None:
    """Raise InputError where parts together are too large or too small for rays; warn far from the origin."""
    _, _, size, reach = _extent(parts)
    if not reach <= LARGEST:
        raise InputError(f"{path}: its vertices reach to {reach:g}, beyond the {LARGEST:g} of rays; scale it down")
    if size < SMALLEST:
        what = f"it is {size:g} across" if size else "all vertices are in one place"
        raise InputError(f"{path}: {what}; rays need a size of {SMALLEST:g} at least; scale it up")
    if far := far_away(path, size, reach):
        warn(far)


def _extent(parts: list[Part]) -> tuple[FloatArray, FloatArray, float, float]:
    """Return the least and greatest corner of parts together, the distance between both, and the largest coordinate."""
    with np.errstate(all="ignore"):
        corners = np.concatenate([_box_corners(part) for part in parts] or [np.zeros((1, 3))])
        low, high = corners.min(axis=0), corners.max(axis=0)
        return low, high, norm(high - low), float(np.abs(corners).max())


def _box_corners(part: Part) -> NDArray[np.float64]:
    """Return (P, 3) corners of the bounding boxes of all instances of a repaired part."""
    corners = np.stack(np.meshgrid(*box_around(part.vertices).T, indexing="ij"), axis=-1).reshape(-1, 3)
    return np.concatenate([product(corners, m[:3, :3].T) + m[:3, 3] for m in part.places] or [corners])


def _repaired(path: str, part: Part) -> Part:
    """Return a part with finite, used vertices only, and faces that have three distinct corners."""
    count = len(rows_of(path, part.vertices, "vertices", 3))
    given = np.ascontiguousarray(part.faces)  # once, since rows of files are strided
    checked_faces(path, given, count)
    faces = given.astype(np.int32, copy=False)
    vertices = positions_of(path, part.vertices, faces, part.vertex_format)
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
    """Return (count,) whether each vertex is used, and the faces with used vertices renumbered."""
    used = np.zeros(count, bool)
    used[faces] = True
    return used, faces if used.all() else (np.cumsum(used, dtype=np.int32) - np.int32(1)).take(faces)


def _solid(vertices: NDArray[np.float32], faces: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Return (M,) whether the corners of each face are at three positions. Thin triangles with an area are kept."""
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
    """Give every mesh normals; those without are smoothed together, so that no seams show between materials.

    Meshes numbered in `alone` are in other spaces, and smoothed by themselves.
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
    """Return a diffuse material of the vertex colours, with their alpha, if any, as opacity."""
    return Diffuse(VertexColor(), opacity=VertexColor(alpha=True) if colors.shape[1] == 4 else 1.0)


def _shape(part: Part, mesh: Mesh) -> Shape:
    """Choose the material: the texture if there are coordinates, else the colours, else the constant."""
    if part.material is not None:
        return Shape(mesh, part.material, two_sided_emission=part.two_sided, name=mesh.name)
    reflectance = part.reflectance
    if isinstance(reflectance, ImageTexture):
        if mesh.uvs is not None:
            return Shape(mesh, Diffuse(reflectance), name=mesh.name)
        # Without texture coordinates, the mean of the texture is the best constant.
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
    if reflectance is None or mesh.colors is not None:
        return bare_shape(mesh)
    return Shape(mesh, Diffuse(reflectance), name=mesh.name)


def bare_shape(mesh: Mesh) -> Shape:
    """Return the shape of a mesh that brings no material: matt, in its vertex colours if it has any.

    Raises:
        InputError: if a colour is not from 0 to 1.
    """
    if mesh.colors is None:
        return Shape(mesh, Diffuse(DEFAULT_REFLECTANCE), name=mesh.name)
    low, high = mesh.colors.min(), mesh.colors.max()
    if low < 0.0 or high > 1.0:
        raise InputError(f"{mesh.name}: colors must be linear, from 0 to 1; they are from {low:g} to {high:g}")
    return Shape(mesh, _colored(mesh.colors), name=mesh.name)
