"""Where to put a camera so that everything is in the picture."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from wrt.camera import PerspectiveCamera
from wrt.values import Vec3

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
    p = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    center = 0.5 * (p.min(axis=0) + p.max(axis=0))
    p = p - center
    if not p.any():
        p = np.array([[-0.5, -0.5, -0.5], [0.5, 0.5, 0.5]])
    toward = np.array(view) / np.linalg.norm(view)
    right, up, forward = PerspectiveCamera(origin=tuple(toward), target=(0.0, 0.0, 0.0)).frame()
    tangent = math.tan(math.radians(fov_degrees) / 2.0) / margin
    depth = p @ forward
    middles, depths = [], []
    for axis, slope in ((right, tangent * aspect), (up, tangent)):
        across = p @ axis
        high, low = (across - slope * depth).max(), (-across - slope * depth).max()
        middles.append(0.5 * (high - low))
        depths.append(-0.5 * (high + low) / slope)
    # A flat thing seen edge-on must not touch the lens.
    nearest = min(*depths, depth.min() - 1e-3 * float(np.abs(p).max()))
    origin = center + middles[0] * right + middles[1] * up + nearest * forward
    return PerspectiveCamera(origin=tuple(origin), target=tuple(origin - nearest * forward), fov_degrees=fov_degrees)
