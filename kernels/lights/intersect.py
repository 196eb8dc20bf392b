"""Rays against triangles and light shapes together."""

import warp as wp

from wrt.kernels.accel.bvh import Hit
from wrt.kernels.accel.intersect import INFINITE_DISTANCE, NO_HIT, make_intersect
from wrt.kernels.features import Features
from wrt.kernels.geometry.rays import Ray
from wrt.kernels.lights.shapes import make_light_shapes
from wrt.kernels.scene.scene_data import SceneData
from wrt.kernels.specialise import specialised
from wrt.kernels.spmd_marks import ray_query


@specialised("instances", "exact", "light_shapes")
def make_closest_hit(features: Features) -> wp.Function:
    """Return the device function (scene, ray) -> the nearest hit; its triangle is NO_HIT for a miss.

    For a hit on a light shape, it is a number below NO_HIT.
    """
    triangles = make_intersect(features.geometry)
    if not features.light_shapes:
        return triangles.closest_hit
    triangle_before = triangles.closest_hit_before
    nearer_light_shape = make_light_shapes(features.light_shapes).nearer

    @wp.func(name=f"closest_hit_before_{features.geometry}_lights")
    def before(scene: SceneData, ray: Ray, distance: float) -> Hit:
        hit = triangle_before(scene, ray, distance)
        reach = float(distance)
        if hit.triangle != NO_HIT:
            reach = hit.t
        return nearer_light_shape(scene, ray, hit, reach)

    @wp.func(name=f"closest_hit_{features.geometry}_lights")
    @ray_query
    def nearest(scene: SceneData, ray: Ray) -> Hit:
        return before(scene, ray, INFINITE_DISTANCE)

    return nearest


@specialised(*make_closest_hit.fields)
def make_hit_seen(features: Features) -> wp.Function:
    """Return the device function (scene, ray, with_lights) -> the nearest hit; without lights, on a triangle."""
    nearest, triangle_hit = make_closest_hit(features), make_intersect(features.geometry).closest_hit
    light_shapes = bool(features.light_shapes)

    @wp.func
    def hit_seen(scene: SceneData, ray: Ray, with_lights: bool) -> Hit:
        if wp.static(light_shapes):
            if not with_lights:
                return triangle_hit(scene, ray)
        return nearest(scene, ray)

    return hit_seen
