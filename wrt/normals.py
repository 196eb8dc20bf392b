"""Shading normals for meshes that come without."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.mesh import Mesh

CREASE_LIMIT = 2_000_000
"""Faces above which no creases are looked for. Matching the edges of more would hold several
gigabytes for seconds, and scans of that size are smooth at the scale of their triangles."""

_Float = NDArray[np.float64]
_Int = NDArray[np.intp]


CREASE_DEGREES = 60.0
"""Edges sharper than this are creases: those of a box are, the ears of a scanned rabbit are not."""


def with_normals(mesh: Mesh, crease_degrees: float = CREASE_DEGREES) -> Mesh:
    """Return the mesh with a unit shading normal at every vertex.

    A mesh without normals gets the mean of the adjacent face normals, weighted by the angle of
    each face at the vertex (Thürmer and Wüthrich 1998, "Computing vertex normals from polygonal
    facets"), so that it does not depend on how a surface is cut into triangles. Faces that share
    an edge folded by more than the crease angle do not mix: where creases part the faces around
    a vertex, the vertex is split, one copy for each side. Vertices at the same position count as
    one, so seams of texture coordinates do not show.

    Given normals are made unit; zero or not finite ones are computed as above, without splits.

    Args:
        mesh: the mesh; its faces keep their order, its vertices may be split and reordered.
        crease_degrees: the largest fold that is still smooth; 180 and above smooths everything.
            Meshes of more than CREASE_LIMIT faces are smoothed everywhere.
    """
    normals_given = mesh.normals
    faces = mesh.faces.astype(np.intp)
    if normals_given is not None:
        unit, length = _unit(normals_given.astype(np.float64))
        missing = ~np.isfinite(length) | (length < 1e-20)
        if missing.any():
            computed = _smooth(mesh, faces, same_positions(mesh.vertices))
            unit[missing] = computed[missing]
        return replace(mesh, normals=unit.astype(np.float32))

    positions = same_positions(mesh.vertices)
    face_normals, angles = _face_normals(mesh, faces)
    corners = positions[faces].reshape(-1)
    if len(faces) > CREASE_LIMIT or crease_degrees >= 180.0:
        groups = corners
    else:
        groups = _smooth_groups(positions[faces], face_normals, crease_degrees)
    corner_normals = _corner_normals(groups, face_normals, angles)
    # A copy of a vertex for each different normal: corners of one group at one vertex share it.
    blank = ~np.any(corner_normals, axis=1)
    flat = np.repeat(face_normals, 3, axis=0)
    corner_normals[blank] = flat[blank]
    blank &= np.any(flat, axis=1)
    groups = np.where(blank, groups.max(initial=0) + 1 + np.arange(len(groups)), groups)
    key = faces.reshape(-1) * (int(groups.max(initial=0)) + 1) + groups
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    source = faces.reshape(-1)[first]
    chosen = corner_normals[first]
    chosen[~np.any(chosen, axis=1)] = (0.0, 1.0, 0.0)  # only faces without area meet here
    return replace(
        mesh,
        vertices=mesh.vertices[source],
        faces=inverse.reshape(-1, 3).astype(np.int32),
        normals=chosen.astype(np.float32),
        uvs=None if mesh.uvs is None else mesh.uvs[source],
        colors=None if mesh.colors is None else mesh.colors[source],
    )


def _unit(vectors: _Float) -> tuple[_Float, _Float]:
    """Return vectors at unit length (zero ones stay zero) and their lengths before."""
    length = np.linalg.norm(vectors, axis=-1)
    return vectors / np.where(length > 0.0, length, 1.0)[..., None], length


def vertex_normals(mesh: Mesh) -> _Float:
    """Return (N, 3) unit normals, weighted as in `with_normals`, without joins of positions or creases."""
    return _smooth(mesh, mesh.faces.astype(np.intp), np.arange(len(mesh.vertices)))


def following_normals(mesh: Mesh, vertices: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return (N, 3) unit normals of a mesh whose vertices have moved.

    Vertices that had position and normal in common still share their normal; where they had not, there was a crease.
    """
    assert mesh.normals is not None
    together = same_positions(np.hstack([mesh.vertices, mesh.normals]))
    moved = Mesh(vertices, mesh.faces, name=mesh.name)
    return _smooth(moved, mesh.faces.astype(np.intp), together).astype(np.float32)


def same_positions(vertices: NDArray[np.float32]) -> _Int:
    """Return (N,) an index, without gaps, that is the same for vertices at the same position."""
    bits = (vertices + np.float32(0.0)).view(np.uint32)  # adding 0 makes -0 and 0 the same
    order = np.lexsort(bits.T)
    ordered = bits[order]
    new = np.ones(len(bits), bool)
    new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    index = np.empty(len(bits), np.intp)
    index[order] = np.cumsum(new) - 1
    return index


def _face_normals(mesh: Mesh, faces: _Int) -> tuple[_Float, _Float]:
    """Return (M, 3) unit face normals, zero without area, and (M, 3) interior angles in radians."""
    points = mesh.vertices.astype(np.float64)
    # Scaled to unit size, so that products of tiny or huge edges stay inside float64.
    points = (points - points[0]) / (np.abs(points - points[0]).max() or 1.0)
    a, b, c = (points[faces[:, k]] for k in range(3))
    edges = (b - a, c - b, a - c)
    cross: _Float = np.cross(edges[0], -edges[2])
    normals, twice_area = _unit(cross)
    angles = np.empty((len(faces), 3))
    for k in range(3):
        # tan(angle) = |u x v| / u.v, exact for slivers where arccos is not
        angles[:, k] = np.arctan2(twice_area, -np.einsum("ij,ij->i", edges[k], edges[k - 1]))
    return normals, angles


def _smooth_groups(faces: _Int, face_normals: _Float, crease_degrees: float) -> NDArray[np.intp]:
    """Return (3M,) a label for each corner; corners joined through smooth edges share one.

    `faces` index positions. The two corners at either end of an edge are joined when the faces
    on its sides are at most the crease angle apart.
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
    # Faces without area have no direction to fold: they hand the join on.
    smooth = (cosine >= np.cos(np.deg2rad(crease_degrees)) - 1e-9) | ~n.any(axis=1) | ~m.any(axis=1)
    one, two = one[smooth], two[smooth]
    aligned = start[one] == start[two]
    ends = np.where(aligned, two, following[two]), np.where(aligned, following[two], two)
    return _connected(3 * count, np.concatenate([one, following[one]]), np.concatenate(ends))


def _connected(count: int, one: NDArray[Any], two: NDArray[Any]) -> NDArray[np.intp]:
    """Return (count,) the lowest index each index is joined to through the pairs.

    Hook the roots of each pair together, then halve all paths, until nothing changes
    (Shiloach and Vishkin 1982): a logarithmic number of rounds in practice.
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
    weighted = (face_normals[:, None, :] * angles[:, :, None]).reshape(-1, 3)
    size = int(groups.max(initial=0)) + 1
    sums: _Float = np.stack([np.bincount(groups, weights=weighted[:, k], minlength=size) for k in range(3)], axis=1)
    total = np.bincount(groups, weights=angles.reshape(-1), minlength=size)
    unit, length = _unit(sums)
    unit[length <= 1e-6 * total] = 0.0  # faces that look opposite ways leave only rounding
    return unit[groups]


def _smooth(mesh: Mesh, faces: _Int, positions: _Int) -> _Float:
    """Return (N, 3) unit normals without creases; up where a vertex has no face with an area."""
    face_normals, angles = _face_normals(mesh, faces)
    corner_normals = _corner_normals(positions[faces].reshape(-1), face_normals, angles)
    blank = ~np.any(corner_normals, axis=1)
    corner_normals[blank] = np.repeat(face_normals, 3, axis=0)[blank]
    result = np.tile(np.array([0.0, 1.0, 0.0]), (len(mesh.vertices), 1))
    solid = np.any(corner_normals, axis=1)
    result[faces.reshape(-1)[solid]] = corner_normals[solid]
    return result
