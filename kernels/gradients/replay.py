"""Path replay: the path of a sample once more, to add the derivatives of its radiance.

Vicini, Speierer and Jakob, "Path replay backpropagation: differentiating light paths using constant memory and linear
time" (2021). The second time it is known what the path finds in all. Less what it has found so far, that is the light
that comes through the scattering at hand, whose derivative is thus that light times the logarithmic derivative of the
BSDF. Sampling stays as it is: densities, weights of MIS, roulette and the choice among materials have no derivative.
"""

from typing import Literal

import warp as wp

from wrt.kernels.accel.intersect import make_intersect
from wrt.kernels.bsdf import make_bsdf, model_of, models_with
from wrt.kernels.core.bsdf import slot_values
from wrt.kernels.core.features import Features
from wrt.kernels.core.ray_tree import INFINITE_DISTANCE, NO_HIT
from wrt.kernels.core.rays import Ray, to_local, to_world
from wrt.kernels.core.scene_data import SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.core.spmd_marks import path_function
from wrt.kernels.gradients.bsdf import differentiable, make_lobe_weights, make_weighted, over
from wrt.kernels.gradients.lights import make_light_gradients
from wrt.kernels.gradients.materials import make_add_to_material
from wrt.kernels.gradients.media import make_add_to_medium
from wrt.kernels.gradients.shadows import dims_shadows, make_add_to_shadow
from wrt.kernels.gradients.sums import GradientSums
from wrt.kernels.gradients.tangents import RayTangent, make_index_gradients
from wrt.kernels.gradients.vertices import PathPoint, PointAdjoint, make_vertex_gradients, point_of
from wrt.kernels.integrators.next_event import make_light_at_surface, make_light_in_medium
from wrt.kernels.integrators.path import make_begin_path
from wrt.kernels.integrators.path_escape import make_escape
from wrt.kernels.integrators.path_media import make_place_in_medium, make_scatter_in_medium, make_traverse_medium
from wrt.kernels.integrators.path_state import PathSettings, sees_no_lights
from wrt.kernels.integrators.path_surface import (
    make_emission_weight,
    make_place_receiver,
    make_prepare_bsdf,
    make_sample_bsdf,
    make_surface_emission,
    make_surface_vertex,
    pass_through,
)
from wrt.kernels.integrators.shadow_rays import can_attenuate_shadows
from wrt.kernels.integrators.sides import make_hit_shown
from wrt.kernels.lights.shapes import make_light_shapes
from wrt.kernels.media.skin import hit_or_skin, no_skin
from wrt.kernels.sampling.sampler import BLOCK_BSDF, BLOCK_LIGHT, Sampler, make_sample_4d, passed_block, vertex_block


@specialised()
def make_replay_path(features: Features, *, by: Literal["values", "vertices", "index"] = "values") -> wp.Function:
    """Return the device function that adds the derivatives of the radiance of a path.

    Its arguments are (sums, scene, camera_ray, pixel_footprint, sampler, settings, radiance, upstream). It follows the
    path from its begin, as `make_follow_path` does, with the same random numbers. `radiance` is what the path finds in
    all, and `upstream` the derivative of the loss by that. The result is how many surfaces scattered it. There are
    derivatives by values, and by vertices and normals, or by the index of one smooth glass, too.
    """
    begin_path = make_begin_path(features)
    sample_4d, escape = make_sample_4d(features.sampler), make_escape(features)
    intersect, light_shapes = make_intersect(features.geometry), make_light_shapes(features.light_shapes)
    hit_shown = make_hit_shown(features.geometry, features.light_shapes)
    traverse_medium, scatter_in_medium = make_traverse_medium(features), make_scatter_in_medium(features)
    surface_vertex, surface_emission = make_surface_vertex(features), make_surface_emission(features)
    prepare_bsdf, sample_bsdf = make_prepare_bsdf(features), make_sample_bsdf(features)
    place_receiver, light_at_surface = make_place_receiver(features), make_light_at_surface(features, factors=True)
    scattering, panes = features.media == "scattering", bool(models_with(features.models, "straight"))
    draws_more = features.mixed or panes or scattering or features.grid_media
    emission_weight = make_emission_weight(features)
    by_light, evaluate = make_light_gradients(features), make_bsdf(features.models).evaluate
    models = differentiable(features.models)
    weighted_value, weighted_lobes, _ = make_weighted(models)
    lobe_weights, has_lobes = make_lobe_weights(models), bool(models_with(models, "specular"))
    is_smooth = any(not model_of(name).delta for name in models)
    add_to_material, add_to_medium = make_add_to_material(features), make_add_to_medium(features)
    place_in_medium, light_in_medium = make_place_in_medium(features), make_light_in_medium(features, factors=True)
    shadows, add_to_shadow = dims_shadows(features), make_add_to_shadow(features)
    by_corners, by_index = by == "vertices" and is_smooth, by == "index"
    moves = by_corners or (by_index and is_smooth)
    by_vertices, of_index = make_vertex_gradients(features, ends=not by_index), make_index_gradients(features)

    @wp.func
    @path_function
    def replay_path(
        sums: GradientSums,
        scene: SceneData,
        camera_ray: Ray,
        pixel_footprint: wp.vec2,
        sampler: Sampler,
        settings: PathSettings,
        radiance: wp.vec3,
        upstream: wp.vec3,
    ) -> int:
        path = begin_path(scene, camera_ray, pixel_footprint)
        if wp.static(by_corners):
            previous = PathPoint()
            previous.triangle = NO_HIT
        if wp.static(by_index):
            tangent = RayTangent()
        while path.depth < settings.max_depth:
            vertex_number = path.depth + path.medium_scatterings + 1
            u_light = sample_4d(sampler, vertex_block(vertex_number, BLOCK_LIGHT))
            u_bsdf = sample_4d(sampler, vertex_block(vertex_number, BLOCK_BSDF))
            hit = intersect.closest_hit(scene, path.ray)
            if wp.static(bool(features.light_shapes)):
                hit = light_shapes.nearer(scene, path.ray, hit)
            if wp.static(features.single_sided):
                hit = hit_shown(scene, path.ray, hit, not path.was_blurred)
            if wp.static(scattering):
                hit = hit_or_skin(path.skin, path.ray, hit)
            u_more = wp.vec4()
            if wp.static(draws_more):
                u_more = sample_4d(sampler, passed_block(vertex_number, path.surfaces_passed))

            # ---- Medium
            if wp.static(features.media != "none"):
                segment = traverse_medium(scene, path, hit, wp.vec2(u_more[3], u_more[2]), settings.max_scatterings)
                add_to_medium(
                    sums,
                    scene,
                    path.medium_stack,
                    hit,
                    path.origin_gap + hit.t,
                    path.throughput,
                    segment.scatters,
                    segment.distance,
                    upstream,
                    radiance - segment.radiance,
                )
                path.radiance = segment.radiance
                path.throughput = segment.throughput
                if wp.static(scattering):
                    if segment.ends:
                        break
                    if segment.scatters:
                        if scene.lights.shape[0] > 0:
                            at = place_in_medium(scene, path, segment, hit)
                            light = light_in_medium(scene, at, segment.g, u_light, settings.strategy)
                            if wp.max(light.weight) > 0.0:
                                arriving = wp.cw_mul(wp.cw_mul(upstream, path.throughput), light.weight)
                                by_radiance = wp.cw_mul(arriving, light.value)
                                by_light.sampled(sums, scene, at.receiver, u_light, light.light, by_radiance)
                                by_shadow = wp.cw_mul(wp.cw_mul(upstream, path.throughput), light.radiance)
                                add_to_shadow(
                                    sums, scene, light.shadow_ray, light.t_max, light.medium_stack, at.skin, by_shadow
                                )
                        path = scatter_in_medium(scene, path, segment, hit, u_light, u_bsdf, settings)
                        if path.is_done:
                            break
                        continue

            # ---- Environment, and lights that are shapes
            if hit.triangle <= NO_HIT:
                if not sees_no_lights(path, settings):
                    by_light.escaped(
                        sums,
                        scene,
                        path.ray,
                        hit,
                        wp.cw_mul(upstream, path.throughput),
                        path.receiver,
                        path.passed_distance,
                        path.scatter_pdf,
                        settings.strategy,
                    )
                    if wp.static(by_index):
                        of_index.escaped(sums, scene, tangent, path.ray, wp.cw_mul(upstream, path.throughput))
                path = escape(scene, path, hit, settings)
                if path.is_done:
                    break
                continue

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
            if wp.static(by_corners or by_index):
                came = path.ray.direction
                point = point_of(vertex.hit, vertex.surface.position)
                by = PointAdjoint()
            if wp.static(by_corners):
                if previous.triangle < 0:
                    point.direction = came
            if wp.static(by_index):
                moved = of_index.met(scene, tangent, vertex.surface, vertex.hit, path.ray)
                if wp.static(features.media != "none"):
                    seen = wp.cw_mul(upstream, path.throughput)
                    behind = wp.cw_mul(upstream, radiance - path.radiance)
                    of_index.dimmed(sums, scene, path.medium_stack, moved.length, seen, behind)
            weight_of_emission = emission_weight(scene, path, vertex, settings.strategy)
            if weight_of_emission >= 0.0:
                by_emission = wp.cw_mul(upstream, path.throughput) * weight_of_emission
                by_light.emitted(sums, scene, vertex.surface, by_emission)
                if wp.static(by_corners):
                    if previous.triangle < 0:
                        by_vertices.emitted(sums, scene, vertex.surface, point, by_emission)
                if wp.static(by_index):
                    of_index.emitted(sums, scene, vertex.surface, vertex.hit, moved, by_emission)
            path = surface_emission(scene, path, vertex, settings.strategy)
            if wp.static(not panes):
                if path.depth + 1 >= settings.max_depth:
                    break
            vertex = prepare_bsdf(scene, path, vertex, settings.widening)
            if wp.static(panes):
                if not vertex.is_pane and path.depth + 1 >= settings.max_depth:
                    break

            # ---- Direct lighting
            path = place_receiver(path, vertex)
            light = light_at_surface(scene, path, vertex, u_light, settings.strategy)
            blocked = bool(False)
            if wp.static(not can_attenuate_shadows(features)):
                blocked = intersect.occluded(scene, light.shadow_ray, light.t_max)
            arriving = wp.vec3(0.0)  # the derivative of the loss by what is scattered
            if wp.max(light.weight) > 0.0 and not blocked:
                path.radiance += wp.cw_mul(path.throughput, light.radiance)
                arriving = wp.cw_mul(wp.cw_mul(upstream, path.throughput), light.weight)
                by_light.sampled(sums, scene, path.receiver, u_light, light.light, wp.cw_mul(arriving, light.value))
                arriving = wp.cw_mul(arriving, light.light.radiance)
                if wp.static(shadows):
                    by_shadow = wp.cw_mul(wp.cw_mul(upstream, path.throughput), light.radiance)
                    add_to_shadow(sums, scene, light.shadow_ray, light.t_max, light.medium_stack, no_skin(), by_shadow)
                    if wp.static(by_index):
                        if light.t_max < 0.5 * INFINITE_DISTANCE:
                            length = -wp.dot(light.shadow_ray.direction, moved.position)
                            of_index.dimmed(sums, scene, light.medium_stack, length, wp.vec3(0.0), by_shadow)
            gradients = slot_values()
            if wp.static(is_smooth):
                if wp.max(wp.abs(arriving)) > 0.0:
                    by_value, _0, _1, _2 = wp.grad(weighted_value)(vertex.bsdf, vertex.wo, light.wi, arriving)
                    gradients = by_value.slots
                    if wp.static(moves):
                        received = wp.dot(arriving, light.value)
                        by = by_vertices.towards_light(
                            sums, scene, by, point, vertex.surface.frame, light.light, _0, _1, received
                        )

            # ---- What comes by way of the BSDF's sample
            path = sample_bsdf(path, vertex, u_bsdf, u_more[1], settings.max_depth)
            if not path.is_done:
                wi = to_local(vertex.surface.frame, path.ray.direction)
                later = wp.cw_mul(upstream, radiance - path.radiance)
                is_delta = path.scatter_pdf == 0.0 or vertex.is_pane
                if wp.static(has_lobes):
                    if is_delta:
                        weights = lobe_weights(vertex.bsdf, vertex.wo, wi, later)
                        by_lobes, _3, _4, _5 = wp.grad(weighted_lobes)(vertex.bsdf, vertex.wo, weights[0], weights[1])
                        gradients = gradients + by_lobes.slots
                        if wp.static(by_index):
                            by.viewer += to_world(vertex.surface.frame, _3)
                if wp.static(is_smooth):
                    if not is_delta:
                        weight = over(later, evaluate(vertex.bsdf, vertex.wo, wi))
                        by_sample, _6, _7, _8 = wp.grad(weighted_value)(vertex.bsdf, vertex.wo, wi, weight)
                        gradients = gradients + by_sample.slots
                        if wp.static(moves):
                            if wp.max(wp.abs(later)) > 0.0:
                                total = later[0] + later[1] + later[2]
                                by = by_vertices.towards_next(
                                    sums, scene, by, point, vertex.surface.frame, path.ray, _6, _7, total
                                )
            if wp.static(by_index):
                of_index.leave(sums, scene, moved, vertex, came, gradients, by)
                tangent = RayTangent()
                tangent.origin = moved.position
                tangent.point_stays = True
                if path.scatter_pdf == 0.0 and not path.is_done:
                    tangent = of_index.turned(sums, moved, vertex, came, path.ray)
            if wp.static(by_corners):
                by_vertices.leave(sums, scene, previous, point, vertex, came, gradients, by)
                previous = point
                if path.scatter_pdf == 0.0:
                    previous.triangle = NO_HIT
            add_to_material(sums, scene, vertex.material, vertex.bsdf, vertex.surface, gradients)
            if path.is_done:
                break
        vertices = path.depth
        return vertices

    return replay_path
