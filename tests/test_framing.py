"""A scene without a camera gets one that sees everything, and no farther away than it must be."""

from __future__ import annotations

import math

import numpy as np
import pytest

import wrt
from wrt.studio.framing import frame_camera

SHAPES = {
    "ball": wrt.sphere(subdivisions=2).vertices,
    "tall": wrt.box((-0.1, 0.0, -0.1), (0.1, 3.0, 0.1)).vertices,
    "wide": wrt.box((-3.0, 0.0, -0.1), (3.0, 0.2, 0.1)).vertices,
    "far away": wrt.sphere((1e3, 2e3, -5e2), 3.0, subdivisions=2).vertices,
    "flat": wrt.quad((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0)).vertices,
}


@pytest.mark.parametrize("aspect", [0.5, 1.0, 16.0 / 9.0])
@pytest.mark.parametrize("name", SHAPES)
def test_everything_just_fits(name: str, aspect: float) -> None:
    points = SHAPES[name].astype(np.float64)
    camera = frame_camera(points, aspect, margin=1.0)
    right, up, forward = camera.frame()
    p = points - np.array(camera.origin)
    tangent = math.tan(math.radians(camera.fov_degrees) / 2.0)
    x, y = p @ right / (p @ forward) / (tangent * aspect), p @ up / (p @ forward) / tangent
    assert (p @ forward > 0.0).all()
    assert max(np.abs(x).max(), np.abs(y).max()) <= 1.0 + 1e-6
    # The picture's frame is touched on both sides along one axis.
    touched = [v.max() > 0.999 and v.min() < -0.999 for v in (x, y)]
    assert any(touched)


def test_one_point_is_framed_as_if_it_had_a_size() -> None:
    camera = frame_camera(np.zeros((1, 3)), 1.0)
    assert np.isfinite(camera.origin).all()
    assert camera.distance_in_focus > 0.5
