"""How much of a light is seen from a point: shadow rays."""

from typing import NamedTuple

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
from wrt.kernels.lights.shapes import make_light_shapes
from wrt.kernels.materials.choice import MOST_PASSED
from wrt.kernels.materials.values import make_share_passed
from wrt.kernels.media.bodies import Crossing, crossed, is_same_crossing, is_there
from wrt.kernels.media.grids import make_shadow_in_media
from wrt.kernels.media.medium import make_extinction, transmittance
from wrt.kernels.media.skin import Skin, or_skin
from wrt.kernels.sampling.sampler import stream_key
from wrt.kernels.textures.normal_maps import apply_normal_map

ATTENUATING = ("models", "opacity", "nested")
"""What `can_attenuate_shadows` depends on."""


def can_attenuate_shadows(features: Features) -> bool:
    """Return whether a surface can let a part of the light pass, instead of all or nothing."""
    return features.opacity or features.nested or bool(models_with(features.models, "straight"))


class PassedShares(NamedTuple):
    """Device functions (scene, hit, surface, direction) -> vec3: the share of light that goes straight through there.

    Attributes:
        passed: what goes through holes and panes.
        holes: what goes through holes by opacity alone: a pane that shines does so with all its surface.
    """

    passed: wp.Function
    holes: wp.Function


@specialised("textured", "tangents", "exact", *make_share_passed.fields)
def make_passed_shares(features: Features) -> PassedShares:
    """Return the functions for scenes with these features."""
    textured, tangents = features.textured, features.tangents
    add_texture_coordinates = make_add_texture_coordinates(features.uv2_alpha, features.has_exact)
    share_passed = make_share_passed(features)
    share_not_there = make_share_passed(features, holes_only=True)

    @wp.func
    def surface_seen(scene: SceneData, hit: Hit, surface: Surface, direction: wp.vec3) -> Surface:
        if wp.static(textured or tangents):
            surface = add_texture_coordinates(scene, hit, surface)
        if wp.static(tangents):
            surface = align_tangents(scene, hit, surface)
            material = scene.shapes[surface.shape].material
            if scene.materials[material].kind == MATERIAL_MODEL:
                surface = apply_normal_map(scene, material, hit, surface, direction, 0.0)
        return surface

    @wp.func
    def passed_at(scene: SceneData, hit: Hit, at: Surface, direction: wp.vec3) -> wp.vec3:
        surface = surface_seen(scene, hit, at, direction)
        return share_passed(scene, scene.shapes[surface.shape].material, surface, to_local(surface.frame, -direction))

    @wp.func
    def holes_at(scene: SceneData, hit: Hit, at: Surface, direction: wp.vec3) -> wp.vec3:
        surface = surface_seen(scene, hit, at, direction)
        return share_not_there(scene, scene.shapes[surface.shape].material, surface, direction)

    return PassedShares(passed_at, holes_at)


@specialised(
    "instances",
    "exact",
    "opacity",
    "media",
    "grid_media",
    "nested",
    "light_shapes",
    "gpu",
    *make_passed_shares.fields,
)
def make_transmission(features: Features) -> wp.Function:
    """Return the visibility through surfaces that let a part of the light pass; see `make_visibility`."""
    opacity, bodies = features.opacity, features.bodies
    meets_others = features.gpu and not bodies  # of its warp
    media = features.media != "none"
    scattering = features.media == "scattering"
    nested = features.nested
    light_shapes = bool(features.light_shapes)
    light_shape_blocks = make_light_shapes(features.light_shapes).blocks
    intersect = make_intersect(features.geometry)
    closest_hit_before, next_hit = intersect.closest_hit_before, intersect.next_hit
    surface_at = make_surface_at(features.geometry)
    shares = make_passed_shares(features)
    passed_at, holes_at = shares.passed, shares.holes
    grid_media = features.grid_media
    extinction_of, shadow_in_media = make_extinction(features.media), make_shadow_in_media(features.media)

    @wp.func
    @traces_alone
    def transmission(
        scene: SceneData, ray: Ray, distance: float, light_point: Hit, inside: BodyStack, skin: Skin, u: wp.vec4
    ) -> wp.vec3:
        share = wp.vec3(1.0)
        if wp.static(opacity):
            if light_point.triangle >= 0:
                share -= holes_at(scene, light_point, surface_at(scene, ray, light_point), ray.direction)
                if wp.static(meets_others):
                    # With a way out here, lanes whose light may have holes would trace after the others of their warp.
                    distance = wp.where(wp.max(share) > 0.0, distance, -1.0)
                elif wp.max(share) <= 0.0:
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
                if wp.static(grid_media):
                    left = shadow_in_media(scene, ray, come, hit.t, within, stream_key(u, passed))
                    share = wp.cw_mul(share, left)
                else:
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

    return transmission


@specialised("instances", "exact", "media", "grid_media", "light_shapes")
def make_unblocked(features: Features) -> wp.Function:
    """Return the visibility where surfaces block all light; see `make_visibility`."""
    media = features.media != "none"
    scattering = features.media == "scattering"
    light_shapes = bool(features.light_shapes)
    light_shape_blocks = make_light_shapes(features.light_shapes).blocks
    occluded = make_intersect(features.geometry).occluded
    grid_media = features.grid_media
    extinction_of, shadow_in_media = make_extinction(features.media), make_shadow_in_media(features.media)

    @wp.func
    @traces_alone
    def unblocked(
        scene: SceneData, ray: Ray, distance: float, light_point: Hit, inside: BodyStack, skin: Skin, u: wp.vec4
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
            if wp.static(grid_media):
                return shadow_in_media(scene, ray, 0.0, distance, inside, stream_key(u, 0))
            return transmittance(extinction_of(scene, inside), distance)
        return wp.vec3(1.0)

    return unblocked


@specialised(*ATTENUATING, *make_transmission.fields, *make_unblocked.fields)
def make_visibility(features: Features) -> wp.Function:
    """Return the device function (scene, ray, distance, light_point, inside, skin, u) -> share of light that arrives.

    Per channel, 0 to 1: the product over all surfaces before `distance` of what they let straight through, and of the
    transmittance of the media between them, times what is there of the light itself. `light_point` is where on a
    triangle it begins, or which light shape it is, or a Hit of nothing; `inside` are the bodies that the ray begins in,
    and `skin` is the surface right beside its origin. Of `u`, the four numbers by which the light was chosen, those of
    tracking through media on grids are made.
    """
    return make_transmission(features) if can_attenuate_shadows(features) else make_unblocked(features)
