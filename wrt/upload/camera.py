"""Build the device struct of a camera."""

from __future__ import annotations

from typing import Any

import numpy as np

from wrt.backend import current_backend
from wrt.scene.camera import Camera, LensCamera
from wrt.upload.motion import motion_records

CropWindow = tuple[int, int, int, int]
"""First column, first row, column after the last and row after the last, pixels of the whole picture."""


def build_camera(camera: Camera, width: int, height: int, crop: CropWindow | None = None, *, device: str) -> Any:
    """Return the Camera struct for a picture of width x height pixels, rendered within `crop`."""
    backend = current_backend()
    motion = backend.kernels("wrt.kernels.core.motion")

    from wrt.kernels.core.registry import model_number

    data = backend.kernels("wrt.kernels.camera.camera").Camera()
    name = backend.call("wrt.kernels.camera.models", "current_name", camera.model)
    data.kind = model_number(name)
    for field, value in camera.film(width, height).items():
        setattr(data, field, value)
    data.origin = camera.origin
    data.right, data.up, data.forward = camera.frame()
    if isinstance(camera, LensCamera):
        _set_lens(data, camera)
    data.shutter_open = camera.shutter_open
    data.shutter_close = camera.shutter_close
    data.shutter_ramp = camera.shutter_ramp
    keys, records = motion_records([camera.motion] if camera.motion else [])
    data.motion_keys = backend.array(keys, motion.MotionKey, device)
    if camera.motion:
        data.motion.first_key, data.motion.keys = (int(records[0][name]) for name in ("first_key", "keys"))
        data.motion.center = camera.motion.center
    data.width = width
    data.height = height
    data.crop_x, data.crop_y, end, _ = crop or (0, 0, width, height)
    data.crop_width = end - data.crop_x
    return data


def outside_cameras(camera: Camera | None) -> tuple[str, ...]:
    """Return the name of a camera model that user code registered, for `Features.cameras`."""
    backend = current_backend()

    if camera is None:
        return ()
    name = backend.call("wrt.kernels.camera.models", "current_name", camera.model)
    return () if name in backend.kernels("wrt.kernels.camera.models").BUILT_IN else (name,)


def _set_lens(data: Any, camera: LensCamera) -> None:
    square_blades = int(current_backend().kernels("wrt.kernels.camera.camera").SQUARE_BLADES)
    data.lens_radius = camera.aperture_radius
    data.focus_distance = camera.distance_in_focus
    turn = camera.aperture_rotation_degrees
    if camera.aperture == "square":
        data.blades = square_blades
    elif camera.aperture == "polygon":
        data.blades = camera.aperture_blades
        # On the device the first corner lies to the right, but a square has vertical sides.
        turn += 45.0 if camera.aperture_blades == square_blades else 90.0
    data.lens_cos = float(np.cos(np.radians(turn)))
    data.lens_sin = float(np.sin(np.radians(turn)))
