"""How much of a light is seen from a point: shadow rays."""

import warp as wp

from wrt.kernels.accel.intersect import make_intersect
from wrt.kernels.bsdf import models_with
from wrt.kernels.core.features import Features
from wrt.kernels.core.ray_tree import NO_HIT, Hit
from wrt.kernels.core.rays import Ray, to_local
from wrt.kernels.core.scene_data import MATERIAL_MODEL, BodyStack, SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.core.spmd_marks import traces_alone
from wrt.kernels.geometry.surface import Surface, align_tangents, make_add_texture_coordinates, make_surface_at
from wrt.kernels.integrators.sides import is_passed
from wrt.kernels.lights.shapes import make_light_shapes
from wrt.kernels.materials.choice import MOST_PASSED
from wrt.kernels.materials.values import make_share_passed
from wrt.kernels.media.bodies import Crossing, crossed_at, is_there
from wrt.kernels.media.grids import make_shadow_in_media
from wrt.kernels.media.skin import Skin, hit_or_skin, no_skin
from wrt.kernels.textures.normal_maps import apply_normal_map

ATTENUATING = ("models", "composite", "nested")
"""What `can_attenuate_shadows` depends on."""


def can_attenuate_shadows(features: Features) -> bool:
    """Return whether a surface can let a part of the light pass, instead of all or nothing."""
    return features.has_holes or features.nested or bool(models_with(features.models, "straight"))


def may_leave_shadows(features: Features) -> bool:
    """Return whether a scene decides if the caller of `light_at_surface` is to trace its shadow ray.

    General kernels let it decide, since a ray that passes surfaces is traced alone.
    """
    return can_attenuate_shadows(features) and features.is_general


@specialised("tangents", "uv2_alpha", "exact", "textured")
def make_mapped(features: Features) -> wp.Function:
    """Return (scene, hit, surface, direction) -> Surface with texture coordinates and the normal of its normal map."""
    add_texture_coordinates = make_add_texture_coordinates(features.uv2_alpha, features.has_exact)

    @wp.func
    def mapped(scene: SceneData, hit: Hit, at: Surface, direction: wp.vec3) -> Surface:
        surface = at
        if wp.static(features.textured or features.tangents):
            surface = add_texture_coordinates(scene, hit, surface)
        if wp.static(features.tangents):
            surface = align_tangents(scene, hit, surface)
            material = scene.shapes[surface.shape].material
            if scene.materials[material].kind == MATERIAL_MODEL:
                surface = apply_normal_map(scene, material, hit, surface, direction, 0.0)
        return surface

    return mapped


@specialised(
    *("instances", "exact", "composite", "media", "grid_media", "nested", "light_shapes", "single_sided"),
    *(*make_mapped.fields, *make_share_passed.fields),
)
def make_transmission(features: Features) -> wp.Function:
    """Return the visibility through surfaces that let a part of the light pass; see `make_visibility`."""
    meets_others = features.gpu and not features.bodies  # of its warp
    light_shapes = make_light_shapes(features.light_shapes)
    intersect, surface_at = make_intersect(features.geometry), make_surface_at(features.geometry)
    mapped = make_mapped(features)
    share_passed, share_of_holes = make_share_passed(features), make_share_passed(features, holes_only=True)
    shadow_in_media = make_shadow_in_media(features)

    @wp.func
    def passed_at(scene: SceneData, hit: Hit, at: Surface, direction: wp.vec3) -> wp.vec3:
        surface = mapped(scene, hit, at, direction)
        return share_passed(scene, scene.shapes[surface.shape].material, surface, to_local(surface.frame, -direction))

    @wp.func
    def holes_at(scene: SceneData, hit: Hit, at: Surface, direction: wp.vec3) -> wp.vec3:
        # By opacity alone: an emissive pane emits from all of its surface.
        surface = mapped(scene, hit, at, direction)
        return share_of_holes(scene, scene.shapes[surface.shape].material, surface, direction)

    @wp.func
    @traces_alone
    def transmission(
        scene: SceneData, ray: Ray, distance: float, light_point: Hit, inside: BodyStack, skin: Skin, u: wp.vec4
    ) -> wp.vec3:
        share = wp.vec3(1.0)
        if wp.static(features.has_holes):
            if light_point.triangle >= 0:
                share -= holes_at(scene, light_point, surface_at(scene, ray, light_point), ray.direction)
                if wp.static(meets_others):
                    # With a return here, lanes whose light may have holes would trace after the others of their warp.
                    distance = wp.where(wp.max(share) > 0.0, distance, -1.0)
                elif wp.max(share) <= 0.0:
                    return wp.vec3(0.0)
        if wp.static(bool(features.light_shapes)):
            if light_shapes.blocks(scene, ray, distance, light_point):
                return wp.vec3(0.0)
        last = Crossing()
        last.stack = inside
        t_before = float(0.0)
        surfaces_passed = int(0)
        hit = intersect.closest_hit_before(scene, ray, distance)
        if wp.static(features.media == "scattering"):
            hit = hit_or_skin(skin, ray, hit)
        while surfaces_passed < MOST_PASSED:
            if wp.static(features.media != "none"):
                share = wp.cw_mul(share, shadow_in_media(scene, ray, t_before, hit.t, last.stack, u, surfaces_passed))
                t_before = hit.t
            if hit.triangle == NO_HIT:
                return share
            surface = surface_at(scene, ray, hit)
            is_solid = bool(True)
            if wp.static(features.bodies):
                body = scene.shapes[surface.shape].body
                if body >= 0:
                    crossing = crossed_at(last, body, surface.front, hit.t)
                    if wp.static(features.nested):
                        is_solid = is_there(scene, surface, last.stack, crossing.stack)
                    last = crossing
            if wp.static(features.single_sided):
                is_solid = is_solid and not is_passed(scene.shapes[surface.shape], surface.front, False)
            if is_solid:
                share = wp.cw_mul(share, passed_at(scene, hit, surface, ray.direction))
                if wp.max(share) <= 0.0:
                    break
            hit = intersect.next_hit(scene, ray, hit, distance)
            surfaces_passed += 1
        return wp.vec3(0.0)

    return transmission


@specialised("instances", "exact", "media", "grid_media", "light_shapes")
def make_unblocked(features: Features) -> wp.Function:
    """Return the visibility where surfaces block all light; see `make_visibility`."""
    light_shapes = make_light_shapes(features.light_shapes)
    occluded, shadow_in_media = make_intersect(features.geometry).occluded, make_shadow_in_media(features)

    @wp.func
    @traces_alone
    def unblocked(
        scene: SceneData, ray: Ray, distance: float, light_point: Hit, inside: BodyStack, skin: Skin, u: wp.vec4
    ) -> wp.vec3:
        if wp.static(bool(features.light_shapes)):
            if light_shapes.blocks(scene, ray, distance, light_point):
                return wp.vec3(0.0)
        if wp.static(features.media == "scattering"):
            if hit_or_skin(skin, ray, no_skin().hit).triangle != NO_HIT:
                return wp.vec3(0.0)
        if occluded(scene, ray, distance):
            return wp.vec3(0.0)
        if wp.static(features.media != "none"):
            return shadow_in_media(scene, ray, 0.0, distance, inside, u, 0)
        return wp.vec3(1.0)

    return unblocked


@specialised(*ATTENUATING, *make_transmission.fields, *make_unblocked.fields)
def make_visibility(features: Features) -> wp.Function:
    """Return the device function (scene, ray, distance, light_point, inside, skin, u) -> share of light that arrives.

    Per channel, 0 to 1: the product of the light that surfaces before `distance` let straight through, of the
    transmittance of the media between them, and of the opacity of the light itself. `light_point` is a point on a
    triangle or the light shape that is aimed at, or a Hit of nothing; `inside` are the bodies at the ray's origin, and
    `skin` is the surface right beside it. `u`, the numbers that chose the light, seed those of tracking in grids.
    """
    return make_transmission(features) if can_attenuate_shadows(features) else make_unblocked(features)
