"""From the parts of a mesh file to shapes: all checks and repairs are here."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, warn
from wrt.io.mesh.creases import smoothed
from wrt.io.mesh.parts import DEFAULT_REFLECTANCE, FloatArray, Part, checked_faces, moved, rows_of
from wrt.io.mesh.points import is_cloud, spheres_of, with_radii
from wrt.linalg import norm, product
from wrt.scene.materials import Diffuse, Material
from wrt.scene.mesh import FARTHEST, LARGEST, SMALLEST, VERTEX_ATTRIBUTES, Mesh, box_around, far_away, merge
from wrt.scene.normals import CHUNK, CREASE_DEGREES
from wrt.scene.scene import Shape
from wrt.scene.textures import ColorSource, VertexColor

_SAMPLE, _NEARLY_ALL = 10_000, 0.99
"""Triangles of a part whose winding is compared with their normals, and the share that decides."""


def to_shapes(
    path: str, parts: list[Part], smooth_degrees: float | None = None, point_radius: float | None = None
) -> list[Shape]:
    """Check and repair parts, give them normals, and return a shape for each that has triangles.

    Args:
        path: the file, for messages.
        parts: the output of the reader.
        smooth_degrees: the largest fold that is smooth in parts without normals (see `wrt.scene.normals.with_normals`);
            0 leaves meshes as they are, None follows the file.
        point_radius: the radius of points; by default it follows from their distances.

    Raises:
        InputError: on vertices that are not finite, invalid indices, sizes beyond single precision, or no triangles.
    """
    total = sum(len(part.faces) for part in parts if not is_cloud(part))
    repaired = [_repaired(path, part) for part in parts if len(part.faces)]
    dropped = total - sum(len(part.faces) for part in repaired if not is_cloud(part))
    repaired = [part for part in repaired if len(part.faces)]
    if not repaired:
        raise InputError(f"{path}: no triangles in it; there is nothing to render")
    if dropped:
        warn(f"{path}: {dropped} of {total} triangles are left out: they have corners at one place, and so no area")
    repaired = with_radii(path, repaired, _extent(repaired)[2], point_radius)
    _check_size(path, repaired)
    repaired = _visible(path, repaired)
    if all(not part.double_sided and _winds_against_normals(part) for part in repaired):
        reason = "its triangles wind against their normals, so it is seen from inside"
        warn(f"{path}: {reason}; --double-sided, or double_sided of wrt.load, shows all sides")
    meshes = [_mesh(path, part) for part in repaired]
    if smooth_degrees is None:
        meshes = _smooth(meshes, repaired, CREASE_DEGREES)
    elif smooth_degrees > 0.0:
        meshes = _smooth(meshes, [replace(part, smoothing=None) for part in repaired], smooth_degrees)
    shapes = []
    for part, mesh in zip(repaired, meshes, strict=True):
        shape = _shape(part, mesh)
        if not part.double_sided:
            shape = replace(shape, double_sided=False)
        shapes += [replace(shape, transform=place) for place in part.places] or [shape]
    return shapes


def _visible(path: str, parts: list[Part]) -> list[Part]:
    """Return parts, opaque if all are invisible: some programs write d 0 in MTL files for opaque."""
    invisible = [part for part in parts if getattr(part.material, "opacity", 1.0) == 0.0]
    if len(invisible) < len(parts):
        if invisible:
            are = f"and {len(invisible) - 1} more are invisible: their" if invisible[1:] else "is invisible: its"
            warn(f"{path}: {invisible[0].name!r} {are} opacity is 0")
        return parts
    warn(f"{path}: all of it would be invisible, as the opacity of its materials is 0; it is shown opaque")
    opaque = {id(part.material): replace(part.material, opacity=1.0) for part in parts if part.material is not None}
    return [replace(part, material=opaque[id(part.material)]) for part in parts]


def _winds_against_normals(part: Part) -> bool:
    """Return whether the given normals of a part, at a sample of its triangles, are on the backs of nearly all."""
    if part.normals is None or is_cloud(part):
        return False
    faces = part.faces[:: 1 + len(part.faces) // _SAMPLE]
    first, second, third = (part.vertices[corner] for corner in faces.T)
    with np.errstate(all="ignore"):
        outside = np.asarray(part.normals)[faces].sum(axis=1)
        against = (np.cross(second - first, third - first) * outside).sum(axis=1) < 0.0
    return bool(against.mean() > _NEARLY_ALL)


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
    box = box_around(part.vertices) + np.max(part.radius, initial=0.0) * np.array([[-1.0], [1.0]])
    corners = np.stack(np.meshgrid(*box.T, indexing="ij"), axis=-1).reshape(-1, 3)
    return np.concatenate([product(corners, m[:3, :3].T) + m[:3, 3] for m in part.places] or [corners])


def _repaired(path: str, part: Part) -> Part:
    """Return a part with finite, used vertices only, and faces that have three distinct corners."""
    count = len(rows_of(path, part.vertices, "vertices", 3))
    indices = np.ascontiguousarray(part.faces)  # once, since rows of files are strided
    checked_faces(path, indices, count)
    if is_cloud(part):
        indices = _finite(path, part, indices)
    faces = indices.astype(np.int32, copy=False)
    vertices = _positions(path, part, faces)
    solid = _solid(vertices, faces)
    used, faces = _used(faces if solid.all() else faces[solid], count)

    def rows(name: str, chosen: NDArray[np.bool_], label: str = "") -> NDArray[Any] | None:
        """Return the chosen rows of an attribute; with a label only if they are finite, as single precision."""
        values = getattr(part, name)
        if values is None:
            return None
        values = values if chosen.all() else np.asarray(values)[chosen]
        if label and not np.isfinite(values).all():
            warn(f"{path}: {label} are left out, as some are not finite")
            return None
        with np.errstate(over="ignore"):
            return np.asarray(values, np.float32) if label else np.asarray(values)

    colors = rows("colors", used, "vertex colours")
    return replace(
        part,
        vertices=vertices if used.all() else vertices[used],
        faces=faces,
        normals=rows("normals", used),
        colors=None if colors is None else np.clip(colors, 0.0, 1.0),
        face_colors=rows("face_colors", solid, "face colours"),
        radius=part.radius[used] if isinstance(part.radius, np.ndarray) else part.radius,
        smoothing=rows("smoothing", solid) if isinstance(part.smoothing, np.ndarray) else part.smoothing,
        sides=rows("sides", solid),
        uvs=rows("uvs", used, "texture coordinates"),
        tangents=rows("tangents", used, "tangents") if _reads_tangents(part.material) else None,
    )


def _reads_tangents(material: Material | None) -> bool:
    """Return whether a material has a use for the tangents of a mesh."""
    if material is None:
        return False
    return material.needs_tangents or bool(material.normal_maps) or any(map(_reads_tangents, material.parts))


def _finite(path: str, part: Part, points: NDArray[Any]) -> NDArray[Any]:
    """Return the points at finite positions; scanners write others where they see nothing."""
    with np.errstate(over="ignore", invalid="ignore"):
        positions = np.asarray(part.vertices, np.float32)[points[:, 0]]
    finite = np.asarray(np.isfinite(positions).all(axis=1))
    if not finite.all():
        warn(
            f"{path}: {np.count_nonzero(~finite)} of {len(points)} points are left out: their positions are not finite"
        )
    return np.asarray(points[finite])


def _positions(path: str, part: Part, faces: NDArray[np.int32]) -> NDArray[np.float32]:
    """Return positions in single precision, or raise InputError where a vertex that is used is not finite."""
    with np.errstate(over="ignore", invalid="ignore"):
        positions = np.ascontiguousarray(part.vertices, np.float32)
    if np.isfinite(positions).all():
        return positions
    bad = np.flatnonzero(~np.isfinite(positions).all(axis=1))
    for index in bad[np.isin(bad, faces)][:1]:
        values = " ".join(f"{x:g}" for x in np.asarray(part.vertices)[index])
        name = part.vertex_format.format(index)
        raise InputError(f"{path}: {name} is at {values}; positions must be finite and at most 3.4e38")
    return positions


def _used(faces: NDArray[np.int32], count: int) -> tuple[NDArray[np.bool_], NDArray[np.int32]]:
    """Return (count,) whether each vertex is used, and the faces with used vertices renumbered."""
    used = np.zeros(count, bool)
    used[faces] = True
    return used, faces if used.all() else (np.cumsum(used, dtype=np.int32) - np.int32(1)).take(faces)


def _solid(vertices: NDArray[np.float32], faces: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Return (M,) whether the corners of each face are at three positions. Thin triangles with an area are kept."""
    solid = np.ones(len(faces), bool)
    if faces.shape[1] == 1:
        return solid
    for start in range(0, len(faces), CHUNK):
        part = slice(start, start + CHUNK)
        a, b, c = vertices.take(faces[part], axis=0).transpose(1, 2, 0)
        same = [(p[0] == q[0]) & (p[1] == q[1]) & (p[2] == q[2]) for p, q in ((a, b), (b, c), (c, a))]
        solid[part] = ~(same[0] | same[1] | same[2])
    return solid


def _mesh(path: str, part: Part) -> Mesh:
    """Return a repaired part as a mesh; normals may still be zero."""
    if is_cloud(part):
        return spheres_of(part, f"{Path(path).name}: {part.name}")
    normals = part.normals
    if normals is not None:
        with np.errstate(over="ignore", invalid="ignore"):
            normals = np.asarray(normals, np.float32)
        # Zero stands for "none": with_normals computes those.
        if not np.isfinite(normals).all():
            normals = np.where(np.isfinite(normals).all(axis=1, keepdims=True), normals, np.float32(0.0))
    name = f"{Path(path).name}: {part.name}"
    return Mesh.taking(part.vertices, part.faces, normals, part.uvs, part.colors, name, part.tangents, part.sides)


def _smooth(meshes: list[Mesh], parts: list[Part], angle: float) -> list[Mesh]:
    """Give meshes normals, unless they are flat.

    Those without are smoothed together, so that no seams show between materials, except for instances, which are in
    other spaces.
    """
    bare = [i for i, mesh in enumerate(meshes) if mesh.normals is None]
    flat = {i for i in bare if parts[i].smoothing is not None and not np.any(parts[i].smoothing)}
    together = [i for i in bare if i not in flat and not parts[i].places]
    kept = flat if len(together) < 2 else flat.union(together)
    groups: list[Any] = [part.smoothing for part in parts]
    result = [mesh if i in kept else smoothed(mesh, angle, groups[i]) for i, mesh in enumerate(meshes)]
    if len(together) < 2:
        return result
    has_groups = all(groups[i] is not None for i in together)  # an OBJ file has some in all parts, or in none
    merged_groups = np.concatenate([groups[i] for i in together]) if has_groups else None
    merged = smoothed(merge([meshes[i] for i in together], "mesh"), angle, merged_groups)
    assert merged.normals is not None
    stop = 0
    for i in together:
        start, stop = stop, stop + len(meshes[i].faces)
        used, faces = _used(merged.faces[start:stop], len(merged.vertices))
        missing = {name: None for name in VERTEX_ATTRIBUTES if name != "normals" and getattr(meshes[i], name) is None}
        result[i] = merged.reindexed(used, faces, name=meshes[i].name, sides=meshes[i].sides, **missing)
    return result


def _shape(part: Part, mesh: Mesh) -> Shape:
    """Choose the part's material, or its image if there are coordinates, else colours, else a constant."""
    if part.material is not None:
        return Shape(mesh, part.material, two_sided_emission=part.two_sided, name=mesh.name)
    image = part.reflectance
    if image is not None and mesh.uvs is not None:
        return Shape(mesh, Diffuse(image), name=mesh.name)
    if part.face_colors is not None:
        return bare_shape(_with_face_colors(mesh, part.face_colors))
    if image is None or mesh.colors is not None:
        return bare_shape(mesh)
    # Without texture coordinates, the mean of the texture is the best constant.
    mean = image.pixels.mean(axis=(0, 1), dtype=np.float64) * image.factor
    return Shape(mesh, Diffuse(tuple(np.clip(mean, 0.0, 1.0).tolist())), name=mesh.name)


def _with_face_colors(mesh: Mesh, face_colors: FloatArray) -> Mesh:
    """Return a mesh whose faces share no vertices, so that each has a colour."""
    corners = mesh.faces.reshape(-1)
    colors = np.repeat(np.clip(face_colors, 0.0, 1.0), 3, axis=0).astype(np.float32)
    faces = np.arange(len(corners), dtype=np.int32).reshape(-1, 3)
    return mesh.reindexed(corners, faces, colors=colors)


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
    opacity: ColorSource = VertexColor(alpha=True) if mesh.colors.shape[1] == 4 else 1.0
    return Shape(mesh, Diffuse(VertexColor(), opacity=opacity), name=mesh.name)
