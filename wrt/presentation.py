"""A bare mesh made a picture one would show: ground, backdrop, key light, sky fill, camera."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from wrt.environment import ConstantEnvironment
from wrt.errors import InputError
from wrt.framing import frame_camera
from wrt.materials import Diffuse
from wrt.mesh import Mesh
from wrt.motion import rotation_matrix
from wrt.scene import RenderSettings, Scene, Shape
from wrt.shapes import quad

SETTINGS = RenderSettings(width=960, height=720, spp=128)
KEY_RADIANCE = 12.5
FILL_RADIANCE = 0.36
GROUND_REFLECTANCE = 0.55

# Turns each axis that may point up into +y.
_UP_ROTATIONS = {
    "x": ((0.0, 0.0, 1.0), 90.0),
    "-x": ((0.0, 0.0, 1.0), -90.0),
    "y": ((1.0, 0.0, 0.0), 0.0),
    "-y": ((1.0, 0.0, 0.0), 180.0),
    "z": ((1.0, 0.0, 0.0), -90.0),
    "-z": ((1.0, 0.0, 0.0), 90.0),
}


_SIZES = 2.0**-4, 2.0**16
"""Metres across that a studio is for: beyond, steps off surfaces and squares of distances lose their digits."""


def present(shapes: list[Shape], *, up: str = "y", rescale: bool = True) -> Scene:
    """Return a studio scene around `shapes`: standing on a sweep, lit softly from the upper left.

    Args:
        shapes: what to show; left where they are but for the turn that brings `up` to +y.
        up: the axis of the shapes' own coordinates that points up: x, y, z, -x, -y or -z.
        rescale: whether shapes in unusual units, less than 6 cm or more than 65 km across, are brought to about a
            metre, by a power of two.

    Raises:
        InputError: on an unknown axis or no shapes.
    """
    if up not in _UP_ROTATIONS:
        raise InputError(f"up must be one of {', '.join(_UP_ROTATIONS)}, not {up!r}")
    if not shapes:
        raise InputError("there is nothing to show: no shapes")
    axis, degrees = _UP_ROTATIONS[up]
    if degrees:
        turn = np.eye(4)
        turn[:3, :3] = rotation_matrix(axis, degrees)
        shapes = [shape.moved(turn) for shape in shapes]
    scene = Scene(shapes=list(shapes), settings=dataclasses.replace(SETTINGS))
    low, high = scene.bounds
    size = float(np.linalg.norm(high - low))
    if size == 0.0:
        raise InputError("there is nothing to show: all vertices are in one place")
    if rescale and not _SIZES[0] <= size <= _SIZES[1]:
        factor = 2.0 ** -round(math.log2(size))
        scene.shapes = [shape.moved(np.diag([factor, factor, factor, 1.0])) for shape in scene.shapes]
        low, high = scene.bounds
        size = float(np.linalg.norm(high - low))
    floor = np.array([0.5 * (low[0] + high[0]), low[1], 0.5 * (low[2] + high[2])])
    center = 0.5 * (low + high)

    points = np.concatenate([shape.outline for shape in scene.shapes])
    scene.camera = frame_camera(points, SETTINGS.width / SETTINGS.height, fov_degrees=24.0, margin=1.3)
    scene.environment = ConstantEnvironment(FILL_RADIANCE)
    scene.add(_sweep(floor, size), material=Diffuse(GROUND_REFLECTANCE), name="ground")
    # A key light as wide as the object, from the upper left in front, gives shadows a soft edge.
    toward = np.array([-0.75, 1.15, 0.8])
    toward /= np.linalg.norm(toward)
    side = np.cross([0.0, 1.0, 0.0], toward)
    side /= np.linalg.norm(side)
    lift = np.cross(toward, side)
    place = center + 1.9 * size * toward
    corner = place - 0.5 * size * side - 0.5 * size * lift
    scene.add(
        quad(tuple(corner), tuple(size * lift), tuple(size * side)),
        material=Diffuse(0.0),
        emission=KEY_RADIANCE,
        name="key light",
    )
    return scene


def _sweep(floor: np.ndarray, size: float) -> Mesh:
    """Return a studio backdrop: a floor that curves up into a wall behind, smooth along the curve."""
    width, front, back, radius, height = 30.0 * size, 12.0 * size, 3.2 * size, 2.2 * size, 14.0 * size
    angles = np.linspace(0.0, math.pi / 2.0, 65)
    z = np.concatenate([[front], -back - radius * np.sin(angles), [-back - radius]])
    y = np.concatenate([[0.0], radius * (1.0 - np.cos(angles)), [height]])
    normal_y = np.concatenate([[1.0], np.cos(angles), [0.0]])
    normal_z = np.concatenate([[0.0], np.sin(angles), [1.0]])
    n = len(z)
    vertices = np.zeros((2 * n, 3))
    vertices[:n, 0], vertices[n:, 0] = -width / 2.0, width / 2.0
    vertices[:, 1], vertices[:, 2] = np.tile(y, 2), np.tile(z, 2)
    normals = np.stack([np.zeros(2 * n), np.tile(normal_y, 2), np.tile(normal_z, 2)], axis=1)
    i = np.arange(n - 1)
    faces = np.concatenate([np.stack([i, i + n, i + n + 1], 1), np.stack([i, i + n + 1, i + 1], 1)])
    return Mesh(vertices + floor, faces, normals.astype(np.float32), name="sweep")
