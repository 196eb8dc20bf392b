import math
from dataclasses import dataclass
from functools import partial
from typing import Annotated

import warp as wp

import wrt
from wrt.kernels.camera.camera import Camera, CameraModel, CameraRay
from wrt.values import number


@wp.func
def ray(camera: Camera, x: float, y: float, u_lens: wp.vec2) -> CameraRay:
    # At the distance r from the middle, with h = r² / 4: cosθ = (1 − h) / (1 + h) and sinθ / r = 1 / (1 + h).
    h = 0.25 * (x * x + y * y)
    result = CameraRay()
    result.ray.origin = camera.origin
    direction = camera.forward * (1.0 - h) + camera.right * x + camera.up * y
    result.ray.direction = wp.normalize(direction)
    result.footprint = wp.vec2(0.0, camera.pixel[1] / (1.0 + h))
    result.visible = True
    return result


@wp.func
def project(camera: Camera, right: float, up: float, forward: float) -> wp.vec2:
    length = wp.sqrt(right * right + up * up + forward * forward)
    return wp.vec2(right, up) * (2.0 / (length + forward))


@dataclass(frozen=True)
class StereographicCamera(wrt.Camera):
    """A stereographic fisheye, by its vertical field of view."""

    type_name = "stereographic"

    fov_degrees: Annotated[float, partial(number, above=0.0, maximum=350.0)] = 180.0

    def film(self, width: int, height: int):
        pixel = 4.0 * math.tan(math.radians(self.fov_degrees) / 4.0) / height
        return {"pixel": (pixel, pixel)}


wrt.register_camera(StereographicCamera, CameraModel(ray, project))

if __name__ == "__main__":
    scene = wrt.load("cornell-box")
    scene.camera = StereographicCamera((0.278, 0.273, 0.05), (0.278, 0.273, 0.5), fov_degrees=200.0)
    wrt.save_image("stereographic.png", wrt.render(scene, width=256, height=256, spp=16))
