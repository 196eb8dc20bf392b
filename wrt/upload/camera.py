"""Build the device structs of cameras and motions, and the tables of reconstruction filters."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.backend import current_backend
from wrt.scene.camera import Camera, LensCamera
from wrt.scene.motion import Motion

CropWindow = tuple[int, int, int, int]
"""First column, first row, column after the last and row after the last, pixels of the whole picture."""


def build_camera(camera: Camera, width: int, height: int, crop: CropWindow | None = None, *, device: str) -> Any:
    """Return the Camera struct for a picture of width x height pixels, rendered within `crop`."""
    backend = current_backend()

    from wrt.kernels.core.registry import model_number

    data = backend.kernels("wrt.kernels.camera.camera").Camera()
    data.kind = model_number(_model_name(camera))
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
    data.motion_keys = backend.array(keys, backend.kernels("wrt.kernels.core.motion").MotionKey, device)
    if camera.motion:
        data.motion.first_key, data.motion.keys = (int(records[0][name]) for name in ("first_key", "keys"))
        data.motion.center = camera.motion.center
    data.width = width
    data.height = height
    data.crop_x, data.crop_y, end, _ = crop or (0, 0, width, height)
    data.crop_width = end - data.crop_x
    return data


def _model_name(camera: Camera) -> str:
    name: str = current_backend().call("wrt.kernels.camera.models", "current_name", camera.model)
    return name


def outside_cameras(camera: Camera | None) -> tuple[str, ...]:
    """Return the name of a camera model that is not in all kernels, for `Features.cameras`."""
    if camera is None:
        return ()
    name = _model_name(camera)
    return () if name in current_backend().kernels("wrt.kernels.camera.models").BUILT_IN else (name,)


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


def motion_records(motions: Sequence[Motion]) -> tuple[Any, Any]:
    """Return the keys and the records of motions, as NumPy arrays of the kernels' structs."""
    structs = current_backend().kernels("wrt.kernels.core.motion")
    records = np.zeros(len(motions), structs.MotionRecord.numpy_dtype())
    counts = np.array([len(motion.times) for motion in motions], np.int64)
    keys = np.zeros(int(counts.sum()), structs.MotionKey.numpy_dtype())
    records["first_key"] = np.cumsum(counts) - counts
    records["keys"] = counts
    for record, motion in zip(records, motions, strict=True):
        some = keys[record["first_key"] :][: record["keys"]]
        some["time"], some["half_angle"] = motion.times, motion.half_angles
        some["rotation"], some["stretch"], some["position"] = motion.parts
        record["center"] = motion.center
    return keys, records


# --- Filters ---------------------------------------------------------------------------------------

TABLE_SIZE = 1024
"""Intervals in a table; the largest step of the Blackman-Harris table is then 0.033 pixels."""


def _blackman_harris(x: NDArray[np.float64]) -> NDArray[np.float64]:
    # Harris (1978), the 4-term window of minimum side lobes, over a width of 3 pixels.
    t = 2.0 * np.pi * (x / 3.0 + 0.5)
    return 0.35875 - 0.48829 * np.cos(t) + 0.14128 * np.cos(2.0 * t) - 0.01168 * np.cos(3.0 * t)


def _shared(x: NDArray[np.float64]) -> NDArray[np.float64]:
    # A box of 1 pixel, so that all points count alike, smoothed by a raised cosine of 1.5 pixels.
    def sum_of_cosine(x: NDArray[np.float64]) -> NDArray[np.float64]:
        x = np.clip(x / 0.75, -1.0, 1.0)
        result: NDArray[np.float64] = 0.5 * x + 0.5 / np.pi * np.sin(np.pi * x)
        return result

    return sum_of_cosine(x + 0.5) - sum_of_cosine(x - 0.5)


# Name -> (half width in pixels, profile along one axis); a filter is the product over both axes.
_PROFILES: dict[str, tuple[float, Callable[[NDArray[np.float64]], NDArray[np.float64]]]] = {
    "box": (0.5, np.ones_like),
    "tent": (1.0, lambda x: 1.0 - np.abs(x)),
    "gaussian": (2.0, lambda x: np.exp(-0.5 * (x / 0.5) ** 2) - np.exp(-8.0)),
    "blackman-harris": (1.5, _blackman_harris),
    "shared": (1.25, _shared),  # and then blended, see `wrt/rendering/reading.py`
}


@functools.cache
def filter_table(name: str) -> NDArray[np.float32]:
    """Return (TABLE_SIZE + 1,) float32 offsets in pixels: the inverse cumulative distribution. Do not change it.

    `kernels/camera/models.py` reads it.
    """
    half_width, profile = _PROFILES[name]
    place = np.linspace(0.0, 1.0, TABLE_SIZE + 1)
    at = np.where(place < 0.5, 2.0 * place**2, 1.0 - 2.0 * (1.0 - place) ** 2)
    if name == "box":
        return np.asarray(half_width * (2.0 * at - 1.0), np.float32)
    x = np.linspace(-half_width, half_width, 64 * TABLE_SIZE + 1)
    density = profile(x)
    cumulative = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
    cumulative /= cumulative[-1]
    table: NDArray[np.float32] = np.interp(at, cumulative, x).astype(np.float32)
    return table
