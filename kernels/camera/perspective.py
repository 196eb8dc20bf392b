"""A pinhole or thin-lens camera: the film is the plane at distance 1."""

import warp as wp

from wrt.kernels.camera.camera import Camera, CameraModel, CameraRay, through_lens


@wp.func
def _ray(camera: Camera, x: float, y: float, u_lens: wp.vec2) -> CameraRay:
    result = CameraRay()
    result.visible = True
    through = camera.forward + camera.right * x + camera.up * y
    result.ray = through_lens(camera, camera.origin, through, u_lens)
    cos = wp.dot(camera.forward, result.ray.direction)
    result.footprint = wp.vec2(0.0, camera.pixel[1] * cos * cos)
    return result


@wp.func
def _project(camera: Camera, right: float, up: float, forward: float) -> wp.vec2:
    return wp.vec2(right / forward, up / forward)


MODEL = CameraModel(_ray, _project)
