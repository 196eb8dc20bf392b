"""Placement of a camera that frames a scene."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike

from wrt.errors import InputError
from wrt.linalg import norm
from wrt.scene.camera import PerspectiveCamera, require_camera
from wrt.scene.mesh import box_around
from wrt.scene.scene import Scene
from wrt.studio.views import THREE_QUARTER
from wrt.values import Vec3

CHUNK = 1 << 13
"""Points processed at a time, so that intermediate results fit a core's cache."""


def frame_camera(
    points: ArrayLike,
    aspect: float,
    *,
    view: Vec3 = THREE_QUARTER,
    up: Vec3 = (0.0, 1.0, 0.0),
    fov_degrees: float = 30.0,
    margin: float = 1.06,
) -> PerspectiveCamera:
    """Return the nearest camera that looks along −`view` and has every point in its picture.

    For each axis of the picture, the two planes that bound the view and touch the points meet in a line. The camera is
    on the farther of the two lines, centred between the planes of the other axis.

    Args:
        points: (N, 3) points that must be visible.
        aspect: width of the picture over its height.
        view: direction from the points to the camera.
        up: a direction that points up in the picture; not parallel to `view`.
        fov_degrees: full vertical field of view.
        margin: size of the picture over the smallest one that holds the points.
    """
    p = np.asarray(points).reshape(-1, 3)
    low, high = box_around(p)
    center = 0.5 * (low + high)
    if (low == high).all():
        p = center + np.array([[-0.5, -0.5, -0.5], [0.5, 0.5, 0.5]])
        low, high = p
    toward = np.array(view) / norm(view)
    right, upper, forward = PerspectiveCamera(origin=tuple(toward), target=(0.0, 0.0, 0.0), up=up).frame()
    tangent = math.tan(math.radians(fov_degrees) / 2.0) / margin
    slopes = ((right, tangent * aspect), (upper, tangent))
    outwards = [-forward, *(side * axis - slope * forward for axis, slope in slopes for side in (1.0, -1.0))]
    farthest = np.full(len(outwards), -np.inf)
    for start in range(0, len(p), CHUNK):
        x, y, z = np.ascontiguousarray((p[start : start + CHUNK] - center).T)
        for k, (a, b, c) in enumerate(outwards):
            farthest[k] = max(farthest[k], (a * x + b * y + c * z).max())
    middles, depths = [], []
    for (_, slope), (right_side, left_side) in zip(slopes, farthest[1:].reshape(2, 2), strict=True):
        middles.append(0.5 * (right_side - left_side))
        depths.append(-0.5 * (right_side + left_side) / slope)
    # A flat object seen edge-on must not touch the lens.
    nearest = min(*depths, -farthest[0] - 1e-3 * float((high - center).max()))
    origin = center + middles[0] * right + middles[1] * upper + nearest * forward
    target = tuple(origin - nearest * forward)
    return PerspectiveCamera(origin=tuple(origin), target=target, up=up, fov_degrees=fov_degrees)


def with_camera(scene: Scene, aspect: float) -> Scene:
    """Return a copy of a scene, with a camera that shows all of it if it has none.

    Raises:
        InputError: when it has no shapes, or its camera is of another type.
    """
    if not scene.shapes:
        raise InputError("the scene has no shapes to render")
    scene = dataclasses.replace(scene, shapes=list(scene.shapes), lights=list(scene.lights))
    if scene.camera is None:
        scene.camera = frame_camera(np.concatenate([shape.outline for shape in scene.shapes]), aspect)
    require_camera(scene.camera)
    return scene
