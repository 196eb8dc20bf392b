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
    bounds: ArrayLike, aspect: float, *, view: Vec3 = VIEW, fov_degrees: float = 30.0, margin: float = 1.06
) -> PerspectiveCamera:
    """Return a camera that sees the whole box of `bounds` ((2, 3), lowest and highest corner).

    The distance is the smallest at which all eight corners, `margin` times as far out, are inside
    the picture of width over height `aspect`.
    """
    low, high = np.asarray(bounds, dtype=np.float64)
    center = 0.5 * (low + high)
    half = 0.5 * margin * (high - low)
    if not half.any():
        half = np.full(3, 0.5)
    toward = np.array(view) / np.linalg.norm(view)
    trial = PerspectiveCamera(origin=tuple(toward), target=(0.0, 0.0, 0.0))
    right, up, forward = trial.frame()
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)
    corners = signs * half
    tangent = math.tan(math.radians(fov_degrees) / 2.0)
    distance = max(
        float((np.abs(corners @ right) / (tangent * aspect) - corners @ forward).max()),
        float((np.abs(corners @ up) / tangent - corners @ forward).max()),
    )
    origin = center + toward * distance
    return PerspectiveCamera(origin=tuple(origin), target=tuple(center), fov_degrees=fov_degrees)
