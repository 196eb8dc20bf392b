"""Functions shared by flat lights."""

import warp as wp

from wrt.kernels.geometry.rays import Ray
from wrt.kernels.lights.record import NO_MEETING
from wrt.kernels.scene.scene_data import LightRecord, LightShape


@wp.func
def meet_plane(shape: LightShape, ray: Ray) -> float:
    """Return the positive distance at which a ray meets the plane of a flat light, or NO_MEETING."""
    toward = wp.dot(ray.direction, shape.normal)
    if toward == 0.0:
        return NO_MEETING
    t = wp.dot(shape.place - ray.origin, shape.normal) / toward
    if not (t > 0.0):
        return NO_MEETING
    return t


@wp.func
def front_shines_back(light: LightRecord, shape: LightShape, ray: Ray) -> bool:
    """Return whether a ray meets a flat light from an emitting side."""
    return wp.dot(ray.direction, shape.normal) < 0.0 or light.two_sided != 0
