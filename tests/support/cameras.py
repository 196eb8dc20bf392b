"""Camera rays from the device, for any points of the film, of the lens and of time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from support.kernels import upload
from wrt.kernels.camera.camera import Camera, shutter_time
from wrt.kernels.camera.models import DISTORTED, make_camera
from wrt.upload.camera import build_camera

FloatArray = NDArray[np.float64]


class CameraRays(NamedTuple):
    """(N, 3) origins and directions, (N,) times, (N, 2) footprints, (N,) whether the camera sees anything."""

    origins: FloatArray
    directions: FloatArray
    times: FloatArray
    footprints: FloatArray
    visible: NDArray[np.bool_]


camera_ray = make_camera(DISTORTED).ray


@wp.kernel(enable_backward=False)
def rays_kernel(
    camera: Camera,
    films: wp.array(dtype=wp.vec2),
    lenses: wp.array(dtype=wp.vec2),
    shutters: wp.array(dtype=float),
    origins_out: wp.array(dtype=wp.vec3),
    directions_out: wp.array(dtype=wp.vec3),
    times_out: wp.array(dtype=float),
    footprints_out: wp.array(dtype=wp.vec2),
    visible_out: wp.array(dtype=int),
):
    i = wp.tid()
    found = camera_ray(camera, films[i], lenses[i], shutter_time(camera, shutters[i]))
    origins_out[i] = found.ray.origin
    directions_out[i] = found.ray.direction
    times_out[i] = found.ray.time
    footprints_out[i] = found.footprint
    visible_out[i] = wp.where(found.visible, 1, 0)


def camera_rays(camera, width, height, films, lenses=(0.5, 0.5), shutters=0.5, *, device="cpu") -> CameraRays:
    """Return the rays through (N, 2) points of the film, in pixels from the top left corner.

    Random numbers for the lens and the time are one for each ray, or the same for all.
    """
    films = np.asarray(films, np.float32).reshape(-1, 2)
    n = len(films)
    inputs = [
        upload(films, wp.vec2, device),
        upload(np.broadcast_to(np.asarray(lenses, np.float32), (n, 2)).copy(), wp.vec2, device),
        upload(np.broadcast_to(np.asarray(shutters, np.float32), n).copy(), float, device),
    ]
    out = [wp.empty(n, dtype=dtype, device=device) for dtype in (wp.vec3, wp.vec3, float, wp.vec2, int)]
    wp.launch(rays_kernel, n, [build_camera(camera, width, height, device=device), *inputs], out, device=device)
    *numbers, visible = (array.numpy() for array in out)
    return CameraRays(*(array.astype(np.float64) for array in numbers), visible.astype(bool))
