"""Rays through a tree that holds spheres besides triangles.

A sphere is a triangle whose corners are the lower and the upper corner of the box around it, then the lower one again
(`kernels/native/exact/spheres.h`). Its hits have no u and v: `kernels/geometry/spheres.py` finds the point by the ray.
"""

import warp as wp

from wrt.kernels.accel.bvh import Bvh, Hit, _hit
from wrt.kernels.geometry.rays import Ray
from wrt.kernels.native import include
from wrt.kernels.scene.scene_data import SceneData
from wrt.kernels.spmd_marks import ray_query

_LONGEST = wp.constant(3.0e38)

traversal_spheres_h = include("exact/traversal_spheres.h")


@wp.func_native("return wrt::closest_hit(bvh, origin, direction, t_min, t_max, any_hit);")
def _traverse(bvh: Bvh, origin: wp.vec3, direction: wp.vec3, t_min: float, t_max: float, any_hit: bool) -> wp.vec4:
    traversal_spheres_h()


@wp.func_native("return wrt::next_hit(bvh, origin, direction, t_min, t_max, id_min);")
def _traverse_after(bvh: Bvh, origin: wp.vec3, direction: wp.vec3, t_min: float, t_max: float, id_min: int) -> wp.vec4:
    traversal_spheres_h()


@wp.func
def closest_hit_before(scene: SceneData, ray: Ray, distance: float) -> Hit:
    """Return the nearest hit before `distance`; its triangle is NO_HIT for a miss."""
    return _hit(_traverse(scene.bvh, ray.origin, ray.direction, 0.0, distance, False))


@wp.func
@ray_query
def closest_hit(scene: SceneData, ray: Ray) -> Hit:
    """Return the nearest hit; its triangle is NO_HIT for a miss."""
    return closest_hit_before(scene, ray, _LONGEST)


@wp.func
def next_hit(scene: SceneData, ray: Ray, last: Hit, distance: float) -> Hit:
    """Return the hit after `last` and before `distance`; its triangle is NO_HIT if there is none."""
    return _hit(_traverse_after(scene.bvh, ray.origin, ray.direction, last.t, distance, last.triangle))


@wp.func
@ray_query
def occluded(scene: SceneData, ray: Ray, distance: float) -> bool:
    """Return whether anything lies on the ray before `distance`."""
    found = _traverse(scene.bvh, ray.origin, ray.direction, 0.0, distance, True)
    return wp.cast(found[0], wp.int32) >= 0
