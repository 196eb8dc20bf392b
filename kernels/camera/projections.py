"""The built-in camera models: rays through points of the film, and back."""

import warp as wp

from wrt.kernels.camera.camera import Camera, CameraModel, CameraRay, through_lens

# A pinhole or thin-lens camera: the film is the plane at distance 1.


@wp.func
def _perspective_ray(camera: Camera, x: float, y: float, u_lens: wp.vec2) -> CameraRay:
    result = CameraRay()
    result.visible = True
    through = camera.forward + camera.right * x + camera.up * y
    result.ray = through_lens(camera, camera.origin, through, u_lens)
    cos = wp.dot(camera.forward, result.ray.direction)
    result.footprint = wp.vec2(0.0, wp.min(camera.pixel[0], camera.pixel[1]) * cos * cos)
    return result


@wp.func
def _perspective_project(camera: Camera, right: float, up: float, forward: float) -> wp.vec2:
    return wp.vec2(right / forward, up / forward)


PERSPECTIVE = CameraModel(_perspective_ray, _perspective_project)


# An orthographic camera: the film is measured in metres.


@wp.func
def _orthographic_ray(camera: Camera, x: float, y: float, u_lens: wp.vec2) -> CameraRay:
    result = CameraRay()
    result.visible = True
    origin = camera.origin + camera.right * x + camera.up * y
    result.ray = through_lens(camera, origin, camera.forward, u_lens)
    result.footprint = wp.vec2(camera.pixel[1], 0.0)
    return result


@wp.func
def _orthographic_project(camera: Camera, right: float, up: float, forward: float) -> wp.vec2:
    return wp.vec2(right, up)


ORTHOGRAPHIC = CameraModel(_orthographic_ray, _orthographic_project)


# A panorama: the film is measured in radians of longitude and latitude.


@wp.func
def _panorama_ray(camera: Camera, x: float, y: float, u_lens: wp.vec2) -> CameraRay:
    result = CameraRay()
    result.visible = True
    cos = wp.cos(y)
    result.ray.origin = camera.origin
    level = camera.forward * wp.cos(x) + camera.right * wp.sin(x)
    result.ray.direction = wp.normalize(level * cos + camera.up * wp.sin(y))
    result.footprint = wp.vec2(0.0, wp.min(camera.pixel[1], camera.pixel[0] * wp.abs(cos)))
    return result


@wp.func
def _panorama_project(camera: Camera, right: float, up: float, forward: float) -> wp.vec2:
    return wp.vec2(wp.atan2(right, forward), wp.atan2(up, wp.sqrt(right * right + forward * forward)))


PANORAMA = CameraModel(_panorama_ray, _panorama_project)


# An equidistant fisheye: the film is measured in radians from the axis.


@wp.func
def _fisheye_ray(camera: Camera, x: float, y: float, u_lens: wp.vec2) -> CameraRay:
    result = CameraRay()
    angle = wp.sqrt(x * x + y * y)
    across = float(1.0)  # sin(angle) / angle
    if angle > 0.0:
        across = wp.sin(angle) / angle
    result.ray.origin = camera.origin
    result.ray.direction = wp.normalize(
        camera.forward * wp.cos(angle) + camera.right * (x * across) + camera.up * (y * across)
    )
    result.footprint = wp.vec2(0.0, wp.min(camera.pixel[0], camera.pixel[1]) * wp.abs(across))
    result.visible = angle <= camera.limit
    return result


@wp.func
def _fisheye_project(camera: Camera, right: float, up: float, forward: float) -> wp.vec2:
    across = wp.sqrt(right * right + up * up)
    stretch = float(0.0)  # angle / sin(angle), over the length
    if across > 0.0:
        stretch = wp.atan2(across, forward) / across
    return wp.vec2(right * stretch, up * stretch)


FISHEYE = CameraModel(_fisheye_ray, _fisheye_project)
