"""Stages of a path in media: absorption and emission along a segment, and scattering.

Raab, Seibert and Keller (2008); the formulas are in `kernels/media/medium.py`.
"""

import warp as wp

from wrt.kernels.core.features import Features
from wrt.kernels.core.ray_tree import NO_HIT, Hit
from wrt.kernels.core.rays import RECEIVES_ANYWHERE
from wrt.kernels.core.scene_data import NEEDS_BODIES, SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.core.spmd_marks import inline_stage
from wrt.kernels.integrators.light_groups import make_add_to_chosen_group
from wrt.kernels.integrators.next_event import make_light_in_medium
from wrt.kernels.integrators.path_state import PathSettings, PathState, make_begin_indirect
from wrt.kernels.media.grids import make_fly_in_grid
from wrt.kernels.media.medium import emitted, fly, make_extinction, medium_of, phase, sample_phase, transmittance
from wrt.kernels.media.skin import make_skin_near
from wrt.kernels.sampling.sampler import stream_key


@wp.struct
class MediumSegment:
    """What a medium does to a path along a segment.

    `radiance` and `throughput` are those of the path after it. If the path `scatters`, it does so at `distance` from
    the surface at which the medium begins, with the mean cosine `g`. The path `ends` if nothing is left of its
    throughput, or if it has scattered in media as often as it may.
    """

    radiance: wp.vec3
    throughput: wp.vec3
    scatters: bool
    ends: bool
    distance: float
    g: float


@specialised("media", "grid_media")
def make_traverse_medium(features: Features) -> wp.Function:
    """Return the stage (scene, path, hit, u_medium, max_scatterings) -> MediumSegment, up to the nearest hit."""
    extinction_of, fly_in_grid = make_extinction(features.media), make_fly_in_grid(features.media)

    @wp.func
    @inline_stage
    def traverse_medium(
        scene: SceneData, path: PathState, hit: Hit, u_medium: wp.vec2, max_scatterings: int
    ) -> MediumSegment:
        segment = MediumSegment()
        segment.radiance = path.radiance
        segment.throughput = path.throughput
        medium = int(-1)
        if scene.needs & NEEDS_BODIES != 0:
            medium = medium_of(scene, path.medium_stack)
        if medium >= 0:
            record = scene.media[medium]
            segment_length = path.origin_gap + hit.t
            is_homogeneous = bool(True)
            may_scatter = bool(False)
            if wp.static(features.grid_media):
                is_homogeneous = record.grid < 0
                if record.grid >= 0:
                    ray = path.ray
                    ray.origin = ray.origin - ray.direction * path.origin_gap
                    key = stream_key(wp.vec4(u_medium[0], u_medium[1], 0.0, 0.0), 0)
                    found = fly_in_grid(scene, record, ray, segment_length, path.throughput, u_medium, key, False)
                    segment.radiance = path.radiance + found.radiance
                    segment.throughput = found.throughput
                    segment.scatters = found.scattered
                    segment.distance = found.distance
                    may_scatter = True
            if is_homogeneous:
                extinction = extinction_of(scene, path.medium_stack)
                emission = emitted(record.emission, extinction, segment_length)
                segment.radiance = path.radiance + wp.cw_mul(path.throughput, emission)
                if wp.static(features.media == "scattering"):
                    may_scatter = wp.max(record.scattering) > 0.0
                    if may_scatter:
                        flight = fly(
                            extinction, record.scattering, path.throughput, segment_length, u_medium[0], u_medium[1]
                        )
                        segment.throughput = wp.cw_mul(path.throughput, flight.weight)
                        segment.scatters = flight.scattered
                        segment.distance = flight.distance
                if not may_scatter:
                    segment.throughput = wp.cw_mul(path.throughput, transmittance(extinction, segment_length))
            if may_scatter:
                segment.ends = wp.max(segment.throughput) == 0.0 or (
                    segment.scatters and path.medium_scatterings >= max_scatterings
                )
                segment.g = record.g
        return segment

    return traverse_medium


@specialised("instances", "exact")
def make_place_in_medium(features: Features) -> wp.Function:
    """Return the stage (scene, path, segment, hit) -> PathState, with path and receiver where the path scatters."""
    skin_near = make_skin_near(features.geometry)

    @wp.func
    @inline_stage
    def place_in_medium(scene: SceneData, path: PathState, segment: MediumSegment, hit: Hit) -> PathState:
        distance = wp.max(segment.distance - path.origin_gap, 0.0)
        path.skin = skin_near(scene, path.ray, distance, hit, path.previous_hit)
        path.ray.origin = path.ray.origin + path.ray.direction * distance
        path.previous_hit.triangle = NO_HIT
        path.origin_gap = 0.0
        path.passed_distance = 0.0
        path.footprint = wp.vec2(0.0)
        if scene.lights.shape[0] > 0:
            path.receiver.position = path.ray.origin
            path.receiver.receives = RECEIVES_ANYWHERE
        return path

    return place_in_medium


@specialised(
    *("clamped", "regularized", "caustics", "light_tree", "light_groups"),
    *make_place_in_medium.fields,
    *make_light_in_medium.fields,
)
def make_scatter_in_medium(features: Features) -> wp.Function:
    """Return the stage (scene, path, segment, hit, u_light, u_phase, settings) -> PathState.

    It moves the path to the point of a segment at which it scatters, samples a light there, and a new direction.
    """
    place_in_medium, light_in_medium = make_place_in_medium(features), make_light_in_medium(features)
    begin_indirect, add_to_chosen_group = make_begin_indirect(features), make_add_to_chosen_group(features.light_tree)

    @wp.func
    @inline_stage
    def scatter_in_medium(
        scene: SceneData,
        path: PathState,
        segment: MediumSegment,
        hit: Hit,
        u_light: wp.vec4,
        u_phase: wp.vec4,
        settings: PathSettings,
    ) -> PathState:
        if wp.static(features.clamped):
            path = begin_indirect(path, path.depth + path.medium_scatterings >= 1)
        path.medium_scatterings += 1
        path = place_in_medium(scene, path, segment, hit)

        # Direct lighting
        if scene.lights.shape[0] > 0:
            light = light_in_medium(scene, path, segment.g, u_light, settings.strategy)
            path.rays += light.rays
            radiance = wp.cw_mul(path.throughput, light.radiance)
            path.radiance += radiance
            if wp.static(features.light_groups):
                path.groups = add_to_chosen_group(scene, path.groups, path.receiver, u_light, radiance)

        # Phase function sampling
        forward = path.ray.direction
        path.ray.direction = sample_phase(forward, segment.g, wp.vec2(u_phase[0], u_phase[1]))
        path.scatter_pdf = phase(wp.dot(forward, path.ray.direction), segment.g)
        if wp.static(features.tells_blurred):
            path.was_blurred = True
        if wp.static(features.caustics):
            path.has_gathered = False

        # Roulette begins below a throughput of 1 only: paths in milk scatter hundreds of times and must survive.
        survival = wp.min(wp.max(path.throughput) * path.eta_scale, 1.0)
        path.is_done = u_phase[3] >= survival
        path.throughput = path.throughput / survival
        return path

    return scatter_in_medium
