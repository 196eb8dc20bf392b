"""Rays against the scene: the nearest hit, and occlusion."""

from typing import NamedTuple

import warp as wp

from wrt.kernels.accel.bvh import Hit, bvh_any_hit, bvh_closest_hit, bvh_next_hit
from wrt.kernels.accel.exact import make_exact_queries
from wrt.kernels.accel.instances import instance_hit, make_traverse, make_traverse_after
from wrt.kernels.features import has_exact, has_quadrics, instances_of
from wrt.kernels.geometry.rays import Ray
from wrt.kernels.scene.scene_data import SceneData
from wrt.kernels.specialise import specialised
from wrt.kernels.spmd_marks import ray_query

NO_HIT = wp.constant(-1)
INFINITE_DISTANCE = wp.constant(3.0e38)


class Intersect(NamedTuple):
    """The device functions that trace rays through scenes of one kind.

    Attributes:
        closest_hit: (scene, ray) -> the nearest hit; its triangle is NO_HIT for a miss.
        closest_hit_before: (scene, ray, distance) -> the nearest hit before `distance`, likewise.
        next_hit: (scene, ray, last, distance) -> the hit after `last` and before `distance`; hits at equal distances
            follow by instance, then by triangle.
        occluded: (scene, ray, distance) -> whether anything lies on the ray before `distance`.
    """

    closest_hit: wp.Function
    closest_hit_before: wp.Function
    next_hit: wp.Function
    occluded: wp.Function


@wp.func
@ray_query
def closest_hit(scene: SceneData, ray: Ray) -> Hit:
    """Return the nearest hit; its triangle is NO_HIT for a miss."""
    return bvh_closest_hit(scene.bvh, ray.origin, ray.direction, 0.0, INFINITE_DISTANCE)


@wp.func
def closest_hit_before(scene: SceneData, ray: Ray, distance: float) -> Hit:
    """Return the nearest hit before `distance`; its triangle is NO_HIT for a miss."""
    return bvh_closest_hit(scene.bvh, ray.origin, ray.direction, 0.0, distance)


@wp.func
def next_hit(scene: SceneData, ray: Ray, last: Hit, distance: float) -> Hit:
    """Return the hit after `last` and before `distance`; its triangle is NO_HIT if there is none."""
    return bvh_next_hit(scene.bvh, ray.origin, ray.direction, last, distance)


@wp.func
@ray_query
def occluded(scene: SceneData, ray: Ray, distance: float) -> bool:
    """Return whether anything lies on the ray before `distance`."""
    return bvh_any_hit(scene.bvh, ray.origin, ray.direction, 0.0, distance)


@specialised()
def make_intersect(geometry: str) -> Intersect:
    """Return the functions for scenes with this `Features.geometry`."""
    if instances_of(geometry) == "none":
        if has_exact(geometry):
            return Intersect(*make_exact_queries(has_quadrics(geometry)))
        return Intersect(closest_hit, closest_hit_before, next_hit, occluded)
    traverse = make_traverse(geometry)
    traverse_after = make_traverse_after(geometry)
    exact = has_exact(geometry)

    @wp.func(name=f"closest_hit_before_{geometry}")
    def before(scene: SceneData, ray: Ray, distance: float) -> Hit:
        if wp.static(exact):
            found = traverse(
                scene.placed, scene.corners, scene.normals, ray.origin, ray.direction, ray.time, 0.0, distance, False
            )
        else:
            found = traverse(scene.placed, ray.origin, ray.direction, ray.time, 0.0, distance, False)
        return instance_hit(scene.placed, found)

    @wp.func(name=f"closest_hit_{geometry}")
    @ray_query
    def nearest(scene: SceneData, ray: Ray) -> Hit:
        return before(scene, ray, INFINITE_DISTANCE)

    @wp.func(name=f"next_hit_{geometry}")
    def following(scene: SceneData, ray: Ray, last: Hit, distance: float) -> Hit:
        placed = scene.placed
        triangle = last.triangle - placed.instances[last.instance].first_triangle
        if wp.static(exact):
            found = traverse_after(
                placed,
                scene.corners,
                scene.normals,
                ray.origin,
                ray.direction,
                ray.time,
                last.t,
                distance,
                last.instance,
                triangle,
            )
        else:
            found = traverse_after(
                placed, ray.origin, ray.direction, ray.time, last.t, distance, last.instance, triangle
            )
        return instance_hit(placed, found)

    @wp.func(name=f"occluded_{geometry}")
    @ray_query
    def blocked(scene: SceneData, ray: Ray, distance: float) -> bool:
        if wp.static(exact):
            found = traverse(
                scene.placed, scene.corners, scene.normals, ray.origin, ray.direction, ray.time, 0.0, distance, True
            )
        else:
            found = traverse(scene.placed, ray.origin, ray.direction, ray.time, 0.0, distance, True)
        return wp.cast(found[0], wp.int32) >= 0

    return Intersect(nearest, before, following, blocked)
