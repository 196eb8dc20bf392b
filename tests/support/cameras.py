"""Camera rays from the device, for any points of the film, of the lens and of time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

import wrt
from support.kernels import upload
from wrt.kernels.camera.camera import Camera, shutter_time
from wrt.kernels.camera.models import make_camera
from wrt.upload.camera import build_camera

FloatArray = NDArray[np.float64]


class CameraRays(NamedTuple):
    """(N, 3) origins and directions, (N,) times, (N, 2) footprints, (N,) whether the camera sees anything."""

    origins: FloatArray
    directions: FloatArray
    times: FloatArray
    footprints: FloatArray
    visible: NDArray[np.bool_]


camera_ray = make_camera().ray


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
    seen = camera_ray(camera, films[i], lenses[i], shutter_time(camera, shutters[i]))
    origins_out[i] = seen.ray.origin
    directions_out[i] = seen.ray.direction
    times_out[i] = seen.ray.time
    footprints_out[i] = seen.footprint
    visible_out[i] = wp.where(seen.visible, 1, 0)


def camera_rays(
    camera: wrt.Camera,
    width: int,
    height: int,
    films: ArrayLike,
    lenses: ArrayLike = (0.5, 0.5),
    shutters: ArrayLike = 0.5,
    *,
    device: str = "cpu",
) -> CameraRays:
    """Return the rays through points of the film.

    Args:
        camera: any.
        width: of the picture, pixels.
        height: of the picture, pixels.
        films: (N, 2) pixels from the top left corner.
        lenses: (N, 2) or one pair of random numbers for the lens.
        shutters: (N,) or one random number for the time.
        device: where to run.
    """
    films = np.asarray(films, np.float32).reshape(-1, 2)
    n = len(films)
    inputs = [
        upload(films, wp.vec2, device),
        upload(np.broadcast_to(np.asarray(lenses, np.float32), (n, 2)).copy(), wp.vec2, device),
        upload(np.broadcast_to(np.asarray(shutters, np.float32), n).copy(), float, device),
    ]
    types = (wp.vec3, wp.vec3, float, wp.vec2, int)
    out = [wp.empty(n, dtype=dtype, device=device) for dtype in types]
    wp.launch(rays_kernel, n, [build_camera(camera, width, height, device=device), *inputs], out, device=device)
    origins, directions, times, footprints, visible = (array.numpy() for array in out)
    return CameraRays(
        origins.astype(np.float64),
        directions.astype(np.float64),
        times.astype(np.float64),
        footprints.astype(np.float64),
        visible.astype(bool),
    )
