"""Mitsuba's analytic shapes as triangles, fine enough that a picture does not tell."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wrt.camera import Camera, OrthographicCamera, PerspectiveCamera
from wrt.mesh import Mesh, box_around

Matrix = NDArray[np.float64]

LEAST_SEGMENTS, MOST_SEGMENTS = 64, 768
"""Of a circle: fewer would show in how light falls off, more would take half a gigabyte for a few spheres."""

MOST_SHINING = 192
"""Of a circle where each triangle is a light."""


@dataclass(frozen=True)
class Detail:
    """How fine a picture is.

    Attributes:
        camera: which takes it; None where the scene has none.
        height: rows of the whole picture.
    """

    camera: Camera | None
    height: int

    def tolerance(self, center: NDArray[np.float64], radius: float) -> float:
        """Return half a pixel at the nearest point of a ball, metres; from within, as at a twentieth of its radius."""
        if isinstance(self.camera, OrthographicCamera):
            return 0.5 * self.camera.view_height / self.height
        if not isinstance(self.camera, PerspectiveCamera):
            return 5e-4 * radius
        distance = float(np.linalg.norm(center - np.array(self.camera.origin))) - radius
        height = 2.0 * math.tan(0.5 * math.radians(self.camera.fov_degrees))
        return 0.5 * height * max(distance, 0.05 * radius) / self.height

    def segments(self, center: NDArray[np.float64], radius: float, *, shines: bool) -> tuple[int, bool]:
        """Return into how many segments to cut a circle, and whether it should have been more.

        The middle of a chord of n segments lies r (1 − cos(π/n)) inside the circle; the middle of a face of a sphere
        up to twice that, so half of the tolerance is allowed.
        """
        inside = 0.5 * self.tolerance(center, radius) / radius
        wanted = math.pi / math.acos(1.0 - min(inside, 1.0)) if inside > 1e-12 else math.inf
        most = MOST_SHINING if shines else MOST_SEGMENTS
        return (most, True) if wanted > most else (max(LEAST_SEGMENTS, 4 * math.ceil(0.25 * wanted)), False)


def rectangle() -> Mesh:
    """Return the square from −1 to 1 in x and y that faces z, u and v from 0 to 1."""
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float64)
    return Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), uvs=0.5 * (corners[:, :2] + 1.0), name="rectangle")


def cube() -> Mesh:
    """Return the cube from −1 to 1, each side with the whole square of texture coordinates, laid as Mitsuba does."""
    x, y, z = np.eye(3)
    corners, uvs = [], []
    # A side's normal, and where its u and its v grow.
    for normal, u, v in ((-y, z, x), (y, -x, -z), (x, y, -z), (z, y, x), (-x, y, z), (-z, -y, x)):
        for s, t in ((-1, 1), (1, 1), (1, -1), (-1, -1)):
            corners.append(normal + s * u + t * v)
            uvs.append([0.5 * (s + 1), 0.5 * (t + 1)])
    first = 4 * np.arange(6)[:, None]
    faces = np.concatenate([first + [0, 1, 2], first + [0, 2, 3]])
    mesh = Mesh(np.array(corners), faces, uvs=np.array(uvs), name="cube")
    return _outwards(mesh)


def _outwards(mesh: Mesh) -> Mesh:
    """Return a convex mesh around the origin with all its fronts outside."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(np.float64) for k in range(3))
    inwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), a + b + c) < 0.0
    faces = np.where(inwards[:, None], mesh.faces[:, ::-1], mesh.faces)
    return Mesh(mesh.vertices, faces, uvs=mesh.uvs, name=mesh.name)


def disk(segments: int) -> Mesh:
    """Return the unit disk that faces z: u is the distance from its middle, v the angle from x over a whole turn."""
    around = _circle(segments)
    rim = np.concatenate([around, np.zeros((segments + 1, 1))], axis=1)
    turns = np.arange(segments + 1) / segments
    middle = np.stack([np.zeros(segments), turns[:-1] + 0.5 / segments], axis=-1)
    index = np.arange(segments)
    return Mesh(
        np.concatenate([rim, np.zeros((segments, 3))]),
        np.stack([index, index + 1, segments + 1 + index], axis=-1),
        uvs=np.concatenate([np.stack([np.ones_like(turns), turns], axis=-1), middle]),
        name="disk",
    )


def sphere(segments: int) -> Mesh:
    """Return the unit ball: u is the turn about z from x, v the angle from the top, z, over half a turn."""
    rows = (segments + 1) // 2
    u, v = np.meshgrid(np.arange(segments + 1) / segments, np.arange(rows + 1) / rows)
    sine = np.sin(math.pi * v)
    sine[0] = sine[-1] = 0.0
    points = np.concatenate([sine[..., None] * _circle(segments), np.cos(math.pi * v)[..., None]], axis=-1)
    # A triangle that ends in a pole has there the turn of its own middle.
    u[0] += 0.5 / segments
    u[-1] += 0.5 / segments
    faces = _grid(rows, segments, downwards=True)
    solid = np.ones(len(faces), bool)
    solid[:segments] = False  # the first of both triangles of a place in the top row has two corners at the pole
    solid[-segments:] = False
    return _curved(points.reshape(-1, 3), points.reshape(-1, 3), faces[solid], u, v, "sphere")


def cylinder(segments: int) -> Mesh:
    """Return the open cylinder of radius 1 about z from 0 to 1, which faces outwards: u is the turn from x, v is z."""
    u, v = np.meshgrid(np.arange(segments + 1) / segments, np.arange(2.0))
    normals = np.concatenate([np.stack([_circle(segments)] * 2), np.zeros((2, segments + 1, 1))], axis=-1)
    points = normals.copy()
    points[..., 2] = v
    faces = _grid(1, segments, downwards=False)
    return _curved(points.reshape(-1, 3), normals.reshape(-1, 3), faces, u, v, "cylinder")


def _circle(segments: int) -> Matrix:
    """Return (segments + 1, 2) points of the unit circle from x on; the last is the first, to the bit."""
    angles = 2.0 * math.pi * (np.arange(segments + 1) % segments) / segments
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def _grid(rows: int, columns: int, *, downwards: bool) -> NDArray[np.int64]:
    """Return the triangles of a grid: first of every place the one with two corners in its row, then the other.

    Columns go counter-clockwise about the axis seen from above, rows down or up.
    """
    row, column = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    a = (row * (columns + 1) + column).reshape(-1)
    b, c, d = a + 1, a + columns + 1, a + columns + 2
    first, second = (
        (np.stack([a, d, b], -1), np.stack([a, c, d], -1))
        if downwards
        else (
            np.stack([a, b, d], -1),
            np.stack([a, d, c], -1),
        )
    )
    return np.concatenate([first, second])


def _curved(points: Matrix, normals: Matrix, faces: NDArray[np.int64], u: Matrix, v: Matrix, name: str) -> Mesh:
    uvs = np.stack([u.reshape(-1), v.reshape(-1)], axis=-1)
    return Mesh(points, faces, normals, uvs, name=name)


def is_closed(mesh: Mesh) -> bool:
    """Return whether a mesh is the whole boundary of a body, all its fronts outside."""
    from wrt.normals import CHUNK, same_positions

    positions = same_positions(mesh.vertices)
    count = len(mesh.vertices)
    center = box_around(mesh.vertices).mean(axis=0)
    edges = np.empty((len(mesh.faces), 3), np.int64)
    difference, volume = np.uint64(0), 0.0
    for begin in range(0, len(edges), CHUNK):
        faces = mesh.faces[begin : begin + CHUNK]
        start = positions.take(faces)
        end = np.roll(start, -1, axis=1)
        edges[begin : begin + CHUNK] = start * count + end
        with np.errstate(over="ignore"):
            difference += _hash(start * count + end).sum() - _hash(end * count + start).sum()
        a, b, c = (mesh.vertices.take(faces, axis=0) - center).transpose(1, 0, 2)
        volume += float(np.einsum("ij,ij->", a, np.cross(b, c)))
    # Every edge runs both ways, which sums of hashes tell all but surely, and once each.
    if difference != 0 or volume <= 0.0:
        return False
    ordered = np.sort(edges, axis=None)
    return not bool((ordered[1:] == ordered[:-1]).any())


def _hash(numbers: NDArray[np.int64]) -> NDArray[np.uint64]:
    mixed = numbers.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    mixed ^= mixed >> np.uint64(32)
    return mixed * np.uint64(0xD6E8FEB86659FD93)
