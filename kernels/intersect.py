"""Rays against the scene: the nearest hit, and whether a segment is blocked."""

import warp as wp

from wrt.kernels.bvh import Hit, bvh_any_hit, bvh_closest_hit
from wrt.kernels.geometry import Ray
from wrt.kernels.scene_data import SceneData

NO_HIT = wp.constant(-1)
INFINITE_DISTANCE = wp.constant(3.0e38)


@wp.func
def closest_hit(scene: SceneData, ray: Ray) -> Hit:
    """Return the nearest hit, or one whose triangle is NO_HIT."""
    return bvh_closest_hit(scene.bvh, ray.origin, ray.direction, 0.0, INFINITE_DISTANCE)


@wp.func
def closest_hit_before(scene: SceneData, ray: Ray, distance: float) -> Hit:
    """Return the nearest hit before `distance`, or one whose triangle is NO_HIT."""
    return bvh_closest_hit(scene.bvh, ray.origin, ray.direction, 0.0, distance)


@wp.func
def occluded(scene: SceneData, ray: Ray, distance: float) -> bool:
    """Return whether anything lies on the ray before `distance`."""
    return bvh_any_hit(scene.bvh, ray.origin, ray.direction, 0.0, distance)
