"""Shading normals with creases, for meshes that have none."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.scene.mesh import Mesh, box_around
from wrt.values import sealed

CREASE_LIMIT = 2_000_000
"""Number of faces above which creases are not detected. Matching edges would take several gigabytes, and scans of
that size are smooth at the scale of their triangles."""

CHUNK = 1 << 13
"""Faces or vertices processed at a time, so that intermediate results fit a core's cache."""

_Float = NDArray[np.float64]
_Int = NDArray[np.intp]
_Vertices = NDArray[np.floating[Any]]
_Faces = NDArray[np.integer[Any]]


CREASE_DEGREES = 60.0
"""Edges folded by more than this are creases: those of a box are, those in the ears of a scanned rabbit are not."""


def with_normals(
    mesh: Mesh, crease_degrees: float = CREASE_DEGREES, smoothing: NDArray[np.integer[Any]] | None = None
) -> Mesh:
    """Return the mesh with a unit shading normal at every vertex.

    A mesh without normals gets the mean of the adjacent face normals, weighted by the angle of each face at the vertex
    (Thürmer and Wüthrich 1998, "Computing vertex normals from polygonal facets"), which is independent of the
    triangulation. Faces are not averaged across edges folded by more than the crease angle; a vertex on such a crease
    is split, one copy for each side. Vertices at the same position count as one, so texture seams do not show.

    Given normals are normalised; zero or non-finite ones are computed as above, without splits.

    Args:
        mesh: the mesh; its faces keep their order, its vertices may be split and reordered.
        crease_degrees: the largest fold that is still smooth; 180 and above smooths everything. Meshes of more than
            CREASE_LIMIT faces are smoothed everywhere.
        smoothing: (M,) smoothing groups of the faces, which replace the angle: the faces of one group around a position
            share a normal, and those of group 0 are flat.
    """
    if mesh.normals is not None:
        return replace(mesh, normals=sealed(_made_unit(mesh)))
    positions = same_positions(mesh.vertices)
    if len(mesh.faces) > CREASE_LIMIT and smoothing is None:
        normals = _group_normals(mesh.vertices, mesh.faces, positions).astype(np.float32).T.take(positions, axis=0)
        if _any(normals).all():
            return replace(mesh, normals=sealed(normals))
    faces = mesh.faces.astype(np.intp)
    # Zero for faces without area; and interior angles in radians.
    face_normals, angles = np.empty(faces.shape), np.empty(faces.shape)
    for part, some_normals, some_angles in _faces_in_chunks(mesh.vertices, mesh.faces):
        face_normals[part], angles[part] = some_normals.T, some_angles.T
    corners = positions[faces].reshape(-1)
    if smoothing is not None:
        groups = corners * (int(smoothing.max()) + 1) + np.repeat(smoothing, 3)
        groups = np.where(np.repeat(smoothing, 3) > 0, groups, groups.max() + 1 + np.arange(len(groups)))
        groups = np.unique(groups, return_inverse=True)[1]
    elif len(faces) > CREASE_LIMIT or crease_degrees >= 180.0:
        groups = corners
    else:
        groups = _smooth_groups(positions[faces], face_normals, crease_degrees)
    corner_normals = _corner_normals(groups, face_normals, angles)
    # A copy of a vertex for each different normal: corners of one group at one vertex share it.
    blank = ~_any(corner_normals)
    flat = np.repeat(face_normals, 3, axis=0)
    corner_normals[blank] = flat[blank]
    blank &= _any(flat)
    groups = np.where(blank, groups.max(initial=0) + 1 + np.arange(len(groups)), groups)
    key = faces.reshape(-1) * (int(groups.max(initial=0)) + 1) + groups
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    source = faces.reshape(-1)[first]
    chosen = corner_normals[first]
    chosen[~_any(chosen)] = (0.0, 1.0, 0.0)  # all faces around it are degenerate
    return mesh.reindexed(source, inverse.reshape(-1, 3).astype(np.int32), normals=chosen.astype(np.float32))


def _made_unit(mesh: Mesh) -> NDArray[np.float32]:
    """Return the given normals, normalised, with missing ones computed."""
    assert mesh.normals is not None
    result = np.empty((len(mesh.vertices), 3), np.float32)
    missing = np.zeros(len(result), bool)
    for part in _chunks(len(result)):
        normals = mesh.normals[part].astype(np.float64)
        length = np.linalg.norm(normals, axis=1)
        result[part] = normals / np.where(length > 0.0, length, 1.0)[:, None]
        missing[part] = ~np.isfinite(length) | (length < 1e-20)
    if missing.any():
        computed = _smooth(mesh, same_positions(mesh.vertices))
        result[missing] = computed[missing]
    return result


def _chunks(count: int) -> Iterator[slice]:
    """Return slices of CHUNK rows that together cover `count` rows."""
    return (slice(start, min(start + CHUNK, count)) for start in range(0, count, CHUNK))


def vertex_normals(mesh: Mesh) -> _Float:
    """Return (N, 3) unit normals, weighted as in `with_normals`, without merging positions and without creases."""
    return _smooth(mesh, np.arange(len(mesh.vertices)))


def corner_weighted_normals(vertices: _Float, faces: _Faces) -> _Float:
    """Return (N, 3) unit normals as `vertex_normals`, of vertices in double precision; zero where they cancel."""
    return _group_normals(vertices, faces, np.arange(len(vertices))).T


def following_normals(mesh: Mesh, vertices: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return (N, 3) unit normals of a mesh whose vertices have moved.

    Vertices that shared position and normal still share their normal; others are on different sides of a crease.
    """
    assert mesh.normals is not None
    together = same_positions(np.hstack([mesh.vertices, mesh.normals]))
    moved = Mesh(vertices, mesh.faces, name=mesh.name)
    return _smooth(moved, together).astype(np.float32)


def through_normals(mesh: Mesh, gradient: _Float) -> _Float:
    """Return (N, 3) derivatives by the vertices of a mesh, from those by the normals that follow them."""
    assert mesh.normals is not None
    together = same_positions(np.hstack([mesh.vertices, mesh.normals]))
    corners = mesh.vertices.astype(np.float64)[mesh.faces]
    edges = np.roll(corners, -1, axis=1) - corners  # from each corner to the next
    back = -np.roll(edges, 1, axis=1)  # and to the one before
    across = np.cross(edges[:, 0], back[:, 0])
    size = np.linalg.norm(across, axis=1)
    solid = size > 0.0
    across, size, edges, back, faces = (each[solid] for each in (across, size, edges, back, mesh.faces))
    groups = together[faces]
    units = across / size[:, None]
    angles = np.arctan2(size[:, None], (edges * back).sum(axis=2))
    total, of_groups = np.zeros((2, len(mesh.vertices), 3))
    np.add.at(total, groups, angles[..., None] * units[:, None])
    np.add.at(of_groups, together, gradient)
    length = np.maximum(np.linalg.norm(total, axis=1, keepdims=True), np.finfo(float).tiny)
    normals = total / length
    of_groups = (of_groups - normals * (normals * of_groups).sum(axis=1, keepdims=True)) / length
    by_sums = of_groups[groups]  # of each corner, by the sum to which it adds
    by_units = (angles[..., None] * by_sums).sum(axis=1)
    by_across = (by_units - units * (units * by_units).sum(axis=1, keepdims=True)) / size[:, None]
    by_angles = (by_sums * units[:, None]).sum(axis=2, keepdims=True)
    by_edges = -by_angles * np.cross(units[:, None], edges) / (edges**2).sum(axis=2, keepdims=True)
    by_back = by_angles * np.cross(units[:, None], back) / (back**2).sum(axis=2, keepdims=True)
    by_edges[:, 0] += np.cross(back[:, 0], by_across)
    by_back[:, 0] += np.cross(by_across, edges[:, 0])
    found = np.zeros((len(mesh.vertices), 3))
    np.add.at(found, faces, np.roll(by_edges, 1, axis=1) + np.roll(by_back, -1, axis=1) - by_edges - by_back)
    return found


def same_positions(vertices: NDArray[np.float32]) -> _Int:
    """Return (N,) indices, numbered without gaps, that are equal for vertices at the same position."""
    count = len(vertices)
    keys = np.empty(count, np.uint64)
    for part in _chunks(count):
        keys[part] = _keys(vertices[part])
    ordered = np.sort(keys)
    repeated = ordered[1:][ordered[1:] == ordered[:-1]]
    if not len(repeated):
        return np.arange(count)
    # Only rows with repeated keys matter; if they are few, looking them up is faster than sorting all.
    rows = np.arange(count)
    if len(repeated) < count // 64:
        rows = np.flatnonzero(repeated.take(np.searchsorted(repeated, keys), mode="clip") == keys)
    rows = rows[np.argsort(keys[rows], kind="stable")]
    if (_any(vertices[rows[1:]] != vertices[rows[:-1]]) & (keys[rows[1:]] == keys[rows[:-1]])).any():
        rows = np.lexsort(vertices.T)  # a hash collision
    new = np.ones(len(rows), bool)
    new[1:] = _any(vertices[rows[1:]] != vertices[rows[:-1]])
    # Map each row to the first of its run, then number the first ones.
    index = np.arange(count)
    index[rows] = rows[new][np.cumsum(new) - 1]
    return np.asarray((np.cumsum(index == np.arange(count)) - 1).take(index))


def _keys(rows: NDArray[np.float32]) -> NDArray[np.uint64]:
    """Return a hash for each row of numbers."""
    keys = np.zeros(len(rows), np.uint64)
    for column in (rows.T + np.float32(0.0)).view(np.uint32):  # adding 0 makes -0 equal to 0
        keys = (keys ^ column) * np.uint64(0x9E3779B97F4A7C15)
        keys ^= keys >> np.uint64(29)
    return keys


def _faces_in_chunks(vertices: _Vertices, faces: _Faces) -> Iterator[tuple[slice, _Float, _Float]]:
    """Yield the normals and angles of a chunk of faces at a time.

    Yields:
        The slice of faces; their (3, n) unit normals, a row for each axis, zero for faces without area; and their
        (3, n) interior angles, radians, a row for each corner.
    """
    first = vertices[0].astype(np.float64)
    # The largest distance along an axis from there, so that products of tiny or huge edges stay inside float64.
    scale = float(np.abs(box_around(vertices) - first).max()) or 1.0
    for part in _chunks(len(faces)):
        corners = (vertices.take(faces[part], axis=0) - first) / scale
        a, b, c = np.ascontiguousarray(corners.transpose(1, 2, 0))
        edges = (b - a, c - b, a - c)
        (ux, uy, uz), (vx, vy, vz) = edges[0], -edges[2]
        cross = np.stack([uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx])
        twice_area = _length(cross)
        normals = cross / np.where(twice_area > 0.0, twice_area, 1.0)
        angles = np.empty(normals.shape)
        for k in range(3):
            # tan(angle) = |u x v| / u.v, exact for slivers where arccos is not
            (ux, uy, uz), (vx, vy, vz) = edges[k], edges[k - 1]
            angles[k] = np.arctan2(twice_area, -(ux * vx + uy * vy + uz * vz))
        yield part, normals, angles


def _length(vectors: _Float) -> _Float:
    """Return (n,) lengths of (3, n) vectors."""
    x, y, z = vectors
    length: _Float = np.sqrt(x * x + y * y + z * z)
    return length


def _group_normals(vertices: _Vertices, faces: _Faces, groups: _Int) -> _Float:
    """Return (3, G) unit normals of groups of vertices: the angle-weighted mean over all their corners.

    The normal is zero where the mean cancels or no face has an area.
    """
    size = int(groups.max(initial=0)) + 1
    # Complex pairs halve the number of memory accesses.
    sums = np.zeros((2, size), np.complex128)
    for part, (x, y, z), angles in _faces_in_chunks(vertices, faces):
        for corners, angle in zip(faces[part].T, angles, strict=True):
            of_corners = groups.take(corners)
            np.add.at(sums[0], of_corners, (x + 1j * y) * angle)
            np.add.at(sums[1], of_corners, (z + 1j) * angle)
    return _mean(np.stack([sums[0].real, sums[0].imag, sums[1].real]), sums[1].imag)


def _smooth_groups(faces: _Int, face_normals: _Float, crease_degrees: float) -> NDArray[np.intp]:
    """Return (3M,) labels of corners, equal for corners joined through smooth edges.

    `faces` index positions. The two corners at either end of an edge are joined if its faces are at most the crease
    angle apart.
    """
    count = len(faces)
    start = faces.reshape(-1)
    corner = np.arange(3 * count)
    following = corner - corner % 3 + (corner + 1) % 3
    end = start[following]
    low, high = np.minimum(start, end), np.maximum(start, end)
    order = np.argsort(low * (int(start.max()) + 1) + high, kind="stable")
    same = (low[order[1:]] == low[order[:-1]]) & (high[order[1:]] == high[order[:-1]])
    one, two = order[:-1][same], order[1:][same]
    n, m = face_normals[one // 3], face_normals[two // 3]
    cosine = np.einsum("ij,ij->i", n, m)
    # Degenerate faces have no normal; they join their neighbours.
    smooth = (cosine >= np.cos(np.deg2rad(crease_degrees)) - 1e-9) | ~_any(n) | ~_any(m)
    one, two = one[smooth], two[smooth]
    aligned = start[one] == start[two]
    ends = np.where(aligned, two, following[two]), np.where(aligned, following[two], two)
    return _connected(3 * count, np.concatenate([one, following[one]]), np.concatenate(ends))


def _connected(count: int, one: NDArray[Any], two: NDArray[Any]) -> NDArray[np.intp]:
    """Return (count,) the lowest index that each index is connected to through the pairs.

    Hook the roots of each pair together, then halve all paths, until nothing changes (Shiloach and Vishkin 1982).
    In practice the number of rounds is logarithmic.
    """
    parent = np.arange(count)
    while True:
        a, b = parent[one], parent[two]
        different = a != b
        if not different.any():
            return parent
        one, two = one[different], two[different]
        a, b = a[different], b[different]
        np.minimum.at(parent, np.maximum(a, b), np.minimum(a, b))
        while True:
            above = parent[parent]
            if np.array_equal(above, parent):
                break
            parent = above


def _corner_normals(groups: NDArray[np.intp], face_normals: _Float, angles: _Float) -> _Float:
    """Return (3M, 3) unit normals: the angle-weighted mean over each group; zero where it cancels."""
    size = int(groups.max(initial=0)) + 1
    angle = angles.reshape(-1)
    weights = [np.repeat(column, 3) * angle for column in face_normals.T]
    sums = [np.bincount(groups, weights=each, minlength=size).astype(np.float64) for each in (*weights, angle)]
    return _mean(np.stack(sums[:3]), sums[3]).T.take(groups, axis=0)


def _mean(sums: _Float, total: _Float) -> _Float:
    """Make (3, G) angle-weighted sums unit normals, zero where they cancel; `total` is the sum of the angles."""
    length = _length(sums)
    length[length <= 1e-6 * total] = np.inf  # opposite faces leave only rounding errors
    sums /= length
    return sums


def _any(rows: NDArray[Any]) -> NDArray[np.bool_]:
    """Return (N,) whether each of (N, K) rows has a non-zero element."""
    return functools.reduce(np.logical_or, rows.T)


def _smooth(mesh: Mesh, groups: _Int) -> _Float:
    """Return (N, 3) unit normals without creases.

    If the normals around a group of vertices cancel, the last face's is used; if all faces are degenerate, (0, 1, 0).
    """
    result = _group_normals(mesh.vertices, mesh.faces, groups).T.take(groups, axis=0)
    blank = ~_any(result)
    if blank.any():
        result[blank] = (0.0, 1.0, 0.0)
        for part, normals, _ in _faces_in_chunks(mesh.vertices, mesh.faces):
            solid = _any(normals.T)
            for index in mesh.faces[part][solid].T:
                mended = blank[index]
                result[index[mended]] = normals.T[solid][mended]
    return result
