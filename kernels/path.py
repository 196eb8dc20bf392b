"""Unidirectional path tracing with next-event estimation and multiple importance sampling.

Kajiya (1986); Veach (1997), chapters 9 and 10.
"""

import functools

import warp as wp

from wrt.kernels.bodies import innermost, is_there, make_meet, relative_index
from wrt.kernels.bsdf import make_bsdf, model_of
from wrt.kernels.bvh import Hit
from wrt.kernels.environment import point_towards, radiance_at
from wrt.kernels.features import Features
from wrt.kernels.footprint import sample_footprint
from wrt.kernels.geometry import RECEIVES_ANYWHERE, RECEIVES_BOTH, RECEIVES_FRONT, Ray, Receiver, to_local, to_world
from wrt.kernels.intersect import NO_HIT, make_intersect
from wrt.kernels.light_shapes import shape_number, shines_back, sun_covers
from wrt.kernels.lights import (
    hit_triangle_pdf,
    light_shape_pdf,
    make_lights,
)
from wrt.kernels.materials import (
    MOST_PASSED,
    PASSED_THROUGH,
    has_panes,
    make_bsdf_at,
    make_choose_material,
    make_is_pane,
    make_with_index,
)
from wrt.kernels.medium import emitted, fly, make_extinction, medium_of, transmittance
from wrt.kernels.next_event import emitter_hit_weight, make_light_at_surface, make_light_in_medium
from wrt.kernels.normal_maps import apply_normal_map
from wrt.kernels.phase import phase, sample_phase
from wrt.kernels.sampler import (
    BLOCK_BSDF,
    BLOCK_LIGHT,
    Sampler,
    make_sample_4d,
    passed_block,
    vertex_block,
)
from wrt.kernels.scene_data import BodyStack, SceneData
from wrt.kernels.shadow import dims_light
from wrt.kernels.skin import make_skin_near, no_skin, or_skin
from wrt.kernels.surface import Surface, align_tangents, leave, make_add_texture_coordinates, make_surface_at
from wrt.kernels.triangles import WIDELY

# Paths shorter than this are never ended by roulette; then survival follows the throughput.
ROULETTE_DEPTH = wp.constant(5)
ROULETTE_LIMIT = wp.constant(0.95)


@wp.struct
class PathSettings:
    """What does not need a kernel of its own."""

    max_depth: int
    max_scatterings: int  # events in media, which max_depth does not count
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
def gap_behind(surface: Surface, origin: wp.vec3, direction: wp.vec3) -> float:
    """Return how far a ray that leaves a surface at `origin`, a little beside it, has come from it already."""
    height = wp.abs(wp.dot(origin - surface.position, surface.normal))
    return height / wp.max(wp.abs(wp.dot(direction, surface.normal)), 0.02)


@functools.cache
def make_trace_path(features: Features) -> wp.Function:
    """Return the device function that follows one path, with only what `features` names."""
    _, _, bsdf_sample, bsdf_is_delta, bsdf_transmits = make_bsdf(features.models)
    bsdf_at = make_bsdf_at(features)
    choose_material = make_choose_material(features.extras, features.mipmapped)
    add_texture_coordinates = make_add_texture_coordinates(features.extras)
    closest_hit = make_intersect(features.instances, features.light_shapes).closest_hit
    occluded = make_intersect(features.instances).occluded
    dims = dims_light(features)
    _, _, choice_probability, environment_light_pdf, emission_at = make_lights(features)
    transmits = any(model_of(name).transmits for name in features.models)
    light_at_surface = make_light_at_surface(features)
    light_in_medium = make_light_in_medium(features)
    sample_4d = make_sample_4d(features.sampler)
    surface_at = make_surface_at(features.instances)
    light_shapes = features.light_shapes
    textured = features.textured
    layered = features.layered
    tangents = features.tangents
    panes = has_panes(features.models)
    is_pane = make_is_pane(features.models)
    lets_pass = layered or panes or features.nested
    bodies = features.bodies
    nested = features.nested
    with_index = make_with_index(features.models)
    media = features.media != "none"
    scattering = features.media == "scattering"
    meet = make_meet(features.instances)
    skin_near = make_skin_near(features.instances)
    extinction_of = make_extinction(features.media)
    has_environment = features.environment != "none"
    image_environment = features.environment == "image"
    clamped = features.clamped
    mipmapped = features.mipmapped
    regularized = features.regularized

    @wp.func
    def environment_seen(
        scene: SceneData, receiver: Receiver, direction: wp.vec3, last_pdf: float, strategy: int
    ) -> wp.vec3:
        if wp.static(image_environment):
            point = point_towards(scene.environment, direction)
            light_pdf = float(0.0)
            if last_pdf > 0.0:
                light_pdf = environment_light_pdf(scene, receiver, point)
            return radiance_at(scene.environment, point.uv) * emitter_hit_weight(strategy, last_pdf, light_pdf)
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
        inside = BodyStack()
        gap = float(0.0)  # from the surface that the ray left to its origin: the medium begins at the surface
        scatterings = int(0)
        skin = no_skin()
        left = Hit()  # the surface that the ray comes from
        left.triangle = NO_HIT
        if wp.static(bodies):
            inside = scene.inside_at_camera
        while depth < settings.max_depth:
            depth += 1
            vertex = depth + scatterings
            # Drawn before the ray is traced, as that waits for memory meanwhile: 5 % of a path in the Cornell box.
            u_light = sample_4d(sampler, vertex_block(vertex, BLOCK_LIGHT))
            u = sample_4d(sampler, vertex_block(vertex, BLOCK_BSDF))
            hit = closest_hit(scene, ray)
            if wp.static(scattering):
                hit = or_skin(skin, ray, hit)
            rays += 1
            u_passed = wp.vec4()
            if wp.static(layered or panes or scattering):
                u_passed = sample_4d(sampler, passed_block(vertex, surfaces_passed))

            # Medium
            if wp.static(media):
                medium = medium_of(scene, inside)
                if medium >= 0:
                    record = scene.media[medium]
                    extinction = extinction_of(scene, inside)
                    way = gap + hit.t
                    radiance += wp.cw_mul(throughput, emitted(record.emission, extinction, way))
                    if wp.static(scattering):
                        if wp.max(record.scattering) > 0.0:
                            flight = fly(extinction, record.scattering, throughput, way, u_passed[3], u_passed[2])
                            throughput = wp.cw_mul(throughput, flight.weight)
                            if wp.max(throughput) == 0.0:
                                break
                            if flight.scattered:
                                scatterings += 1
                                depth -= 1
                                if scatterings > settings.max_scatterings:
                                    break
                                flown = wp.max(flight.distance - gap, 0.0)
                                skin = skin_near(scene, ray, flown, hit, left)
                                ray.origin = ray.origin + ray.direction * flown
                                left.triangle = NO_HIT
                                gap = 0.0
                                forward = ray.direction
                                if wp.static(clamped):
                                    if vertex >= 2 and not indirect:
                                        direct = radiance
                                        radiance = wp.vec3(0.0)
                                        indirect = True
                                if scene.lights.shape[0] > 0:
                                    receiver.position = ray.origin
                                    receiver.receives = RECEIVES_ANYWHERE
                                    lit = light_in_medium(
                                        scene, receiver, forward, record.g, inside, skin, u_light, settings.strategy
                                    )
                                    rays += lit.rays
                                    radiance += wp.cw_mul(throughput, lit.radiance)
                                ray.direction = sample_phase(forward, record.g, wp.vec2(u[0], u[1]))
                                last_pdf = phase(wp.dot(forward, ray.direction), record.g)
                                passed = 0.0
                                footprint = wp.vec2(0.0)
                                if wp.static(regularized):
                                    scattered = True
                                # No limit below 1: of a hundred events in milk all are to be survived.
                                survival = wp.min(wp.max(throughput) * eta_scale, 1.0)
                                if u[3] >= survival:
                                    break
                                throughput = throughput / survival
                                continue
                        else:
                            throughput = wp.cw_mul(throughput, transmittance(extinction, way))
                    else:
                        throughput = wp.cw_mul(throughput, transmittance(extinction, way))

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

            # Surface, and what is behind it
            if wp.static(scattering):
                skin.hit.triangle = NO_HIT
            after = inside
            surface = surface_at(scene, ray, hit)
            if wp.static(bodies):
                if scene.shapes[surface.shape].body >= 0:
                    surface.clearance = surface.clearance * WIDELY
            near = leave(surface, 1.0)
            beyond = leave(surface, -1.0)
            there = bool(True)
            if wp.static(bodies):
                meeting = meet(scene, ray, hit, surface, inside)
                hit = meeting.hit
                surface = meeting.surface
                after = meeting.after
                if wp.static(nested):
                    there = is_there(scene, surface, inside, after)
            shape = scene.shapes[surface.shape]

            # Material; a surface that is not there takes no part in the path, nor counts as one of its vertices
            if wp.static(textured or tangents):
                surface = add_texture_coordinates(scene, hit, surface)
            if wp.static(mipmapped):
                width = footprint[0] + footprint[1] * (passed + hit.t)
                if width > 0.0:
                    surface.footprint = sample_footprint(scene, hit, surface, ray.direction, width, sampler.index)
            material = shape.material
            if wp.static(layered):
                if there:
                    material = choose_material(scene, material, surface, u_passed[0])
                    there = material != PASSED_THROUGH
            if wp.static(layered or nested):
                if not there:
                    surfaces_passed += 1
                    if surfaces_passed > MOST_PASSED:
                        break
                    depth -= 1
                    passed += wp.length(beyond - ray.origin)
                    ray.origin = beyond
                    gap = gap_behind(surface, beyond, ray.direction)
                    left = hit
                    inside = after
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
            if wp.static(not panes):
                if depth >= settings.max_depth:
                    break

            # Normal
            if wp.static(tangents):
                surface = align_tangents(scene, hit, surface)
                width = footprint[0] + footprint[1] * (passed + hit.t)
                surface = apply_normal_map(scene, material, hit, surface, ray.direction, width)
            bsdf = bsdf_at(scene, material, surface)
            if wp.static(regularized):
                if scattered:
                    bsdf.normal_variance = bsdf.normal_variance + wp.vec2(settings.widening)
            if wp.static(nested):
                if shape.body >= 0:
                    before = innermost(scene, inside)
                    bsdf = with_index(bsdf, relative_index(scene, surface, before, innermost(scene, after)))
            wo = to_local(surface.frame, -ray.direction)

            # Panes let light through straight on: that too is as if they were not there
            pane = bool(False)
            if wp.static(panes):
                pane = is_pane(bsdf)
                if pane:
                    u[2] = u_passed[1]
                elif depth >= settings.max_depth:
                    break

            if wp.static(clamped):
                if vertex >= 2 and not indirect and not pane:
                    direct = radiance
                    radiance = wp.vec3(0.0)
                    indirect = True

            # Emitter sampling
            asked = wp.vec3(0.0)  # light that arrives if nothing is on the ray `shadow` before `free`
            shadow = Ray()
            free = float(-1.0)
            if scene.lights.shape[0] > 0 and not bsdf_is_delta(bsdf):
                receiver.position = near
                receiver.normal = surface.frame.n
                receiver.receives = RECEIVES_FRONT
                if wp.static(transmits):
                    if bsdf_transmits(bsdf):
                        receiver.receives = RECEIVES_BOTH
                lit = light_at_surface(
                    scene, receiver, surface, beyond, bsdf, wo, inside, after, u_light, settings.strategy
                )
                rays += lit.rays
                if wp.static(dims):
                    radiance += wp.cw_mul(throughput, lit.radiance)
                else:
                    asked = wp.cw_mul(throughput, lit.radiance)
                    shadow = lit.way
                    free = lit.distance

            # BSDF sampling
            s = bsdf_sample(bsdf, wo, wp.vec2(u[0], u[1]), u[2])
            throughput = wp.cw_mul(throughput, s.weight)
            side = wp.where(s.wi[2] > 0.0, 1.0, -1.0)
            if wp.static(panes):
                if pane and side < 0.0:
                    surfaces_passed += 1
                    if surfaces_passed > MOST_PASSED or wp.max(throughput) == 0.0:
                        break
                    depth -= 1
                    passed += wp.length(beyond - ray.origin)
                    ray.origin = beyond
                    gap = gap_behind(surface, beyond, ray.direction)
                    left = hit
                    inside = after
                    continue
                if depth >= settings.max_depth:
                    break
                if wp.static(clamped):
                    if vertex >= 2 and not indirect:
                        direct = radiance
                        radiance = wp.vec3(0.0)
                        indirect = True
            eta_scale *= s.eta * s.eta
            last_pdf = s.pdf
            if wp.static(regularized):
                scattered = scattered or s.pdf > 0.0
            direction = to_world(surface.frame, s.wi)
            goes_on = wp.dot(direction, surface.normal) * side > 0.0
            if side > 0.0:
                ray.origin = near
            else:
                ray.origin = beyond
                if wp.static(bodies):
                    inside = after
            ray.direction = wp.normalize(direction)
            if wp.static(media):
                gap = gap_behind(surface, ray.origin, ray.direction)
                left = hit
            if wp.static(lets_pass):
                passed = 0.0
            if wp.static(mipmapped or tangents):
                footprint = wp.vec2(0.0)

            # Stopping criterion: the throughput without the squeeze of solid angles inside glass
            survival = wp.max(throughput) * eta_scale
            if depth >= ROULETTE_DEPTH:
                survival = wp.min(survival, ROULETTE_LIMIT)
                goes_on = goes_on and u[3] < survival
                throughput = throughput / survival
            goes_on = goes_on and survival > 0.0

            # Whether the light is seen, last: least is to be remembered of the surface by now
            if wp.static(not dims):
                blocked = occluded(scene, shadow, free)
                if not blocked:
                    radiance += asked
            if not goes_on:
                break

        if wp.static(clamped):
            if indirect:
                radiance = direct + radiance * wp.min(1.0, settings.clamp_indirect / wp.max(wp.max(radiance), 1.0e-30))
        result = PathResult()
        result.radiance = radiance
        result.rays = rays
        return result

    return trace_path
