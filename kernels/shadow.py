"""How much of a light is seen from a point: shadow rays."""

import functools

import warp as wp

from wrt.kernels.bvh import Hit
from wrt.kernels.features import Features
from wrt.kernels.geometry import Ray
from wrt.kernels.intersect import NO_HIT, make_intersect
from wrt.kernels.light_shapes import light_shape_blocks
from wrt.kernels.materials import MOST_PASSED, transmittance_of
from wrt.kernels.scene_data import SceneData
from wrt.kernels.surface import Surface, add_texture_coordinates, make_surface_at
from wrt.kernels.triangles import leave_surface


@functools.cache
def make_visibility(features: Features) -> wp.Function:
    """Return the device function (scene, ray, distance, light_point) -> share of light that comes through, 0 to 1.

    It is the product over all surfaces before `distance` of what they let pass, times what is there of the light
    itself: `light_point` is where on a triangle it begins, or which light shape it is, or a Hit of nothing.
    """
    textured = features.textured
    _, closest_hit_before, occluded = make_intersect(features.instances)
    surface_at = make_surface_at(features.instances)
    light_shapes = features.light_shapes
    name = f"{'textured' if textured else 'plain'}{'_shapes' if light_shapes else ''}"

    @wp.func(name=f"transmittance_at_{'textured' if textured else 'plain'}")
    def transmittance_at(scene: SceneData, hit: Hit, surface: Surface) -> float:
        if wp.static(textured):
            surface = add_texture_coordinates(scene, hit, surface)
        return transmittance_of(scene, scene.shapes[surface.shape].material, surface)

    @wp.func(name=f"visibility_{name}")
    def through_opacity(scene: SceneData, ray: Ray, distance: float, light_point: Hit) -> float:
        share = float(1.0)
        if light_point.triangle >= 0:
            share -= transmittance_at(scene, light_point, surface_at(scene, ray, light_point))
        if wp.static(light_shapes):
            if light_shape_blocks(scene, ray, distance, light_point):
                return 0.0
        rest = Ray()
        rest.origin = ray.origin
        rest.direction = ray.direction
        rest.time = ray.time
        left = float(distance)
        passed = int(0)
        while share > 0.0 and passed < MOST_PASSED:
            hit = closest_hit_before(scene, rest, left)
            if hit.triangle == NO_HIT:
                return share
            surface = surface_at(scene, rest, hit)
            share *= transmittance_at(scene, hit, surface)
            rest.origin = leave_surface(surface.position, -surface.normal, surface.slack)
            left = distance - wp.dot(rest.origin - ray.origin, ray.direction)
            passed += 1
        return 0.0

    @wp.func(name=f"unblocked{'_shapes' if light_shapes else ''}")
    def unblocked(scene: SceneData, ray: Ray, distance: float, light_point: Hit) -> float:
        if wp.static(light_shapes):
            if light_shape_blocks(scene, ray, distance, light_point):
                return 0.0
        return wp.where(occluded(scene, ray, distance), 0.0, 1.0)

    return through_opacity if features.layered else unblocked
