"""An orthographic camera: the film is measured in metres."""

import warp as wp

from wrt.kernels.camera.camera import Camera, CameraModel, CameraRay, through_lens


@wp.func
def _ray(camera: Camera, x: float, y: float, u_lens: wp.vec2) -> CameraRay:
    result = CameraRay()
    result.visible = True
    origin = camera.origin + camera.right * x + camera.up * y
    result.ray = through_lens(camera, origin, camera.forward, u_lens)
    result.footprint = wp.vec2(camera.pixel[1], 0.0)
    return result


@wp.func
def _project(camera: Camera, right: float, up: float, forward: float) -> wp.vec2:
    return wp.vec2(right, up)


MODEL = CameraModel(_ray, _project)
