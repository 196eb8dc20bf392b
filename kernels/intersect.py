"""Rays against the scene: the nearest hit, and whether a segment is blocked."""

import functools
from typing import NamedTuple

import warp as wp

from wrt.kernels.bvh import Hit, bvh_any_hit, bvh_closest_hit
from wrt.kernels.geometry import Ray
from wrt.kernels.instances import instance_hit, make_traverse
from wrt.kernels.light_shapes import light_shape_blocks, nearer_light_shape
from wrt.kernels.scene_data import SceneData

NO_HIT = wp.constant(-1)
INFINITE_DISTANCE = wp.constant(3.0e38)


class Intersect(NamedTuple):
    """The device functions that trace rays through scenes of one kind.

    Attributes:
        closest_hit: (scene, ray) -> the nearest hit, or one whose triangle is NO_HIT.
        closest_hit_before: (scene, ray, distance) -> the nearest hit before `distance`, likewise.
        occluded: (scene, ray, distance) -> whether anything lies on the ray before `distance`.
    """

    closest_hit: wp.Function
    closest_hit_before: wp.Function
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
        return Intersect(closest_hit, closest_hit_before, occluded)
    traverse = make_traverse(instances)

    @wp.func(name=f"closest_hit_before_{instances}")
    def before(scene: SceneData, ray: Ray, distance: float) -> Hit:
        found = traverse(scene.placed, ray.origin, ray.direction, ray.time, 0.0, distance, False)
        return instance_hit(scene.placed, found)

    @wp.func(name=f"closest_hit_{instances}")
    def nearest(scene: SceneData, ray: Ray) -> Hit:
        return before(scene, ray, INFINITE_DISTANCE)

    @wp.func(name=f"occluded_{instances}")
    def blocked(scene: SceneData, ray: Ray, distance: float) -> bool:
        found = traverse(scene.placed, ray.origin, ray.direction, ray.time, 0.0, distance, True)
        return wp.cast(found[0], wp.int32) >= 0

    return Intersect(nearest, before, blocked)


def _with_light_shapes(instances: str) -> Intersect:
    _, triangle_before, triangle_blocks = make_intersect(instances)

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

    return Intersect(nearest, before, blocked)
