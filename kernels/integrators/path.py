"""Unidirectional path tracing with next-event estimation and multiple importance sampling.

Kajiya (1986); Veach (1997), chapters 9 and 10. The stages of a path are in the files beside this one. The loop follows
a path to its end, or in rounds of one vertex, between which a GPU begins other paths (`kernels/regeneration.py`);
a path that is done when a round begins stays as it is.
"""

import warp as wp

from wrt.kernels.accel.intersect import make_intersect
from wrt.kernels.bsdf import make_gathers, make_is_caster, models_with
from wrt.kernels.core.features import Features
from wrt.kernels.core.ray_tree import NO_HIT
from wrt.kernels.core.rays import Ray
from wrt.kernels.core.scene_data import NEEDS_BODIES, SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.core.spmd_marks import inline_stage, path_function
from wrt.kernels.integrators.gathering import make_gather
from wrt.kernels.integrators.light_groups import NO_LIGHT_OF_TABLE, add_to_group, colored, make_add_to_chosen_group
from wrt.kernels.integrators.next_event import make_light_at_surface
from wrt.kernels.integrators.path_escape import make_escape
from wrt.kernels.integrators.path_media import make_scatter_in_medium, make_traverse_medium
from wrt.kernels.integrators.path_state import (
    UNCLAMPED,
    PathSettings,
    PathState,
    make_begin_indirect,
    make_path_result,
    result_type,
)
from wrt.kernels.integrators.path_surface import (
    make_place_receiver,
    make_prepare_bsdf,
    make_sample_bsdf,
    make_surface_emission,
    make_surface_vertex,
    pass_through,
)
from wrt.kernels.integrators.shadow_rays import can_attenuate_shadows, may_leave_shadows
from wrt.kernels.integrators.sides import make_hit_shown
from wrt.kernels.lights.shapes import make_light_shapes
from wrt.kernels.media.skin import hit_or_skin, no_skin
from wrt.kernels.sampling.sampler import BLOCK_BSDF, BLOCK_LIGHT, Sampler, make_sample_4d, passed_block, vertex_block


@specialised()
def make_follow_path(features: Features, *, in_rounds: bool = False) -> wp.Function:
    """Return the stage (scene, path, sampler, settings) -> PathState: to a path's end, or (`in_rounds`) next vertex."""
    sample_4d, escape = make_sample_4d(features.sampler), make_escape(features)
    intersect, light_shapes = make_intersect(features.geometry), make_light_shapes(features.light_shapes)
    hit_shown = make_hit_shown(features.geometry, features.light_shapes)
    traverse_medium, scatter_in_medium = make_traverse_medium(features), make_scatter_in_medium(features)
    surface_vertex, surface_emission = make_surface_vertex(features), make_surface_emission(features)
    prepare_bsdf, sample_bsdf = make_prepare_bsdf(features), make_sample_bsdf(features)
    place_receiver, light_at_surface = make_place_receiver(features), make_light_at_surface(features)
    scattering, panes = features.media == "scattering", bool(models_with(features.models, "straight"))
    gathers, gather, is_caster = make_gathers(features.models), make_gather(features), make_is_caster(features.models)
    casters = bool(models_with(features.models, "is_caster"))
    begin_indirect, add_to_chosen_group = make_begin_indirect(features), make_add_to_chosen_group(features.light_tree)
    draws_more = features.mixed or panes or scattering or features.grid_media

    @wp.func
    @inline_stage
    def follow_path(scene: SceneData, path: PathState, sampler: Sampler, settings: PathSettings) -> PathState:
        most_vertices = settings.max_depth
        if wp.static(in_rounds):
            rounds = int(0)
            most_vertices = wp.where(path.is_done, 0, most_vertices)  # a path that is done takes no step
        while path.depth < most_vertices:
            if wp.static(in_rounds):
                rounds += 1
                if rounds > 1:
                    break
            vertex_number = path.depth + path.medium_scatterings + 1
            # Drawn before the ray is traced, which waits for memory: saves 5 % of a path in the Cornell box.
            u_light = sample_4d(sampler, vertex_block(vertex_number, BLOCK_LIGHT))
            u_bsdf = sample_4d(sampler, vertex_block(vertex_number, BLOCK_BSDF))
            hit = intersect.closest_hit(scene, path.ray)
            if wp.static(bool(features.light_shapes)):
                hit = light_shapes.nearer(scene, path.ray, hit)
            if wp.static(features.single_sided):
                hit = hit_shown(scene, path.ray, hit, not path.was_blurred)
            if wp.static(scattering):
                if scene.needs & NEEDS_BODIES != 0:
                    hit = hit_or_skin(path.skin, path.ray, hit)
            path.rays += 1
            u_more = wp.vec4()
            if wp.static(draws_more):
                u_more = sample_4d(sampler, passed_block(vertex_number, path.surfaces_passed))
            # ---- Medium
            if wp.static(features.media != "none"):
                segment = traverse_medium(scene, path, hit, wp.vec2(u_more[3], u_more[2]), settings.max_scatterings)
                if wp.static(features.light_groups):
                    emission = segment.radiance - path.radiance
                    path.groups = add_to_group(scene, path.groups, NO_LIGHT_OF_TABLE, emission)
                path.radiance = segment.radiance
                path.throughput = segment.throughput
                if wp.static(scattering):
                    if segment.ends:
                        break
                    if segment.scatters:
                        path = scatter_in_medium(scene, path, segment, hit, u_light, u_bsdf, settings)
                        if path.is_done:
                            break
                        continue

            # ---- Environment, and lights that are shapes
            if wp.static(features.caustics):
                by_photons = path.has_gathered and path.scatter_pdf == 0.0
                if wp.static(casters):
                    by_photons = path.has_gathered and path.was_cast
            if hit.triangle <= NO_HIT:
                if wp.static(features.caustics):
                    if by_photons:
                        break
                path = escape(scene, path, hit, settings)
                if wp.static(bool(features.light_shapes)):
                    if not path.is_done:
                        continue
                break

            # ---- Surface
            if wp.static(scattering):
                path.skin.hit.triangle = NO_HIT
            vertex = surface_vertex(scene, path, hit, u_more[0], sampler)
            if wp.static(features.has_holes or features.nested):
                if not vertex.is_solid:
                    path = pass_through(path, vertex)
                    if path.is_done:
                        break
                    continue
            if wp.static(features.caustics):
                if not by_photons:
                    path = surface_emission(scene, path, vertex, settings.strategy)
            else:
                path = surface_emission(scene, path, vertex, settings.strategy)
            if wp.static(not panes):
                if path.depth + 1 >= settings.max_depth:
                    break
            vertex = prepare_bsdf(scene, path, vertex, settings.widening)
            if wp.static(panes):
                if not vertex.is_pane and path.depth + 1 >= settings.max_depth:
                    break
            if wp.static(features.caustics and casters):
                # Photons bring this light, too, to where the path gathered them.
                if path.has_gathered and is_caster(vertex.bsdf):
                    vertex.samples_lights = False
            if wp.static(features.clamped):
                path = begin_indirect(path, vertex_number >= 2 and not vertex.is_pane)

            # ---- Direct lighting
            path = place_receiver(path, vertex)
            light = light_at_surface(scene, path, vertex, u_light, settings.strategy)
            path.rays += light.rays
            shadow_radiance = wp.cw_mul(path.throughput, light.radiance)

            # ---- Caustics
            if wp.static(features.caustics):
                if gathers(vertex.bsdf) and not path.has_settled:
                    most_turns = settings.max_depth - path.depth - 2
                    photons = settings.photon_map
                    caustic = gather(scene, photons, vertex.bsdf, vertex.wo, vertex.surface, most_turns)
                    path.radiance += wp.cw_mul(path.throughput, caustic.radiance)
                    if wp.static(features.light_groups):
                        path.groups += colored(caustic.groups, path.throughput)

            # ---- BSDF sampling and roulette
            path = sample_bsdf(path, vertex, u_bsdf, u_more[1], settings.max_depth)

            # ---- Shadow ray, last, when little of the surface's state is still live
            if wp.static(can_attenuate_shadows(features) and not may_leave_shadows(features)):
                path.radiance += shadow_radiance
                if wp.static(features.light_groups):
                    path.groups = add_to_chosen_group(scene, path.groups, path.receiver, u_light, shadow_radiance)
            else:
                blocked = intersect.occluded(scene, light.shadow_ray, light.t_max)
                if not blocked:
                    path.radiance += shadow_radiance
                    if wp.static(features.light_groups):
                        path.groups = add_to_chosen_group(scene, path.groups, path.receiver, u_light, shadow_radiance)
            if path.is_done:
                break
        if wp.static(in_rounds):
            path.is_done = rounds <= 1
        return path

    return follow_path


@specialised()
def make_begin_path(features: Features) -> wp.Function:
    """Return the stage (scene, camera_ray, pixel_footprint) -> PathState, a path that begins with a camera ray."""

    @wp.func
    @inline_stage
    def begin_path(scene: SceneData, camera_ray: Ray, pixel_footprint: wp.vec2) -> PathState:
        path = PathState()
        path.ray = camera_ray
        path.throughput = wp.vec3(1.0)
        path.eta_scale = 1.0
        path.footprint = pixel_footprint
        path.receiver.time = camera_ray.time
        path.skin = no_skin()
        path.previous_hit.triangle = NO_HIT
        if wp.static(features.bodies):
            path.medium_stack = scene.inside_at_camera
        return path

    return begin_path


@specialised()
def make_trace_path(features: Features) -> wp.Function:
    """Return the device function that follows one path, with only what `features` names."""
    begin_path, follow_path = make_begin_path(features), make_follow_path(features)
    path_result, Result = make_path_result(features), result_type(features.light_groups)

    @wp.func
    @path_function
    def trace_path(
        scene: SceneData, camera_ray: Ray, pixel_footprint: wp.vec2, sampler: Sampler, settings: PathSettings
    ) -> Result:
        path = begin_path(scene, camera_ray, pixel_footprint)
        if wp.static(features.clamped):
            # Without a limit all radiance is in one sum, as in kernels that do not clamp.
            path.is_indirect = settings.clamp_indirect == UNCLAMPED
        path = follow_path(scene, path, sampler, settings)
        result = path_result(path, settings.clamp_indirect)
        return result

    return trace_path
