"""A panorama: the film is measured in radians of longitude and latitude."""

import warp as wp

from wrt.kernels.camera.camera import Camera, CameraModel, CameraRay


@wp.func
def _ray(camera: Camera, x: float, y: float, u_lens: wp.vec2) -> CameraRay:
    result = CameraRay()
    result.visible = True
    cos = wp.cos(y)
    result.ray.origin = camera.origin
    level = camera.forward * wp.cos(x) + camera.right * wp.sin(x)
    result.ray.direction = wp.normalize(level * cos + camera.up * wp.sin(y))
    result.footprint = wp.vec2(0.0, wp.min(camera.pixel[1], camera.pixel[0] * wp.abs(cos)))
    return result


@wp.func
def _project(camera: Camera, right: float, up: float, forward: float) -> wp.vec2:
    return wp.vec2(wp.atan2(right, forward), wp.atan2(up, wp.sqrt(right * right + forward * forward)))


MODEL = CameraModel(_ray, _project)
