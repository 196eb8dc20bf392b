"""Unidirectional path tracing with next-event estimation and multiple importance sampling.

Kajiya (1986); Veach (1997), chapters 9 and 10.
"""

import functools

import warp as wp

from wrt.kernels.bsdf import make_bsdf, model_of
from wrt.kernels.environment import image_radiance
from wrt.kernels.features import Features
from wrt.kernels.geometry import RECEIVES_BOTH, RECEIVES_FRONT, Ray, Receiver, to_local, to_world
from wrt.kernels.intersect import INFINITE_DISTANCE, NO_HIT, make_intersect
from wrt.kernels.light_shapes import shape_number, shines_back, sun_covers
from wrt.kernels.lights import (
    hit_triangle_pdf,
    light_shape_pdf,
    make_lights,
)
from wrt.kernels.materials import MOST_PASSED, PASSED_THROUGH, choose_material, make_bsdf_at
from wrt.kernels.normal_maps import apply_normal_map
from wrt.kernels.sampler import (
    BLOCK_BSDF,
    BLOCK_ENVIRONMENT,
    BLOCK_LIGHT,
    Sampler,
    make_sample_4d,
    passed_block,
    vertex_block,
)
from wrt.kernels.scene_data import SceneData
from wrt.kernels.shadow import make_visibility
from wrt.kernels.surface import add_texture_coordinates, align_tangents, make_surface_at
from wrt.kernels.triangles import leave_surface

# How light that both samplings can find is shared between them.
STRATEGY_MIS = wp.constant(0)
STRATEGY_LIGHT = wp.constant(1)
STRATEGY_BSDF = wp.constant(2)

# Paths shorter than this are never ended by roulette; then survival follows the throughput.
ROULETTE_DEPTH = wp.constant(5)
ROULETTE_LIMIT = wp.constant(0.95)


@wp.struct
class PathSettings:
    """What does not need a kernel of its own."""

    max_depth: int
    strategy: int
    min_attenuation: float  # of ray trees: what is dimmer is not followed
    ambient: wp.vec3  # of ray trees: radiance that all that is not smooth receives from everywhere
    ao_distance: float  # how far ambient occlusion looks
    clamp_indirect: float  # most radiance per channel that a path brings by more than two segments
    widening: float  # variance that slopes of rough surfaces gain once the path was scattered by what is not smooth


@wp.struct
class PathResult:
    """The radiance along a ray, and how many rays it took."""

    radiance: wp.vec3
    rays: int


@wp.func
def mis_weight(strategy: int, pdf_this: float, pdf_other: float, this: int) -> float:
    """Return the weight of the sampling `this` by the power heuristic (Veach 1997, eq. 9.13)."""
    if strategy != STRATEGY_MIS:
        return wp.where(strategy == this, 1.0, 0.0)
    a = pdf_this * pdf_this
    return a / (a + pdf_other * pdf_other)


@wp.func
def emitter_hit_weight(strategy: int, bsdf_pdf: float, light_pdf: float) -> float:
    """Return the weight of light found by following the BSDF; bsdf_pdf 0 stands for a delta."""
    if bsdf_pdf == 0.0 or light_pdf == 0.0:
        return 1.0
    return mis_weight(strategy, bsdf_pdf, light_pdf, STRATEGY_BSDF)


@functools.cache
def make_trace_path(features: Features) -> wp.Function:
    """Return the device function that follows one path, with only what `features` names."""
    bsdf_evaluate, bsdf_pdf, bsdf_sample, bsdf_is_delta, bsdf_transmits = make_bsdf(features.models)
    bsdf_at = make_bsdf_at(features)
    closest_hit = make_intersect(features.instances, features.light_shapes).closest_hit
    sample_light, _, choice_probability, environment_light_pdf, emission_at = make_lights(features)
    visibility = make_visibility(features)
    sample_4d = make_sample_4d(features.sampler)
    surface_at = make_surface_at(features.instances)
    light_shapes = features.light_shapes
    textured = features.textured
    layered = features.layered
    tangents = features.tangents
    transmits = any(model_of(name).transmits for name in features.models)
    has_environment = features.environment != "none"
    image_environment = features.environment == "image"
    clamped = features.clamped
    regularized = features.regularized

    @wp.func
    def environment_seen(
        scene: SceneData, receiver: Receiver, direction: wp.vec3, last_pdf: float, strategy: int
    ) -> wp.vec3:
        if wp.static(image_environment):
            light_pdf = float(0.0)
            if last_pdf > 0.0:
                light_pdf = environment_light_pdf(scene, receiver, direction)
            return image_radiance(scene.environment, direction) * emitter_hit_weight(strategy, last_pdf, light_pdf)
        return scene.environment.radiance

    @wp.func
    def light_shape_seen(
        scene: SceneData, shape: int, receiver: Receiver, ray: Ray, distance: float, last_pdf: float, strategy: int
    ) -> wp.vec3:
        record = scene.light_shapes[shape]
        light_pdf = float(0.0)
        if last_pdf > 0.0:
            light_pdf = light_shape_pdf(record, receiver, ray.direction, distance)
            light_pdf *= choice_probability(scene, receiver, record.light)
        return scene.lights[record.light].value * emitter_hit_weight(strategy, last_pdf, light_pdf)

    @wp.func
    def trace_path(
        scene: SceneData, camera_ray: Ray, pixel_footprint: wp.vec2, sampler: Sampler, settings: PathSettings
    ) -> PathResult:
        ray = camera_ray
        radiance = wp.vec3(0.0)
        throughput = wp.vec3(1.0)
        eta_scale = float(1.0)
        last_pdf = float(0.0)
        footprint = wp.vec2(pixel_footprint)  # width that the ray stands for, and its growth; 0 once it was scattered
        passed = float(0.0)  # distance through what let the ray pass since it was last scattered
        rays = int(0)
        depth = int(0)
        surfaces_passed = int(0)
        direct = wp.vec3(0.0)  # light of two segments at most, once there may be more
        indirect = bool(False)
        scattered = bool(False)  # by what is not smooth
        receiver = Receiver()  # the last vertex from which lights were looked at
        receiver.time = ray.time
        while depth < settings.max_depth:
            hit = closest_hit(scene, ray)
            rays += 1
            depth += 1

            # Environment
            if hit.triangle == NO_HIT:
                if wp.static(has_environment):
                    seen = environment_seen(scene, receiver, ray.direction, last_pdf, settings.strategy)
                    radiance += wp.cw_mul(throughput, seen)
                if wp.static(light_shapes):
                    for i in range(scene.solid_light_shapes, scene.sun_light_shapes):
                        if sun_covers(scene.light_shapes[i], ray.direction):
                            sun = light_shape_seen(scene, i, receiver, ray, 0.0, last_pdf, settings.strategy)
                            radiance += wp.cw_mul(throughput, sun)
                break

            # Lights that are shapes of their own
            if wp.static(light_shapes):
                if hit.triangle < NO_HIT:
                    number = shape_number(hit)
                    if shines_back(scene, scene.light_shapes[number], ray):
                        distance_to_light = passed + hit.t
                        seen_light = light_shape_seen(
                            scene, number, receiver, ray, distance_to_light, last_pdf, settings.strategy
                        )
                        radiance += wp.cw_mul(throughput, seen_light)
                    break

            surface = surface_at(scene, ray, hit)
            shape = scene.shapes[surface.shape]

            # Material; a surface that is not there takes no part in the path, nor counts as one of its vertices
            if wp.static(textured or tangents):
                surface = add_texture_coordinates(scene, hit, surface)
            material = shape.material
            if wp.static(layered):
                u_material = sample_4d(sampler, passed_block(depth, surfaces_passed))
                material = choose_material(scene, material, surface, u_material[0])
                if material == PASSED_THROUGH:
                    surfaces_passed += 1
                    if surfaces_passed > MOST_PASSED:
                        break
                    depth -= 1
                    beyond = leave_surface(surface.position, -surface.normal, surface.slack)
                    passed += wp.length(beyond - ray.origin)
                    ray.origin = beyond
                    continue

            # Emission
            if shape.first_light >= 0:
                if surface.front or shape.two_sided != 0:
                    weight = float(1.0)
                    if last_pdf > 0.0:
                        light_pdf = hit_triangle_pdf(surface, ray.direction, passed + hit.t)
                        light_number = shape.first_light + hit.triangle - shape.first_triangle
                        light_pdf *= choice_probability(scene, receiver, light_number)
                        weight = emitter_hit_weight(settings.strategy, last_pdf, light_pdf)
                    radiance += wp.cw_mul(throughput, emission_at(scene, shape, surface)) * weight
            if depth >= settings.max_depth:
                break
            if wp.static(clamped):
                if depth == 2:
                    direct = radiance
                    radiance = wp.vec3(0.0)
                    indirect = True

            # Normal
            if wp.static(tangents):
                surface = align_tangents(scene, hit, surface)
                width = footprint[0] + footprint[1] * (passed + hit.t)
                surface = apply_normal_map(scene, material, hit, surface, ray.direction, width)
            bsdf = bsdf_at(scene, material, surface)
            if wp.static(regularized):
                if scattered:
                    bsdf.normal_variance = bsdf.normal_variance + wp.vec2(settings.widening)
            wo = to_local(surface.frame, -ray.direction)

            # Emitter sampling
            if scene.lights.shape[0] > 0 and not bsdf_is_delta(bsdf):
                leave = leave_surface(surface.position, surface.normal, surface.slack)
                receiver.position = leave
                receiver.normal = surface.frame.n
                receiver.receives = RECEIVES_FRONT
                if wp.static(transmits):
                    if bsdf_transmits(bsdf):
                        receiver.receives = RECEIVES_BOTH
                u_environment = wp.vec4()
                if wp.static(image_environment):
                    u_environment = sample_4d(sampler, vertex_block(depth, BLOCK_ENVIRONMENT))
                u_light = sample_4d(sampler, vertex_block(depth, BLOCK_LIGHT))
                light = sample_light(scene, receiver, u_light, u_environment)
                wi = to_local(surface.frame, light.wi)
                # A shading normal must not let light through: both normals must agree on the side.
                above = wp.dot(light.wi, surface.normal) > 0.0
                if above == (wi[2] > 0.0) and (above or wp.static(transmits)):
                    arriving = wp.cw_mul(bsdf_evaluate(bsdf, wo, wi), light.radiance)
                    if not light.delta:
                        pdf = bsdf_pdf(bsdf, wo, wi)
                        arriving = arriving * mis_weight(settings.strategy, light.pdf, pdf, STRATEGY_LIGHT)
                    if wp.max(arriving) > 0.0:
                        shadow = Ray()
                        shadow.origin = leave
                        shadow.direction = light.wi
                        shadow.time = ray.time
                        distance = light.distance
                        if wp.static(transmits):
                            if not above:
                                # The way to the same point from the other side of the surface.
                                shadow.origin = leave_surface(surface.position, -surface.normal, surface.slack)
                                if distance < INFINITE_DISTANCE:
                                    way = leave + light.wi * distance - shadow.origin
                                    distance = wp.length(way)
                                    shadow.direction = way / distance
                        rays += 1
                        arriving = arriving * visibility(scene, shadow, distance, light.point)
                        radiance += wp.cw_mul(throughput, arriving)

            # BSDF sampling
            u = sample_4d(sampler, vertex_block(depth, BLOCK_BSDF))
            s = bsdf_sample(bsdf, wo, wp.vec2(u[0], u[1]), u[2])
            throughput = wp.cw_mul(throughput, s.weight)
            eta_scale *= s.eta * s.eta
            last_pdf = s.pdf
            if wp.static(regularized):
                scattered = scattered or s.pdf > 0.0
            direction = to_world(surface.frame, s.wi)
            side = wp.where(s.wi[2] > 0.0, 1.0, -1.0)
            if wp.dot(direction, surface.normal) * side <= 0.0:
                break
            ray.origin = leave_surface(surface.position, surface.normal * side, surface.slack)
            ray.direction = wp.normalize(direction)
            passed = 0.0
            footprint = wp.vec2(0.0)

            # Stopping criterion: the throughput without the squeeze of solid angles inside glass
            survival = wp.max(throughput) * eta_scale
            if survival == 0.0:
                break
            if depth >= ROULETTE_DEPTH:
                survival = wp.min(survival, ROULETTE_LIMIT)
                if u[3] >= survival:
                    break
                throughput = throughput / survival

        if wp.static(clamped):
            if indirect:
                radiance = direct + radiance * wp.min(1.0, settings.clamp_indirect / wp.max(wp.max(radiance), 1.0e-30))
        result = PathResult()
        result.radiance = radiance
        result.rays = rays
        return result

    return trace_path
