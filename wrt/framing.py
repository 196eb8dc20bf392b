"""Where to put a camera so that everything is in the picture."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from wrt.camera import PerspectiveCamera
from wrt.mesh import box_around
from wrt.values import Vec3

CHUNK = 1 << 13
"""Points that are looked at together, so that what is computed of them stays in a core's cache."""

VIEW = (0.45, 0.38, 1.0)
"""Direction from the object to the camera: in front, a little to the right, a little above."""


def frame_camera(
    points: ArrayLike, aspect: float, *, view: Vec3 = VIEW, fov_degrees: float = 30.0, margin: float = 1.06
) -> PerspectiveCamera:
    """Return the nearest camera that looks against `view` and has every point in its picture.

    For each axis of the picture, the two sides of the view's wedge that just touch the points meet
    in a line; the camera is where the farther of the two lines is, in the middle of the other wedge.

    Args:
        points: (N, 3) what must be seen.
        aspect: width of the picture over its height.
        view: direction from the points to the camera.
        fov_degrees: full vertical field of view.
        margin: how much larger the picture is than what just holds the points.
    """
    p = np.asarray(points).reshape(-1, 3)
    low, high = box_around(p)
    center = 0.5 * (low + high)
    if (low == high).all():
        p = center + np.array([[-0.5, -0.5, -0.5], [0.5, 0.5, 0.5]])
        low, high = p
    toward = np.array(view) / np.linalg.norm(view)
    right, up, forward = PerspectiveCamera(origin=tuple(toward), target=(0.0, 0.0, 0.0)).frame()
    tangent = math.tan(math.radians(fov_degrees) / 2.0) / margin
    slopes = ((right, tangent * aspect), (up, tangent))
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
    # A flat thing seen edge-on must not touch the lens.
    nearest = min(*depths, -farthest[0] - 1e-3 * float((high - center).max()))
    origin = center + middles[0] * right + middles[1] * up + nearest * forward
    return PerspectiveCamera(origin=tuple(origin), target=tuple(origin - nearest * forward), fov_degrees=fov_degrees)
