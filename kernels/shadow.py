"""How much of a light is seen from a point: shadow rays."""

import functools

import warp as wp

from wrt.kernels.bodies import Crossing, crossed, is_same_crossing, is_there
from wrt.kernels.bvh import Hit
from wrt.kernels.features import Features
from wrt.kernels.geometry import Ray, to_local
from wrt.kernels.intersect import NO_HIT, make_intersect
from wrt.kernels.light_shapes import light_shape_blocks
from wrt.kernels.materials import MOST_PASSED, has_panes, make_share_passed
from wrt.kernels.medium import make_extinction, transmittance
from wrt.kernels.normal_maps import apply_normal_map
from wrt.kernels.scene_data import MATERIAL_MODEL, BodyStack, SceneData
from wrt.kernels.skin import Skin, or_skin
from wrt.kernels.surface import Surface, align_tangents, make_add_texture_coordinates, make_surface_at


def dims_light(features: Features) -> bool:
    """Return whether a surface can take a part of light, instead of all or nothing."""
    return features.layered or features.nested or has_panes(features.models)


@functools.cache
def make_visibility(features: Features) -> wp.Function:
    """Return the device function (scene, ray, distance, light_point, inside, skin) -> share of light that arrives.

    Per channel, 0 to 1: the product over all surfaces before `distance` of what they let straight through, and of the
    transmittance of the media between them, times what is there of the light itself. `light_point` is where on a
    triangle it begins, or which light shape it is, or a Hit of nothing; `inside` are the bodies that the ray begins in,
    and `skin` is the surface right beside its origin.
    """
    textured = features.textured
    layered = features.layered
    _, closest_hit_before, next_hit, occluded = make_intersect(features.instances)
    surface_at = make_surface_at(features.instances)
    add_texture_coordinates = make_add_texture_coordinates(features.extras)
    tangents = features.tangents
    bodies = features.bodies
    media = features.media != "none"
    scattering = features.media == "scattering"
    nested = features.nested
    light_shapes = features.light_shapes
    share_passed = make_share_passed(features)
    # A pane that shines does so with all its surface, whatever it lets through.
    share_not_there = make_share_passed(features, holes_only=True)
    extinction_of = make_extinction(features.media)

    @wp.func(name=f"surface_seen_{features.name}")
    def surface_seen(scene: SceneData, hit: Hit, surface: Surface, direction: wp.vec3) -> Surface:
        if wp.static(textured or tangents):
            surface = add_texture_coordinates(scene, hit, surface)
        if wp.static(tangents):
            surface = align_tangents(scene, hit, surface)
            material = scene.shapes[surface.shape].material
            if scene.materials[material].kind == MATERIAL_MODEL:
                surface = apply_normal_map(scene, material, hit, surface, direction, 0.0)
        return surface

    @wp.func(name=f"passed_at_{features.name}")
    def passed_at(scene: SceneData, hit: Hit, at: Surface, direction: wp.vec3) -> wp.vec3:
        surface = surface_seen(scene, hit, at, direction)
        return share_passed(scene, scene.shapes[surface.shape].material, surface, to_local(surface.frame, -direction))

    @wp.func(name=f"not_there_at_{features.name}")
    def not_there_at(scene: SceneData, hit: Hit, at: Surface, direction: wp.vec3) -> wp.vec3:
        surface = surface_seen(scene, hit, at, direction)
        return share_not_there(scene, scene.shapes[surface.shape].material, surface, direction)

    @wp.func(name=f"visibility_{features.name}")
    def through(
        scene: SceneData, ray: Ray, distance: float, light_point: Hit, inside: BodyStack, skin: Skin
    ) -> wp.vec3:
        share = wp.vec3(1.0)
        if wp.static(layered):
            if light_point.triangle >= 0:
                share -= not_there_at(scene, light_point, surface_at(scene, ray, light_point), ray.direction)
                if wp.max(share) <= 0.0:
                    return wp.vec3(0.0)
        if wp.static(light_shapes):
            if light_shape_blocks(scene, ray, distance, light_point):
                return wp.vec3(0.0)
        within = inside
        last = Crossing()
        come = float(0.0)
        passed = int(0)
        hit = closest_hit_before(scene, ray, distance)
        if wp.static(scattering):
            hit = or_skin(skin, ray, hit)
        while passed < MOST_PASSED:
            if wp.static(media):
                share = wp.cw_mul(share, transmittance(extinction_of(scene, within), hit.t - come))
                come = hit.t
            if hit.triangle == NO_HIT:
                return share
            surface = surface_at(scene, ray, hit)
            there = bool(True)
            if wp.static(bodies):
                body = scene.shapes[surface.shape].body
                if body >= 0:
                    after = within
                    if not is_same_crossing(last, body, surface.front, hit.t):
                        after = crossed(within, within, body, surface.front)
                        last.body = body
                        last.front = surface.front
                        last.t = hit.t
                    if wp.static(nested):
                        there = is_there(scene, surface, within, after)
                    within = after
            if there:
                share = wp.cw_mul(share, passed_at(scene, hit, surface, ray.direction))
                if wp.max(share) <= 0.0:
                    break
            hit = next_hit(scene, ray, hit, distance)
            passed += 1
        return wp.vec3(0.0)

    @wp.func(name=f"unblocked_{features.media}{'_shapes' if light_shapes else ''}")
    def unblocked(
        scene: SceneData, ray: Ray, distance: float, light_point: Hit, inside: BodyStack, skin: Skin
    ) -> wp.vec3:
        if wp.static(light_shapes):
            if light_shape_blocks(scene, ray, distance, light_point):
                return wp.vec3(0.0)
        if wp.static(scattering):
            nothing = Hit()
            nothing.triangle = NO_HIT
            if or_skin(skin, ray, nothing).triangle != NO_HIT:
                return wp.vec3(0.0)
        if occluded(scene, ray, distance):
            return wp.vec3(0.0)
        if wp.static(media):
            return transmittance(extinction_of(scene, inside), distance)
        return wp.vec3(1.0)

    return through if dims_light(features) else unblocked
