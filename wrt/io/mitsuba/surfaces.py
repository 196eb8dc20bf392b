"""Tessellate Mitsuba's analytic shapes, finely enough that the picture does not show it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wrt.linalg import norm
from wrt.scene.camera import Camera, OrthographicCamera, PerspectiveCamera
from wrt.scene.exact.quadrics import Quadrics
from wrt.scene.exact.spheres import Spheres
from wrt.scene.mesh import Mesh, box_around

Matrix = NDArray[np.float64]

LEAST_SEGMENTS, MOST_SEGMENTS = 64, 768
"""Segments of a circle: fewer would show in the shading, more would take half a gigabyte for a few spheres."""

MOST_EMITTING = 192  # most segments of a circle on an emitting shape, where each triangle is a light


@dataclass(frozen=True)
class Detail:
    """The camera and the rows of the whole picture, which set the tessellation."""

    camera: Camera | None
    height: int

    def tolerance(self, center: NDArray[np.float64], radius: float) -> float:
        """Return half a pixel in metres at the nearest point of a sphere, at least a twentieth of its radius away."""
        if isinstance(self.camera, OrthographicCamera):
            return 0.5 * self.camera.view_height / self.height
        if not isinstance(self.camera, PerspectiveCamera):
            return 5e-4 * radius
        distance = norm(center - np.array(self.camera.origin)) - radius
        height = 2.0 * math.tan(0.5 * math.radians(self.camera.fov_degrees))
        return 0.5 * height * max(distance, 0.05 * radius) / self.height

    def segments(self, center: NDArray[np.float64], radius: float, *, emits: bool) -> tuple[int, bool]:
        """Return the number of segments of a circle, and whether the limit is less than the tolerance needs.

        The middle of a chord of n segments lies r (1 − cos(π/n)) inside the circle, and the middle of a face of a
        sphere up to twice that, so half of the tolerance is allowed.
        """
        inside = 0.5 * self.tolerance(center, radius) / radius
        segments = math.pi / math.acos(1.0 - min(inside, 1.0)) if inside > 1e-12 else math.inf
        most = MOST_EMITTING if emits else MOST_SEGMENTS
        return (most, True) if segments > most else (max(LEAST_SEGMENTS, 4 * math.ceil(0.25 * segments)), False)


def cube() -> Mesh:
    """Return the cube from −1 to 1; each side has the whole unit square of texture coordinates, as in Mitsuba."""
    x, y, z = np.eye(3)
    st = np.array([(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)])
    corners: list[Matrix] = []
    triangles: list[NDArray[np.int64]] = []
    # The normal of each side, and the directions of growing u and v.
    for normal, u, v in ((-y, z, x), (y, -x, -z), (x, y, -z), (z, y, x), (-x, y, z), (-z, -y, x)):
        corners.append(normal + st[:, :1] * u + st[:, 1:] * v)
        pair = np.array([[0, 1, 2], [0, 2, 3]]) + 4 * len(triangles)
        triangles.append(pair if (np.cross(v, u) == normal).all() else pair[:, ::-1])  # outwards
    faces = np.swapaxes(triangles, 0, 1).reshape(-1, 3)
    return Mesh(np.concatenate(corners), faces, uvs=np.tile(0.5 * (st + 1.0), (6, 1)), name="cube")


def is_closed(mesh: Mesh) -> bool:
    """Return whether a mesh is closed, with all faces turned outwards."""
    from wrt.scene.normals import CHUNK, same_positions

    if isinstance(mesh, Spheres):
        return not mesh.inside_out.any()
    if isinstance(mesh, Quadrics):
        return False
    positions = same_positions(mesh.vertices)
    count = len(mesh.vertices)
    center = box_around(mesh.vertices).mean(axis=0)
    edges = np.empty((2, len(mesh.faces), 3), np.int64)  # in both directions
    volume = 0.0
    for begin in range(0, len(mesh.faces), CHUNK):
        faces = mesh.faces[begin : begin + CHUNK]
        start = positions.take(faces)
        end = np.roll(start, -1, axis=1)
        edges[:, begin : begin + CHUNK] = start * count + end, end * count + start
        a, b, c = (mesh.vertices.take(faces, axis=0) - center).transpose(1, 0, 2)
        volume += float(np.einsum("ij,ij->", a, np.cross(b, c)))
    if volume <= 0.0:
        return False
    # Each edge must occur once in either direction.
    ordered = edges.reshape(2, -1)
    ordered.sort()
    return bool((ordered[0] == ordered[1]).all() and (ordered[0, 1:] != ordered[0, :-1]).all())
