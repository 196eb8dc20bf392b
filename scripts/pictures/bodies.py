"""Bodies that the pictures show: balls, cut stones, what is turned on a lathe, checkered floors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

import wrt
from wrt.scene.mesh import merge
from wrt.scene.normals import with_normals

Array = NDArray[np.float64]

SEGMENTS = 128
"""Facets around what is turned on a lathe."""


def ball(rows: int = 80) -> wrt.Mesh:
    """Return a sphere of radius 1 on the floor, with texture coordinates: u around the y axis, v up it."""
    u, v = np.meshgrid(np.linspace(0.0, 1.0, 2 * rows + 1), np.linspace(0.0, 1.0, rows + 1))
    azimuth, polar = 2.0 * np.pi * u, np.pi * (1.0 - v)
    normals = np.stack([np.sin(polar) * np.sin(azimuth), np.cos(polar), np.sin(polar) * np.cos(azimuth)], axis=2)
    faces = grid_faces(*u.shape).reshape(rows, 2 * rows, 2, 3)
    # At the poles one of each two triangles has no area.
    with_area = np.concatenate([faces[0, :, 1], faces[-1, :, 0], faces[1:-1].reshape(-1, 3)])
    points = normals.reshape(-1, 3)
    return wrt.Mesh(points + [0.0, 1.0, 0.0], with_area, points, np.stack([u, v], axis=2).reshape(-1, 2), name="ball")


def grid_faces(rows: int, columns: int) -> NDArray[np.int64]:
    """Return faces of a grid of points, two a cell; counter-clockwise where columns run right and rows up."""
    i = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (x.ravel() for x in (i[:-1, :-1], i[:-1, 1:], i[1:, 1:], i[1:, :-1]))
    return np.stack([np.stack([a, b, d], axis=1), np.stack([b, c, d], axis=1)], axis=1).reshape(-1, 3)


def brilliant(radius: float = 1.15) -> wrt.Mesh:
    """Return a round brilliant that lies on one of the facets beneath its girdle, table towards +z.

    Crown at 34.5 degrees, culet 0.86 radii deep, table 0.53 wide; sixteen facets below instead of twenty-four.
    """
    crown = np.tan(np.radians(34.5))
    turn = 2.0 * np.pi / 16.0

    def ring(count: int, r: float, height: float, first: float) -> Array:
        angle = 2.0 * turn * (np.arange(count) * 8.0 / count + first)
        return np.stack([r * np.sin(angle), np.full(count, height), r * np.cos(angle)], axis=1)

    # The middle ring lies in the planes of the kites between table and girdle.
    middle = ring(8, 0.76, (1.0 - 0.76 * np.cos(turn)) * crown, 0.5)
    points = np.concatenate([ring(8, 0.53, 0.47 * crown, 0.0), middle, ring(16, 1.0, 0.0, 0.0), [[0.0, -0.86, 0.0]]])
    faces = [[0, i, i + 1] for i in range(1, 7)]
    for i in range(8):
        table, next_table, mid, previous_mid = i, (i + 1) % 8, 8 + i, 8 + (i - 1) % 8
        corner, half, far = (16 + (2 * i + k) % 16 for k in range(3))
        faces += [[table, mid, next_table], [table, previous_mid, corner], [table, corner, mid]]
        faces += [[mid, corner, half], [mid, half, far], [32, half, corner], [32, far, half]]
    slope = np.degrees(np.arctan2(0.86, np.cos(0.5 * turn)))
    stone = wrt.Mesh(radius * points, np.array(faces), name="brilliant")
    stone = stone.rotated((0, 1, 0), -np.degrees(0.5 * turn)).rotated((1, 0, 0), slope).rotated((0, 1, 0), -24.0)
    low, high = stone.bounds
    middle = 0.5 * (low + high)
    return stone.translated((-middle[0], -low[1], -middle[2] - 0.3))


def facing(center: Sequence[float], target: Sequence[float], width: float, height: float) -> wrt.Mesh:
    """Return an upright rectangle whose front faces a point."""
    toward = np.subtract(target, center)
    across = np.cross([0.0, 1.0, 0.0], toward)
    across *= width / np.linalg.norm(across)
    upward = np.cross(toward, across)
    upward *= height / np.linalg.norm(upward)
    return wrt.quad(tuple(center - 0.5 * across - 0.5 * upward), tuple(across), tuple(upward))


def turned(profile: Sequence[tuple[float, float]], crease_degrees: float = 40.0) -> wrt.Mesh:
    """Return the body of revolution about the y axis of a closed profile (radius, height), counter-clockwise.

    Going along the profile, what is inside lies on the left.
    """
    points = np.asarray(profile, np.float64)
    angle = np.linspace(0.0, 2.0 * np.pi, SEGMENTS, endpoint=False)
    r, y = points[:, 0][:, None], np.repeat(points[:, 1][:, None], SEGMENTS, axis=1)
    vertices = np.stack([r * np.sin(angle), y, r * np.cos(angle)], axis=2).reshape(-1, 3)
    i, k = np.meshgrid(np.arange(len(points)), np.arange(SEGMENTS), indexing="ij")
    a, b = i * SEGMENTS + k, i * SEGMENTS + (k + 1) % SEGMENTS
    c, d = (x + SEGMENTS for x in (a, b))
    rows = slice(0, len(points) - 1)
    faces = np.concatenate([np.stack(t, axis=2)[rows].reshape(-1, 3) for t in ((a, b, d), (a, d, c))])
    corners = vertices[faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return with_normals(wrt.Mesh(vertices, faces[areas > 1e-12]), crease_degrees)


def checkered(columns: range, rows: range, side: float = 0.5) -> tuple[wrt.Mesh, wrt.Mesh]:
    """Return the light and the dark squares of a floor, numbered along x and z; `side` is in metres."""
    parts: tuple[list[wrt.Mesh], list[wrt.Mesh]] = ([], [])
    for i in columns:
        for j in rows:
            parts[(i + j) % 2].append(wrt.quad((i * side, 0, (j + 1) * side), (side, 0, 0), (0, 0, -side)))
    return merge(parts[0], "light squares"), merge(parts[1], "dark squares")


def sweep(half: float, front: float, back: float, radius: float, top: float) -> wrt.Mesh:
    """Return a table that rises into a wall behind, as photographers use it.

    It is 2 `half` wide, reaches from z = `front` to -`back` and from there, by a quarter of a circle, upwards.
    """
    angle = np.concatenate([[0.0], np.linspace(0.0, 0.5 * np.pi, 33), [0.5 * np.pi]])
    z = -back - radius * np.sin(angle)
    y = radius * (1.0 - np.cos(angle))
    z[0], y[-1] = front, top
    points = np.stack([np.tile([-half, half], len(z)), np.repeat(y, 2), np.repeat(z, 2)], axis=1)
    normals = np.stack([np.zeros_like(z), np.cos(angle), np.sin(angle)], axis=1).repeat(2, axis=0)
    return wrt.Mesh(points, grid_faces(len(z), 2), normals, name="sweep")
