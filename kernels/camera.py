"""From a point on the film to a ray."""

import warp as wp

from wrt.kernels.geometry import Ray
from wrt.kernels.warps import square_to_disk


@wp.struct
class Camera:
    """A thin-lens perspective camera; `right` and `up` are scaled to half the picture at distance 1."""

    origin: wp.vec3
    right: wp.vec3
    up: wp.vec3
    forward: wp.vec3
    unit_right: wp.vec3
    unit_up: wp.vec3
    lens_radius: float
    focus_distance: float
    width: int
    height: int


@wp.func
def pixel_angle(camera: Camera, direction: wp.vec3) -> float:
    """Return the angle that a pixel takes up in a direction, along its shorter side: outwards it falls as cos²."""
    cos = wp.dot(camera.forward, direction)
    return 2.0 * wp.length(camera.up) / float(camera.height) * cos * cos


@wp.func
def camera_ray(camera: Camera, film: wp.vec2, u_lens: wp.vec2) -> Ray:
    """Return the ray through `film`, in pixels with (0, 0) the top left corner of the picture."""
    x = 2.0 * film[0] / float(camera.width) - 1.0
    y = 1.0 - 2.0 * film[1] / float(camera.height)
    through = camera.forward + camera.right * x + camera.up * y
    ray = Ray()
    ray.origin = camera.origin
    ray.direction = wp.normalize(through)
    if camera.lens_radius > 0.0:
        lens = square_to_disk(u_lens) * camera.lens_radius
        shift = camera.unit_right * lens[0] + camera.unit_up * lens[1]
        ray.origin = camera.origin + shift
        ray.direction = wp.normalize(through * camera.focus_distance - shift)
    return ray
