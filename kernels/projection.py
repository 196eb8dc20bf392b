"""From a point in the world back to the film: what `camera_ray` does, the other way."""

import warp as wp

from wrt.kernels.camera import FISHEYE, ORTHOGRAPHIC, PERSPECTIVE, Camera
from wrt.kernels.motion import transform_at


@wp.func
def film_position(camera: Camera, point: wp.vec3, distant: bool, time: float) -> wp.vec2:
    """Return where the middle of the lens shows a point at a time, in pixels from the whole picture's top left.

    A `distant` point is a direction. The result means nothing for what a camera cannot show, such as points behind it.
    """
    way = point
    if camera.motion.keys > 0:
        placement = transform_at(camera.motion_keys, camera.motion, time)
        back = wp.inverse(placement.linear)
        if distant:
            way = back * point
        else:
            way = back * (point - placement.offset)
    if not distant:
        way = way - camera.origin
    right = wp.dot(way, camera.right)
    up = wp.dot(way, camera.up)
    forward = wp.dot(way, camera.forward)
    x = right
    y = up
    if camera.kind == PERSPECTIVE:
        x = right / forward
        y = up / forward
    elif camera.kind == FISHEYE:
        across = wp.sqrt(right * right + up * up)
        stretch = float(0.0)  # angle / sin(angle), over the length
        if across > 0.0:
            stretch = wp.atan2(across, forward) / across
        x = right * stretch
        y = up * stretch
    elif camera.kind != ORTHOGRAPHIC:
        x = wp.atan2(right, forward)
        y = wp.atan2(up, wp.sqrt(right * right + forward * forward))
    return wp.vec2(
        (x - camera.shift[0]) / camera.pixel[0] + 0.5 * float(camera.width),
        0.5 * float(camera.height) - (y - camera.shift[1]) / camera.pixel[1],
    )
