"""An equidistant fisheye: the film is measured in radians from the axis."""

import warp as wp

from wrt.kernels.camera.camera import Camera, CameraModel, CameraRay


@wp.func
def _ray(camera: Camera, x: float, y: float, u_lens: wp.vec2) -> CameraRay:
    result = CameraRay()
    angle = wp.sqrt(x * x + y * y)
    across = float(1.0)  # sin(angle) / angle
    if angle > 0.0:
        across = wp.sin(angle) / angle
    result.ray.origin = camera.origin
    result.ray.direction = wp.normalize(
        camera.forward * wp.cos(angle) + camera.right * (x * across) + camera.up * (y * across)
    )
    result.footprint = wp.vec2(0.0, camera.pixel[1] * wp.abs(across))
    result.visible = angle <= camera.limit
    return result


@wp.func
def _project(camera: Camera, right: float, up: float, forward: float) -> wp.vec2:
    across = wp.sqrt(right * right + up * up)
    stretch = float(0.0)  # angle / sin(angle), over the length
    if across > 0.0:
        stretch = wp.atan2(across, forward) / across
    return wp.vec2(right * stretch, up * stretch)


MODEL = CameraModel(_ray, _project)
