"""The camera ray of a sample: a point of its pixel, a point on the lens, and a time while the shutter is open."""

import warp as wp

from wrt.kernels.camera.camera import Camera, CameraRay, shutter_time
from wrt.kernels.camera.models import make_camera
from wrt.kernels.core.features import Features
from wrt.kernels.core.specialise import specialised
from wrt.kernels.sampling.sampler import BLOCK_FILM_AND_LENS, BLOCK_TIME, Sampler, make_sample_camera


@wp.func
def filter_offset(table: wp.array(dtype=float), u: float) -> float:
    """Return the offset from the pixel's centre along one axis, in pixels."""
    last = table.shape[0] - 1
    # Entries are closer towards both ends, where the inverse distribution is steep. They are spaced by a square root:
    # an arc sine fits no better and took 4 % of a path in the Cornell box.
    x = wp.sqrt(0.5 * wp.min(u, 1.0 - u))
    x = wp.where(u < 0.5, x, 1.0 - x) * float(last)
    i = wp.min(int(x), last - 1)
    f = x - float(i)
    return table[i] * (1.0 - f) + table[i + 1] * f


@wp.struct
class CameraSample:
    """A camera ray, and the point through which it goes, in pixels of the whole picture."""

    seen: CameraRay
    position: wp.vec2


@specialised("cameras", "sampler")
def make_camera_sample(features: Features) -> wp.Function:
    """Return (camera, filter_table, sampler, x, y) -> CameraSample through the pixel in column x and row y."""
    camera_ray = make_camera(features.cameras).ray
    sample_camera = make_sample_camera(features.sampler)

    @wp.func
    def camera_sample(
        camera: Camera, filter_table: wp.array(dtype=float), sampler: Sampler, x: int, y: int
    ) -> CameraSample:
        sample = CameraSample()
        u = sample_camera(sampler, BLOCK_FILM_AND_LENS)
        sample.position = wp.vec2(
            float(x) + 0.5 + filter_offset(filter_table, u[0]),
            float(y) + 0.5 + filter_offset(filter_table, u[1]),
        )
        time = camera.shutter_open
        if camera.shutter_close > camera.shutter_open:
            time = shutter_time(camera, sample_camera(sampler, BLOCK_TIME)[0])
        sample.seen = camera_ray(camera, sample.position, wp.vec2(u[2], u[3]), time)
        return sample

    return camera_sample
