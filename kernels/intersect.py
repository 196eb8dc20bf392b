"""Rays against the scene: the nearest hit, and whether a segment is blocked."""

import functools
from typing import NamedTuple

import warp as wp

from wrt.kernels.bvh import Hit, bvh_any_hit, bvh_closest_hit, bvh_next_hit
from wrt.kernels.geometry import Ray
from wrt.kernels.instances import instance_hit, make_traverse, make_traverse_after
from wrt.kernels.light_shapes import light_shape_blocks, nearer_light_shape
from wrt.kernels.scene_data import SceneData

NO_HIT = wp.constant(-1)
INFINITE_DISTANCE = wp.constant(3.0e38)


class Intersect(NamedTuple):
    """The device functions that trace rays through scenes of one kind.

    Attributes:
        closest_hit: (scene, ray) -> the nearest hit, or one whose triangle is NO_HIT.
        closest_hit_before: (scene, ray, distance) -> the nearest hit before `distance`, likewise.
        next_hit: (scene, ray, last, distance) -> the hit that follows `last` before `distance`, in the same place or
            behind it; of an equal distance those of a higher instance, then a higher triangle follow.
        occluded: (scene, ray, distance) -> whether anything lies on the ray before `distance`.
    """

    closest_hit: wp.Function
    closest_hit_before: wp.Function
    next_hit: wp.Function
    occluded: wp.Function


@wp.func
def closest_hit(scene: SceneData, ray: Ray) -> Hit:
    """Return the nearest hit, or one whose triangle is NO_HIT."""
    return bvh_closest_hit(scene.bvh, ray.origin, ray.direction, 0.0, INFINITE_DISTANCE)


@wp.func
def closest_hit_before(scene: SceneData, ray: Ray, distance: float) -> Hit:
    """Return the nearest hit before `distance`, or one whose triangle is NO_HIT."""
    return bvh_closest_hit(scene.bvh, ray.origin, ray.direction, 0.0, distance)


@wp.func
def next_hit(scene: SceneData, ray: Ray, last: Hit, distance: float) -> Hit:
    """Return the hit that follows `last` before `distance`, or one whose triangle is NO_HIT."""
    return bvh_next_hit(scene.bvh, ray.origin, ray.direction, last, distance)


@wp.func
def occluded(scene: SceneData, ray: Ray, distance: float) -> bool:
    """Return whether anything lies on the ray before `distance`."""
    return bvh_any_hit(scene.bvh, ray.origin, ray.direction, 0.0, distance)


@functools.cache
def make_intersect(instances: str, light_shapes: bool = False) -> Intersect:
    """Return the functions for scenes with these instances, named as in Features, and with light shapes or without.

    A light shape that is hit has a number below NO_HIT in place of a triangle's (see `kernels.light_shapes`).
    """
    if light_shapes:
        return _with_light_shapes(instances)
    if instances == "none":
        return Intersect(closest_hit, closest_hit_before, next_hit, occluded)
    traverse = make_traverse(instances)
    traverse_after = make_traverse_after(instances)

    @wp.func(name=f"closest_hit_before_{instances}")
    def before(scene: SceneData, ray: Ray, distance: float) -> Hit:
        found = traverse(scene.placed, ray.origin, ray.direction, ray.time, 0.0, distance, False)
        return instance_hit(scene.placed, found)

    @wp.func(name=f"closest_hit_{instances}")
    def nearest(scene: SceneData, ray: Ray) -> Hit:
        return before(scene, ray, INFINITE_DISTANCE)

    @wp.func(name=f"next_hit_{instances}")
    def following(scene: SceneData, ray: Ray, last: Hit, distance: float) -> Hit:
        placed = scene.placed
        triangle = last.triangle - placed.instances[last.instance].first_triangle
        found = traverse_after(placed, ray.origin, ray.direction, ray.time, last.t, distance, last.instance, triangle)
        return instance_hit(placed, found)

    @wp.func(name=f"occluded_{instances}")
    def blocked(scene: SceneData, ray: Ray, distance: float) -> bool:
        found = traverse(scene.placed, ray.origin, ray.direction, ray.time, 0.0, distance, True)
        return wp.cast(found[0], wp.int32) >= 0

    return Intersect(nearest, before, following, blocked)


def _with_light_shapes(instances: str) -> Intersect:
    _, triangle_before, next_triangle, triangle_blocks = make_intersect(instances)

    @wp.func(name=f"closest_hit_before_{instances}_lights")
    def before(scene: SceneData, ray: Ray, distance: float) -> Hit:
        hit = triangle_before(scene, ray, distance)
        reach = float(distance)
        if hit.triangle != NO_HIT:
            reach = hit.t
        return nearer_light_shape(scene, ray, hit, reach)

    @wp.func(name=f"closest_hit_{instances}_lights")
    def nearest(scene: SceneData, ray: Ray) -> Hit:
        return before(scene, ray, INFINITE_DISTANCE)

    @wp.func(name=f"occluded_{instances}_lights")
    def blocked(scene: SceneData, ray: Ray, distance: float) -> bool:
        nobody = Hit()
        nobody.triangle = NO_HIT
        return light_shape_blocks(scene, ray, distance, nobody) or triangle_blocks(scene, ray, distance)

    return Intersect(nearest, before, next_triangle, blocked)
