"""What integrators from outside the package are made of: functions of the built-in ones, for the features of a scene.

Rays are as for paths without media: they pass holes, see the parts of mixtures by chance, and meet normal maps.
Surfaces with holes let their share of shadow rays pass; panes of glass block them, and paths pass these by the BSDF.
"""

import dataclasses
from typing import Any, NamedTuple

import warp as wp

from wrt.kernels.accel.intersect import make_intersect
from wrt.kernels.bsdf import make_bsdf
from wrt.kernels.core.features import Features
from wrt.kernels.core.ray_tree import INFINITE_DISTANCE as INFINITE_DISTANCE
from wrt.kernels.core.ray_tree import NO_HIT, Hit
from wrt.kernels.core.ray_tree import nowhere as nowhere
from wrt.kernels.core.rays import RECEIVES_BOTH as RECEIVES_BOTH
from wrt.kernels.core.rays import RECEIVES_FRONT as RECEIVES_FRONT
from wrt.kernels.core.rays import Ray as Ray
from wrt.kernels.core.rays import Receiver as Receiver
from wrt.kernels.core.rays import make_frame as make_frame
from wrt.kernels.core.rays import to_local as to_local
from wrt.kernels.core.rays import to_world as to_world
from wrt.kernels.core.scene_data import BodyStack
from wrt.kernels.core.scene_data import SceneData as SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.core.spmd_marks import inline_stage
from wrt.kernels.geometry.surface import make_surface_at
from wrt.kernels.integrators.next_event import STRATEGY_LIGHT, mis_weight
from wrt.kernels.integrators.path_escape import make_add_lights_met
from wrt.kernels.integrators.path_state import PathResult as PathResult
from wrt.kernels.integrators.path_state import PathSettings as PathSettings
from wrt.kernels.integrators.path_state import PathState, SurfaceVertex
from wrt.kernels.integrators.path_surface import (
    make_emission_weight,
    make_prepare_bsdf,
    make_surface_vertex,
    pass_through,
)
from wrt.kernels.integrators.shadow_rays import make_visibility
from wrt.kernels.integrators.sides import make_hit_shown
from wrt.kernels.lights.lights import make_lights
from wrt.kernels.lights.record import LightSample
from wrt.kernels.lights.shapes import make_light_shapes
from wrt.kernels.media.skin import no_skin
from wrt.kernels.sampling.sampler import BLOCK_BSDF as BLOCK_BSDF
from wrt.kernels.sampling.sampler import BLOCK_LIGHT as BLOCK_LIGHT
from wrt.kernels.sampling.sampler import Sampler as Sampler
from wrt.kernels.sampling.sampler import make_sample_4d, passed_block
from wrt.kernels.sampling.sampler import vertex_block as vertex_block
from wrt.kernels.sampling.warps import square_to_cosine_hemisphere as square_to_cosine_hemisphere


@wp.struct
class Found:
    """What a ray meets first: `vertex`, at a `distance` from its origin, and how many `rays` that took.

    `vertex.hit.triangle` is negative if it meets no surface. `looks` is as `Tools.find` was given it.
    """

    vertex: SurfaceVertex
    distance: float
    rays: int
    looks: bool


class Tools(NamedTuple):
    """Device functions for the scenes with certain features.

    Attributes:
        first: (scene, ray, footprint, sampler) -> Found: what a camera ray meets.
        find: (scene, ray, footprint, sampler, number, throughput, looks) -> Found: what the `number`-th ray of a path
            meets, from 1. `throughput` decides which colour dispersive glass refracts. A ray `looks` until something
            that is not smooth has scattered it: it alone sees unlit and through single-sided surfaces.
        meet_lights: (scene, ray, found) -> Found, with the light without triangles that is nearer, if there is one.
        emission: (scene, ray, found, receiver, pdf, settings) -> vec3: the radiance that comes from there, of a
            surface, a light or the environment. A `pdf` above 0 is the density of the ray's direction; the radiance is
            then weighted, as `sample_light` for the same receiver finds it as well.
        light_weight: (light, pdf, settings) -> float: the weight of a light sample, whose direction the BSDF has with
            this density.
        evaluate: (bsdf, wo, wi) -> vec3, with |cosθi|, in the frame of `vertex.surface.frame`.
        pdf: (bsdf, wo, wi) -> float, per solid angle.
        sample: (bsdf, wo, u: vec2, u_lobe) -> BsdfSample.
        sample_light: (scene, receiver, u: vec4) -> LightSample; its radiance is over its probability.
        visibility: (scene, ray, distance, aim: Hit, u: vec4) -> vec3: the share of light that arrives from there; `aim`
            is the `point` of a light sample, or `nowhere()`.
        environment: (scene, ray) -> vec3: the radiance from infinitely far away.
        closest_hit: (scene, ray) -> Hit, of whatever material.
        occluded: (scene, ray, distance) -> bool, by whatever material.
        surface_at: (scene, ray, hit) -> Surface, its geometry alone.
        random: (sampler, block) -> vec4 of numbers in [0, 1); `vertex_block` numbers the blocks.
        Numbers: the struct of the integrator's own numbers.
    """

    first: wp.Function
    find: wp.Function
    meet_lights: wp.Function
    emission: wp.Function
    light_weight: wp.Function
    evaluate: wp.Function
    pdf: wp.Function
    sample: wp.Function
    sample_light: wp.Function
    visibility: wp.Function
    environment: wp.Function
    closest_hit: wp.Function
    occluded: wp.Function
    surface_at: wp.Function
    random: wp.Function
    Numbers: Any


@wp.func
@inline_stage
def nothing_found() -> Found:
    """Return the result for a ray that meets nothing."""
    found = Found()
    found.vertex.hit = nowhere()
    return found


@wp.func
def light_weight(light: LightSample, pdf: float, settings: PathSettings) -> float:
    """Return the weight of a light sample; see `Tools`."""
    if light.delta:
        return 1.0
    return mis_weight(settings.strategy, light.pdf, pdf, STRATEGY_LIGHT)


@specialised()
def make_tools(features: Features) -> Tools:
    """Return the functions for scenes with these features, without `Numbers`."""
    intersect, surface_at = make_intersect(features.geometry), make_surface_at(features.geometry)
    sample_4d, hit_shown = make_sample_4d(features.sampler), make_hit_shown(features.geometry)
    surface_vertex, prepare_bsdf = make_surface_vertex(features), make_prepare_bsdf(features)
    lights, bsdf = make_lights(features), make_bsdf(features.models)
    emission_weight, add_lights_met = make_emission_weight(features), make_add_lights_met(features)
    light_shapes = make_light_shapes(features.light_shapes)
    # Panes block shadow rays, as user-defined paths go through them by the BSDF and find the light behind.
    share_of_light = make_visibility(dataclasses.replace(features, models=()))

    @wp.func
    @inline_stage
    def find(
        scene: SceneData,
        ray: Ray,
        footprint: wp.vec2,
        sampler: Sampler,
        number: int,
        throughput: wp.vec3,
        looks: bool,
    ) -> Found:
        found = nothing_found()
        found.looks = looks
        path = PathState()
        path.ray = ray
        path.throughput = throughput
        path.footprint = footprint
        path.was_blurred = not looks
        follows = bool(True)
        while follows:
            follows = False
            hit = intersect.closest_hit(scene, path.ray)
            if wp.static(features.single_sided):
                hit = hit_shown(scene, path.ray, hit, looks)
            found.rays += 1
            if hit.triangle >= 0:
                u = float(0.0)
                if wp.static(features.mixed):
                    numbers = sample_4d(sampler, passed_block(number, path.surfaces_passed))
                    u = numbers[0]
                vertex = surface_vertex(scene, path, hit, u, sampler)
                if vertex.is_solid:
                    found.distance = path.passed_distance + hit.t
                    found.vertex = prepare_bsdf(scene, path, vertex, 0.0)
                else:
                    path = pass_through(path, vertex)
                    follows = not path.is_done
        return found

    @wp.func
    @inline_stage
    def first(scene: SceneData, ray: Ray, footprint: wp.vec2, sampler: Sampler) -> Found:
        return find(scene, ray, footprint, sampler, 1, wp.vec3(1.0), True)

    @wp.func
    @inline_stage
    def meet_lights(scene: SceneData, ray: Ray, found: Found) -> Found:
        result = found
        if wp.static(bool(features.light_shapes)):
            hit = found.vertex.hit
            hit.t = wp.where(hit.triangle >= 0, found.distance, INFINITE_DISTANCE)
            hit = light_shapes.nearer(scene, ray, hit)
            if hit.triangle < NO_HIT:
                result.vertex.hit = hit
                result.distance = hit.t
        return result

    @wp.func
    @inline_stage
    def emission(
        scene: SceneData, ray: Ray, found: Found, receiver: Receiver, pdf: float, settings: PathSettings
    ) -> wp.vec3:
        hit = found.vertex.hit
        surface = found.vertex.surface
        radiance = wp.vec3(0.0)
        if hit.triangle <= NO_HIT:
            radiance = add_lights_met(scene, ray, hit, radiance, wp.vec3(1.0), receiver, 0.0, pdf, settings.strategy)
        else:
            path = PathState()
            path.ray = ray
            path.receiver = receiver
            path.scatter_pdf = pdf
            path.passed_distance = found.distance - hit.t
            path.was_blurred = not found.looks
            weight = emission_weight(scene, path, found.vertex, settings.strategy)
            if weight >= 0.0:
                radiance = lights.emission_at(scene, scene.shapes[surface.shape], surface) * weight
        return radiance

    @wp.func
    def environment(scene: SceneData, ray: Ray) -> wp.vec3:
        return add_lights_met(scene, ray, nowhere(), wp.vec3(0.0), wp.vec3(1.0), Receiver(), 0.0, 0.0, STRATEGY_LIGHT)

    @wp.func
    def visibility(scene: SceneData, ray: Ray, distance: float, aim: Hit, u: wp.vec4) -> wp.vec3:
        return share_of_light(scene, ray, distance, aim, BodyStack(), no_skin(), u)

    return Tools(
        first=first,
        find=find,
        meet_lights=meet_lights,
        emission=emission,
        light_weight=light_weight,
        evaluate=bsdf.evaluate,
        pdf=bsdf.pdf,
        sample=bsdf.sample,
        sample_light=lights.sample_light,
        visibility=visibility,
        environment=environment,
        closest_hit=intersect.closest_hit,
        occluded=intersect.occluded,
        surface_at=surface_at,
        random=sample_4d,
        Numbers=None,
    )
