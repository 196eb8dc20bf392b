"""The camera's device struct."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from wrt.build.motion import motion_records
from wrt.camera import Camera, FisheyeCamera, LensCamera, OrthographicCamera, PanoramaCamera, PerspectiveCamera

CropWindow = tuple[int, int, int, int]
"""First column, first row, column after the last and row after the last, pixels of the whole picture."""


def build_camera(camera: Camera, width: int, height: int, crop: CropWindow | None = None, *, device: str) -> Any:
    """Return the Camera struct on a device for a picture of width x height pixels, of which `crop` is rendered.

    Raises:
        InputError: where it is no camera.
    """
    import warp as wp

    from wrt.kernels.camera import Camera as CameraData
    from wrt.kernels.motion import MotionKey

    data = CameraData()
    data.kind, (pixel_x, pixel_y) = _kind_and_pixel(camera, width, height)
    data.pixel = wp.vec2(pixel_x, pixel_y)
    data.origin = wp.vec3(*camera.origin)
    data.right, data.up, data.forward = (wp.vec3(*axis) for axis in camera.frame())
    if isinstance(camera, PerspectiveCamera):
        data.shift = wp.vec2(camera.shift_x * height * pixel_y, camera.shift_y * height * pixel_y)
    if isinstance(camera, FisheyeCamera):
        data.limit = math.radians(camera.fov_degrees) / 2.0
    if isinstance(camera, LensCamera):
        _set_lens(data, camera)
    data.shutter_open = camera.shutter_open
    data.shutter_close = camera.shutter_close
    data.shutter_ramp = camera.shutter_ramp
    keys, records = motion_records([camera.motion] if camera.motion else [])
    data.motion_keys = wp.array(keys, dtype=MotionKey, device=device)
    if camera.motion:
        data.motion.first_key, data.motion.keys = (int(records[0][name]) for name in ("first_key", "keys"))
        data.motion.center = wp.vec3(*camera.motion.center)
    data.width = width
    data.height = height
    data.crop_x, data.crop_y, end, _ = crop or (0, 0, width, height)
    data.crop_width = end - data.crop_x
    return data


def _kind_and_pixel(camera: Camera, width: int, height: int) -> tuple[int, tuple[float, float]]:
    """Return the number of a camera's kind and how large a pixel is on its film."""
    from wrt.kernels import camera as kinds

    if isinstance(camera, PerspectiveCamera):
        pixel = 2.0 * math.tan(math.radians(camera.fov_degrees) / 2.0) / height
        return kinds.PERSPECTIVE, (pixel, pixel)
    if isinstance(camera, OrthographicCamera):
        pixel = camera.view_height / height
        return kinds.ORTHOGRAPHIC, (pixel, pixel)
    if isinstance(camera, PanoramaCamera):
        degrees = (camera.horizontal_degrees / width, camera.vertical_degrees / height)
        return kinds.PANORAMA, (math.radians(degrees[0]), math.radians(degrees[1]))
    assert isinstance(camera, FisheyeCamera)
    pixel = math.radians(camera.fov_degrees) / min(width, height)
    return kinds.FISHEYE, (pixel, pixel)


def _set_lens(data: Any, camera: LensCamera) -> None:
    from wrt.kernels.camera import SQUARE_BLADES

    data.lens_radius = camera.aperture_radius
    data.focus_distance = camera.distance_in_focus
    turn = camera.aperture_rotation_degrees
    if camera.aperture == "square":
        data.blades = int(SQUARE_BLADES)
    elif camera.aperture == "polygon":
        data.blades = camera.aperture_blades
        # The device's first corner lies to the right, but the sides of its square are upright.
        turn += 45.0 if camera.aperture_blades == SQUARE_BLADES else 90.0
    data.lens_cos = float(np.cos(np.radians(turn)))
    data.lens_sin = float(np.sin(np.radians(turn)))
