"""The camera's record, lens and shutter; the models of `kernels/camera` generate the rays."""

from typing import NamedTuple

import warp as wp

from wrt.kernels.core.motion import MotionKey, MotionRecord
from wrt.kernels.core.rays import Ray
from wrt.kernels.sampling.warps import TWO_PI, square_to_disk, square_to_triangle

SQUARE_BLADES = wp.constant(4)


@wp.struct
class Camera:
    """A camera of any model, and the crop of its picture that is rendered.

    Points on the film are measured from its centre, to the right and upwards, in the unit of the camera's model.
    """

    kind: int
    origin: wp.vec3
    right: wp.vec3
    up: wp.vec3
    forward: wp.vec3
    pixel: wp.vec2  # size of a pixel on the film
    shift: wp.vec2  # the picture's centre on the film
    limit: float  # of a fisheye's angle from the axis, or of the radius that is distorted
    radial: wp.vec4  # distortion, see `kernels/camera/distortion.py`
    radial_divisor: wp.vec3
    tangential: wp.vec2
    parameters: wp.vec4  # for models from outside
    # Lens
    lens_radius: float
    focus_distance: float
    blades: int  # 0 for a disk
    lens_cos: float
    lens_sin: float
    # Shutter
    shutter_open: float
    shutter_close: float
    shutter_ramp: float
    motion: MotionRecord  # without keys if it stands still
    motion_keys: wp.array(dtype=MotionKey)
    # Pixels
    width: int  # of the whole picture, as height
    height: int
    crop_x: int  # first column (and row) of the crop
    crop_y: int
    crop_width: int


@wp.struct
class CameraRay:
    """A ray and its footprint.

    `footprint` is the width of a pixel at the ray's origin, metres, and its growth per metre, for the pixel's shorter
    side. `visible` is False where the camera sees nothing, as outside a fisheye's circle.
    """

    ray: Ray
    footprint: wp.vec2
    visible: bool


class CameraModel(NamedTuple):
    """A kind of camera: two device functions, inverses of each other.

    Attributes:
        ray: (camera, x, y, u_lens: vec2) -> CameraRay through a point on the film, before the camera's motion.
        project: (camera, right, up, forward) -> vec2: the point on the film where the lens centre sees a point given
            along the camera's axes; undefined for points that the camera cannot see.
    """

    ray: wp.Function
    project: wp.Function


@wp.func
def sample_lens(camera: Camera, u: wp.vec2) -> wp.vec2:
    """Return a point on the lens, right and up, uniform over its area."""
    p = wp.vec2()
    if camera.blades == 0:
        return square_to_disk(u) * camera.lens_radius
    if camera.blades == SQUARE_BLADES:
        p = wp.vec2(2.0 * u[0] - 1.0, 2.0 * u[1] - 1.0) * 0.70710678118
    else:
        # Choose a triangle between the centre and two corners, and a point in it.
        scaled = u[0] * float(camera.blades)
        i = wp.min(int(scaled), camera.blades - 1)
        b = square_to_triangle(wp.vec2(scaled - float(i), u[1]))
        step = TWO_PI / float(camera.blades)
        first = step * float(i)
        second = first + step
        p = wp.vec2(wp.cos(first), wp.sin(first)) * b[0] + wp.vec2(wp.cos(second), wp.sin(second)) * b[1]
    p = p * camera.lens_radius
    return wp.vec2(
        camera.lens_cos * p[0] - camera.lens_sin * p[1],
        camera.lens_sin * p[0] + camera.lens_cos * p[1],
    )


@wp.func
def trapezoid_quantile(u: float, ramp: float) -> float:
    """Return the quantile u of a density on [0, 1] that rises over the first ramp / 2 and falls over the last."""
    a = 0.5 * ramp
    h = 1.0 / (1.0 - a)
    corner = 0.5 * a * h
    if u < corner:
        return wp.sqrt(2.0 * a * u / h)
    if u > 1.0 - corner:
        return 1.0 - wp.sqrt(2.0 * a * (1.0 - u) / h)
    return 0.5 * a + u / h


@wp.func
def shutter_time(camera: Camera, u: float) -> float:
    """Return a time, seconds, with a density proportional to the shutter's opening."""
    x = trapezoid_quantile(u, camera.shutter_ramp)
    return camera.shutter_open + x * (camera.shutter_close - camera.shutter_open)


@wp.func
def through_lens(camera: Camera, origin: wp.vec3, through: wp.vec3, u_lens: wp.vec2) -> Ray:
    """Return a ray through the lens to the point where `origin` + t `through` is in focus; through·forward is 1."""
    ray = Ray()
    ray.origin = origin
    ray.direction = wp.normalize(through)
    if camera.lens_radius > 0.0:
        lens = sample_lens(camera, u_lens)
        shift = camera.right * lens[0] + camera.up * lens[1]
        ray.origin = origin + shift
        ray.direction = wp.normalize(through * camera.focus_distance - shift)
    return ray
