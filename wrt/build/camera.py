"""The camera's device struct."""

from __future__ import annotations

import math
from typing import Any

from wrt.camera import PerspectiveCamera


def build_camera(camera: PerspectiveCamera, width: int, height: int) -> Any:
    """Return the Camera struct for a picture of width x height pixels."""
    import warp as wp

    from wrt.kernels.camera import Camera

    right, up, forward = camera.frame()
    half_height = math.tan(math.radians(camera.fov_degrees) / 2.0)
    half_width = half_height * width / height
    data = Camera()
    data.origin = wp.vec3(*camera.origin)
    data.right = wp.vec3(*(right * half_width))
    data.up = wp.vec3(*(up * half_height))
    data.forward = wp.vec3(*forward)
    data.unit_right = wp.vec3(*right)
    data.unit_up = wp.vec3(*up)
    data.lens_radius = camera.aperture_radius
    data.focus_distance = camera.distance_in_focus
    data.width = width
    data.height = height
    return data
