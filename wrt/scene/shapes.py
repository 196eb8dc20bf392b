"""Meshes of simple shapes."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from wrt.errors import InputError
from wrt.scene.exact.spheres import spheres
from wrt.scene.mesh import Mesh, single
from wrt.values import Vec3, boolean, integer, number, vector

MAX_SUBDIVISIONS = 9
"""Limit for spheres: 5 million triangles, each a six-hundredth of the radius across."""


def quad(origin: Vec3, edge_u: Vec3, edge_v: Vec3) -> Mesh:
    """Return the parallelogram origin + u·edge_u + v·edge_v, u and v in [0, 1].

    Its front, the side that emits, faces edge_u × edge_v.

    Args:
        origin: a corner, metres.
        edge_u: edge from there to the next corner, metres.
        edge_v: the other edge from there, metres.
    """
    o, u, v = (np.array(vector(x, n)) for x, n in ((origin, "origin"), (edge_u, "edge_u"), (edge_v, "edge_v")))
    return Mesh(
        single(np.stack([o, o + u, o + u + v, o + v])),
        np.array([[0, 1, 2], [0, 2, 3]]),
        uvs=np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32),
        name="quad",
        sides=np.array([1 + 2, 2 + 4]),
    )


def polygon(corners: ArrayLike) -> Mesh:
    """Return a flat convex polygon; its corners are counter-clockwise seen from the front.

    Args:
        corners: (N, 3) positions in order, N at least 3.
    """
    points = np.asarray(corners, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 3:
        raise InputError(f"a polygon needs at least three corners of three numbers, not {points.shape}")
    fan = np.arange(1, len(points) - 1)
    sides = 2 + 1 * (fan == 1) + 4 * (fan == len(points) - 2)
    return Mesh(single(points), np.stack([np.zeros_like(fan), fan, fan + 1], axis=1), name="polygon", sides=sides)


def box(low: Vec3 = (-0.5, -0.5, -0.5), high: Vec3 = (0.5, 0.5, 0.5)) -> Mesh:
    """Return an axis-aligned box between two corners, facing outwards.

    Args:
        low: the lowest corner, metres.
        high: the highest corner, above `low` along every axis.
    """
    a, b = np.array(vector(low, "low")), np.array(vector(high, "high"))
    if (a >= b).any():
        raise InputError(f"box low {a.tolist()} must be below high {b.tolist()} along every axis")
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], np.float64)
    faces = np.array(
        [[0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4]]
        + [[2, 6, 7], [2, 7, 3], [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5]]
    )
    return Mesh(single(a + corners * (b - a)), faces, name="box", sides=np.tile([1 + 2, 2 + 4], 6))


def sphere(center: Vec3 = (0.0, 0.0, 0.0), radius: float = 1.0, *, subdivisions: int = 5, exact: bool = False) -> Mesh:
    """Return a sphere of 20·4^subdivisions triangles with exact normals, or an exact one, facing outwards.

    Vertices lie on the sphere; at 5 subdivisions the deepest point of a face is 0.07 % of the radius inside it.

    Args:
        center: metres.
        radius: metres.
        subdivisions: how often each triangle of an icosahedron is split into four.
        exact: whether rays meet the sphere itself, whatever the subdivisions.
    """
    if boolean(exact, "exact"):
        radius = number(radius, "radius", above=0.0)
        return spheres([vector(center, "center")], radius, name="sphere")
    c = np.array(vector(center, "center"))
    radius = number(radius, "radius", above=0.0)
    count = integer(subdivisions, "subdivisions", minimum=0, maximum=MAX_SUBDIVISIONS)
    points, faces = _icosahedron()
    for _ in range(count):
        points, faces = _split_in_four(points, faces)
    return Mesh(single(c + radius * points), faces, normals=points.astype(np.float32), name="sphere")


def _icosahedron() -> tuple[np.ndarray, np.ndarray]:
    g = (1.0 + 5.0**0.5) / 2.0
    points = np.array(
        [[-1, g, 0], [1, g, 0], [-1, -g, 0], [1, -g, 0], [0, -1, g], [0, 1, g]]
        + [[0, -1, -g], [0, 1, -g], [g, 0, -1], [g, 0, 1], [-g, 0, -1], [-g, 0, 1]],
        np.float64,
    )
    faces = np.array(
        [[0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11]]
        + [[1, 5, 9], [5, 11, 4], [11, 10, 2], [10, 7, 6], [7, 1, 8]]
        + [[3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9]]
        + [[4, 9, 5], [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1]],
        np.int32,
    )
    return points / np.linalg.norm(points, axis=1, keepdims=True), faces


def _split_in_four(points: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    a, b = faces.T.reshape(-1), faces[:, [1, 2, 0]].T.reshape(-1)
    keys = np.minimum(a, b) * np.int64(len(points)) + np.maximum(a, b)
    order = np.argsort(keys, kind="stable")  # both faces at an edge beside each other: the surface is closed
    index = np.empty(len(keys), np.int32)
    index[order] = len(points) + np.arange(len(keys), dtype=np.int32) // 2
    first, second = np.divmod(keys[order[::2]], len(points))
    middle = points[first] + points[second]
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    ab, bc, ca = index.reshape(3, -1)
    a, b, c = faces.T
    split = np.empty((4, len(faces), 3), np.int32)
    for part, corners in zip(split, ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)), strict=True):
        for k in range(3):
            part[:, k] = corners[k]
    return np.concatenate([points, middle]), split.reshape(-1, 3)
