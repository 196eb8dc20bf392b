"""Cameras whose lenses distort as in OpenCV: Brown's model and that of fisheyes (see `wrt/scene/distortion.py`).

A ray needs the inverse, which has no formula. The host finds the largest radius up to which the distorted one grows;
below it Newton's method, with halving where a step leaves the bracket, converges. A table took more memory and gave
less accuracy.
"""

import warp as wp

from wrt.kernels.camera.camera import Camera, CameraModel, CameraRay, through_lens

MOST_STEPS = wp.constant(40)

LEAST_STEP = wp.constant(2e-7)
"""Newton's method ends with a smaller step, relative to the radius; single precision has 1.2e-7."""

MOST_ERROR = wp.constant(0.02)
"""Where the point found is distorted to another than was asked for, by more pixels, the camera sees nothing."""


@wp.func
def _radial(camera: Camera, s: float) -> wp.vec2:
    """Return the factor of a radius whose square is s, and its derivative by s."""
    k = camera.radial
    d = camera.radial_divisor
    divisor = 1.0 + s * (d[0] + s * (d[1] + s * d[2]))
    factor = (1.0 + s * (k[0] + s * (k[1] + s * (k[2] + s * k[3])))) / divisor
    slope = k[0] + s * (2.0 * k[1] + s * (3.0 * k[2] + s * 4.0 * k[3]))
    slope_of_divisor = d[0] + s * (2.0 * d[1] + s * 3.0 * d[2])
    return wp.vec2(factor, (slope - factor * slope_of_divisor) / divisor)


@wp.func
def _undistorted_radius(camera: Camera, distorted: float) -> float:
    """Return the radius that is distorted to another one, or the limit if that is too large."""
    low = float(0.0)
    high = float(camera.limit)
    radius = wp.min(distorted, 0.5 * high)  # at the limit there may be a pole, where steps are as small as at the end
    steps = int(0)
    while steps < MOST_STEPS:
        at = _radial(camera, radius * radius)
        error = radius * at[0] - distorted
        step = -error / (at[0] + 2.0 * radius * radius * at[1])
        if error > 0.0:
            high = radius
        else:
            low = radius
        following = radius + step
        steps = steps + 1
        if wp.abs(step) <= LEAST_STEP * radius:
            steps = MOST_STEPS
        elif not (following > low and following < high):
            following = 0.5 * (low + high)
        radius = wp.min(following, camera.limit)
    return radius


@wp.func
def _brown(camera: Camera, p: wp.vec2) -> wp.vec2:
    """Return a distorted point of the plane at distance 1."""
    s = wp.dot(p, p)
    t = camera.tangential
    across = 2.0 * p[0] * p[1]
    return p * _radial(camera, s)[0] + wp.vec2(
        t[0] * across + t[1] * (s + 2.0 * p[0] * p[0]), t[0] * (s + 2.0 * p[1] * p[1]) + t[1] * across
    )


@wp.func
def _brown_inverse(camera: Camera, distorted: wp.vec2) -> wp.vec2:
    """Return the point that is distorted to another; the radial part alone gives the first guess."""
    length = wp.length(distorted)
    p = wp.vec2(distorted[0], distorted[1])
    if length > 0.0:
        p = distorted * (_undistorted_radius(camera, length) / length)
    t = camera.tangential
    if t[0] != 0.0 or t[1] != 0.0:
        steps = int(0)
        while steps < MOST_STEPS:
            at = _radial(camera, wp.dot(p, p))
            # The Jacobian is symmetric.
            xx = at[0] + 2.0 * p[0] * p[0] * at[1] + 2.0 * t[0] * p[1] + 6.0 * t[1] * p[0]
            yy = at[0] + 2.0 * p[1] * p[1] * at[1] + 6.0 * t[0] * p[1] + 2.0 * t[1] * p[0]
            xy = 2.0 * (p[0] * p[1] * at[1] + t[0] * p[0] + t[1] * p[1])
            error = distorted - _brown(camera, p)
            determinant = xx * yy - xy * xy
            step = wp.vec2(yy * error[0] - xy * error[1], xx * error[1] - xy * error[0]) / determinant
            p = p + step
            steps = steps + 1
            if not (wp.length(step) > LEAST_STEP * wp.length(p)):
                steps = MOST_STEPS
    return p


@wp.func
def _perspective_ray(camera: Camera, x: float, y: float, u_lens: wp.vec2) -> CameraRay:
    result = CameraRay()
    film = wp.vec2(x, y)
    p = _brown_inverse(camera, film)
    pixel = wp.min(camera.pixel[0], camera.pixel[1])
    is_inverse = wp.length(_brown(camera, p) - film) <= MOST_ERROR * pixel
    result.visible = is_inverse and wp.length(p) <= camera.limit
    if not result.visible:
        p = wp.vec2(0.0, 0.0)
    through = camera.forward + camera.right * p[0] + camera.up * p[1]
    result.ray = through_lens(camera, camera.origin, through, u_lens)
    cos = wp.dot(camera.forward, result.ray.direction)
    s = wp.dot(p, p)
    at = _radial(camera, s)
    radial = cos * cos / (at[0] + 2.0 * s * at[1])
    result.footprint = wp.vec2(0.0, pixel * wp.max(wp.min(radial, cos / at[0]), 0.0))
    return result


@wp.func
def _perspective_project(camera: Camera, right: float, up: float, forward: float) -> wp.vec2:
    return _brown(camera, wp.vec2(right / forward, up / forward))


DISTORTED_PERSPECTIVE = CameraModel(_perspective_ray, _perspective_project)


@wp.func
def _fisheye_ray(camera: Camera, x: float, y: float, u_lens: wp.vec2) -> CameraRay:
    result = CameraRay()
    radius = wp.sqrt(x * x + y * y)
    angle = _undistorted_radius(camera, radius)
    at = _radial(camera, angle * angle)
    pixel = wp.min(camera.pixel[0], camera.pixel[1])
    result.visible = wp.abs(angle * at[0] - radius) <= MOST_ERROR * pixel
    across = float(1.0)  # sin(angle) / radius
    if radius > 0.0:
        across = wp.sin(angle) / radius
    result.ray.origin = camera.origin
    result.ray.direction = wp.normalize(
        camera.forward * wp.cos(angle) + camera.right * (x * across) + camera.up * (y * across)
    )
    slope = at[0] + 2.0 * angle * angle * at[1]
    result.footprint = wp.vec2(0.0, pixel * wp.max(wp.min(1.0 / slope, wp.abs(across)), 0.0))
    return result


@wp.func
def _fisheye_project(camera: Camera, right: float, up: float, forward: float) -> wp.vec2:
    across = wp.sqrt(right * right + up * up)
    stretch = float(0.0)
    if across > 0.0:
        angle = wp.atan2(across, forward)
        stretch = angle * _radial(camera, angle * angle)[0] / across
    return wp.vec2(right * stretch, up * stretch)


DISTORTED_FISHEYE = CameraModel(_fisheye_ray, _fisheye_project)
