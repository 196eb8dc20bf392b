"""Rays against instances of meshes in float64, and bounds on the rounding errors of float32.

A ray that reaches an instance is moved into its mesh's space in float32, and there tested like any other.
So beside the rounding of the test, `support.exact_rays.woop`, there is that of the moved ray: of its origin
M o + m and of its direction M d, for M and m the inverse of where the mesh stands. Of the five operations
that a number passes on its way into a sum of three products and an offset, the first rounds M or m itself:

    |δo| ≤ 5 e (|M| |o| + |m|),    |δd| ≤ 4 e |M| |d|,    e = 2⁻²⁴.

With A, B, C the corners seen from the origin and N the normal, an edge function is d · (B × C) over the
direction's main component, and t = (A · N) / (d · N). A moved origin moves all corners alike, and so
B × C by δo × (C − B). Both bounds below follow by differentiation.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

import wrt
from support.exact_rays import EPSILON, Array, Explained, Tested, _explain, woop

SECOND_ORDER = 1.001
"""Where the ray is moved by a millionth, so are the bounds on what follows: this is far more."""


class Placed(NamedTuple):
    """Meshes and their instances.

    Attributes:
        meshes: the distinct ones.
        numbers: (N,) which mesh each instance is.
        transforms: (N, 4, 4) from the mesh's space to the world.
    """

    meshes: Sequence[wrt.Mesh]
    numbers: NDArray[np.integer]
    transforms: Array

    @property
    def first_triangles(self) -> NDArray[np.int64]:
        """(N,) number of each instance's triangle 0."""
        counts = np.array([len(mesh.faces) for mesh in self.meshes], np.int64)[self.numbers]
        return np.cumsum(counts) - counts

    def instance_of(self, triangle: ArrayLike) -> NDArray[np.int64]:
        """Return which instance triangles numbered through belong to."""
        return np.searchsorted(self.first_triangles, triangle, side="right") - 1

    def corners(self, instance: int) -> Array:
        """Return an instance's (T, 3, 3) corners in its mesh's own space."""
        mesh = self.meshes[self.numbers[instance]]
        return mesh.vertices[mesh.faces].astype(np.float64)

    def flattened(self) -> wrt.Mesh:
        """Return all instances as one mesh in the world, its vertices rounded to float32."""
        vertices, faces, count = [], [], 0
        for number, m in zip(self.numbers, self.transforms, strict=True):
            mesh = self.meshes[number]
            vertices.append(mesh.vertices.astype(np.float64) @ m[:3, :3].T + m[:3, 3])
            faces.append(mesh.faces + count)
            count += len(mesh.vertices)
        return wrt.Mesh(np.concatenate(vertices).astype(np.float32), np.concatenate(faces))


def explain_instances(
    scene: Placed, origins: ArrayLike, directions: ArrayLike, triangle: ArrayLike, pairs: int = 200_000
) -> Explained:
    """Judge the triangles that a tracer says rays hit first, against all triangles of all instances.

    Args:
        scene: what stands where.
        origins: (R, 3) float32.
        directions: (R, 3) float32.
        triangle: (R,) the answers, numbered through all instances, −1 for none.
        pairs: rays times triangles to hold in memory at once.
    """
    o, d = (np.asarray(a, np.float64) for a in (origins, directions))
    answers = np.asarray(triangle)
    total = sum(len(scene.meshes[number].faces) for number in scene.numbers)
    size = max(1, pairs // total)
    found = []
    for start in range(0, max(1, len(o)), size):
        rays = slice(start, start + size)
        everything = range(len(scene.numbers))
        pieces = [_tested(scene.corners(i)[None], scene.transforms[i][None], o[rays], d[rays]) for i in everything]
        joined = Tested(*(np.concatenate(arrays, axis=1) for arrays in zip(*pieces, strict=True)))
        found.append(_explain(joined, answers[rays]))
    return Explained(*(np.concatenate(arrays) for arrays in zip(*found, strict=True)))


def own_triangle(scene: Placed, origins: ArrayLike, directions: ArrayLike, triangle: ArrayLike) -> Tested:
    """Test each ray against the one triangle that it hits, of those numbered through; the arrays are (R, 1, ...)."""
    o, d = (np.asarray(a, np.float64) for a in (origins, directions))
    triangle = np.asarray(triangle)
    instance = scene.instance_of(triangle)
    local = triangle - scene.first_triangles[instance]
    corners = np.zeros((len(o), 1, 3, 3))
    for number, mesh in enumerate(scene.meshes):
        mine = scene.numbers[instance] == number
        corners[mine, 0] = mesh.vertices[mesh.faces[local[mine]]]
    return _tested(corners, scene.transforms[instance], o, d)


def _tested(corners: Array, transforms: Array, origins: Array, directions: Array) -> Tested:
    """Test rays of the world against corners in a mesh's space: one transform for all rays, or one for each."""
    linear = np.linalg.inv(transforms[:, :3, :3])
    offset = -np.einsum("nij,nj->ni", linear, transforms[:, :3, 3])
    if len(linear) == 1:
        linear = np.broadcast_to(linear, (len(origins), 3, 3))
    o, d = np.einsum("rij,rj->ri", linear, origins) + offset, np.einsum("rij,rj->ri", linear, directions)
    size = np.abs(linear)
    o_error = 5.0 * EPSILON * (np.einsum("rij,rj->ri", size, np.abs(origins)) + np.abs(offset))
    d_error = 4.0 * EPSILON * np.einsum("rij,rj->ri", size, np.abs(directions))
    base = woop(corners, o, d)

    seen = corners - o[:, None, None]  # (R, T, corner, axis)
    after, last = np.roll(seen, -1, axis=2), np.roll(seen, -2, axis=2)
    normal = np.abs(np.cross(seen[:, :, 1] - seen[:, :, 0], seen[:, :, 2] - seen[:, :, 0]))
    by_direction = _dot(d_error, np.abs(np.cross(after, last)))
    by_origin = _dot(np.abs(d) + d_error, _size_of_cross(o_error, np.abs(last - after)))
    edge_error = (by_direction + by_origin) / np.abs(d).max(axis=1)[:, None, None]
    edge_error = SECOND_ORDER * (base.edge_error + edge_error)
    det_error = edge_error.sum(axis=2)
    slope = base.det * np.abs(d).max(axis=1)[:, None] - _dot(d_error, normal)
    with np.errstate(divide="ignore", invalid="ignore"):
        moved = (_dot(o_error, normal) + np.abs(base.t) * _dot(d_error, normal)) / slope
        narrower = (base.det - base.edge_error.sum(axis=2)) / (base.det - det_error)
        t_error = SECOND_ORDER * (base.t_error * narrower + moved)
    t_error = np.where((base.det > det_error) & (slope > 0.0), t_error, np.inf)
    return base._replace(edge_error=edge_error, t_error=t_error)


def _dot(a: Array, b: Array) -> Array:
    """Return a · b of (R, 3) and (R, ..., 3)."""
    return np.einsum("rk,r...k->r...", a, b)


def _size_of_cross(a: Array, b: Array) -> Array:
    """Return what a × b is at most in each component, for (R, 3) and (R, T, 3, 3) that are not negative."""
    ax, ay, az = (a[:, k, None, None] for k in range(3))
    bx, by, bz = np.moveaxis(b, 3, 0)
    return np.stack([ay * bz + az * by, az * bx + ax * bz, ax * by + ay * bx], axis=3)
