"""From a point on the film and a moment to a ray."""

import warp as wp

from wrt.kernels.geometry import Ray
from wrt.kernels.motion import MotionKey, MotionRecord, transform_at
from wrt.kernels.warps import TWO_PI, square_to_disk, square_to_triangle

PERSPECTIVE = wp.constant(0)
ORTHOGRAPHIC = wp.constant(1)
PANORAMA = wp.constant(2)
FISHEYE = wp.constant(3)

SQUARE_BLADES = wp.constant(4)


@wp.struct
class Camera:
    """A camera of any kind, and which part of its picture is rendered.

    A point on the film is measured from where the view meets it, to the right and upwards: on the plane at distance 1
    (PERSPECTIVE), in metres (ORTHOGRAPHIC) or in radians (PANORAMA, FISHEYE).
    """

    kind: int
    origin: wp.vec3
    right: wp.vec3
    up: wp.vec3
    forward: wp.vec3
    pixel: wp.vec2  # size of a pixel on the film
    shift: wp.vec2  # the middle of the picture on the film
    limit: float  # of the angle from the view in a fisheye
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
    motion: MotionRecord  # of no keys where it stands still
    motion_keys: wp.array(dtype=MotionKey)
    # Pixels
    width: int  # of the whole picture, as height
    height: int
    crop_x: int  # the first column and row that are rendered
    crop_y: int
    crop_width: int


@wp.struct
class CameraRay:
    """A ray, and what of the film it stands for.

    `footprint` is the width of a pixel where the ray starts, metres, and by how much it grows with each metre: that of
    its shorter side. `visible` is False where the camera sees nothing, as outside a fisheye's circle.
    """

    ray: Ray
    footprint: wp.vec2
    visible: bool


@wp.func
def sample_lens(camera: Camera, u: wp.vec2) -> wp.vec2:
    """Return a point on the lens, to the right and up, uniform over its area."""
    p = wp.vec2()
    if camera.blades == 0:
        return square_to_disk(u) * camera.lens_radius
    if camera.blades == SQUARE_BLADES:
        p = wp.vec2(2.0 * u[0] - 1.0, 2.0 * u[1] - 1.0) * 0.70710678118
    else:
        # One of the triangles between the middle and two corners, and a point in it.
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
    """Return x in [0, 1] below which the share u lies of a density that rises over the first ramp / 2 and falls so."""
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
    """Return a time at which the shutter is open, seconds, by how far it is open."""
    x = trapezoid_quantile(u, camera.shutter_ramp)
    return camera.shutter_open + x * (camera.shutter_close - camera.shutter_open)


@wp.func
def _through_lens(camera: Camera, origin: wp.vec3, through: wp.vec3, u_lens: wp.vec2) -> Ray:
    """Return a ray to where `origin` + t `through` meets the plane in focus; through·forward is 1."""
    ray = Ray()
    ray.origin = origin
    ray.direction = wp.normalize(through)
    if camera.lens_radius > 0.0:
        lens = sample_lens(camera, u_lens)
        shift = camera.right * lens[0] + camera.up * lens[1]
        ray.origin = origin + shift
        ray.direction = wp.normalize(through * camera.focus_distance - shift)
    return ray


@wp.func
def camera_ray(camera: Camera, film: wp.vec2, u_lens: wp.vec2, time: float) -> CameraRay:
    """Return the ray through `film`, in pixels with (0, 0) the top left corner of the whole picture."""
    x = (film[0] - 0.5 * float(camera.width)) * camera.pixel[0] + camera.shift[0]
    y = (0.5 * float(camera.height) - film[1]) * camera.pixel[1] + camera.shift[1]
    result = CameraRay()
    result.visible = True
    ray = Ray()
    if camera.kind == PERSPECTIVE:
        through = camera.forward + camera.right * x + camera.up * y
        ray = _through_lens(camera, camera.origin, through, u_lens)
        cos = wp.dot(camera.forward, ray.direction)
        result.footprint = wp.vec2(0.0, camera.pixel[1] * cos * cos)
    elif camera.kind == ORTHOGRAPHIC:
        origin = camera.origin + camera.right * x + camera.up * y
        ray = _through_lens(camera, origin, camera.forward, u_lens)
        result.footprint = wp.vec2(camera.pixel[1], 0.0)
    elif camera.kind == PANORAMA:
        cos = wp.cos(y)
        ray.origin = camera.origin
        level = camera.forward * wp.cos(x) + camera.right * wp.sin(x)
        ray.direction = wp.normalize(level * cos + camera.up * wp.sin(y))
        result.footprint = wp.vec2(0.0, wp.min(camera.pixel[1], camera.pixel[0] * wp.abs(cos)))
    else:
        angle = wp.sqrt(x * x + y * y)
        across = float(1.0)  # sin(angle) / angle
        if angle > 0.0:
            across = wp.sin(angle) / angle
        ray.origin = camera.origin
        ray.direction = wp.normalize(
            camera.forward * wp.cos(angle) + camera.right * (x * across) + camera.up * (y * across)
        )
        result.footprint = wp.vec2(0.0, camera.pixel[1] * wp.abs(across))
        result.visible = angle <= camera.limit
    if camera.motion.keys > 0:
        placement = transform_at(camera.motion_keys, camera.motion, time)
        ray.origin = placement.linear * ray.origin + placement.offset
        ray.direction = wp.normalize(placement.linear * ray.direction)
    ray.time = time
    result.ray = ray
    return result
