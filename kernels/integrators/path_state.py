"""The state of a path between vertices and at one, and the arguments and results of all integrators."""

from typing import Any

import warp as wp

from wrt.kernels.core.bsdf import Bsdf
from wrt.kernels.core.features import Features
from wrt.kernels.core.photon_map import PhotonMap
from wrt.kernels.core.ray_tree import Hit
from wrt.kernels.core.rays import Ray, Receiver
from wrt.kernels.core.scene_data import BodyStack
from wrt.kernels.core.specialise import specialised
from wrt.kernels.core.spmd_marks import inline_stage
from wrt.kernels.geometry.surface import Surface
from wrt.kernels.integrators.light_groups import GroupSums
from wrt.kernels.materials.choice import MOST_PASSED
from wrt.kernels.media.skin import Skin

BEHIND_LIGHT = wp.constant(1.00001)
"""Factor on the distance to a hidden light, by which a ray begins behind it; several times its rounding error."""


UNCLAMPED = wp.constant(wp.inf)
"""The limit of indirect radiance that is not clamped."""


@wp.struct
class PathSettings:
    """Settings that need no kernel of their own, and the photons that paths gather if `Features.caustics`."""

    max_depth: int
    max_scatterings: int  # events in media, which max_depth does not count
    strategy: int
    min_attenuation: float  # of ray trees: dimmer rays are not followed
    jittered_rays: int  # of ray trees: rays sent on from the first glossy surface
    ambient: wp.vec3  # of ray trees: radiance that rough surfaces receive from all directions
    ao_distance: float  # length of the rays of ambient occlusion
    clamp_indirect: float  # upper bound on indirect radiance, per channel, or UNCLAMPED
    widening: float  # variance that slopes of rough surfaces gain once the path was scattered by what is not smooth
    is_sobol: int  # which of the two samplers a kernel takes that has both
    hides_lights: int  # whether camera rays do not see the environment and lights without triangles
    photon_map: PhotonMap
    own: wp.array(dtype=float)  # the memory of the numbers of an integrator from outside


@wp.struct
class PathResult:
    """The radiance along a ray, and how many rays it took."""

    radiance: wp.vec3
    rays: int


@wp.struct
class GroupedResult:
    """A PathResult, with the radiance by groups of lights."""

    radiance: wp.vec3
    rays: int
    groups: GroupSums


@wp.struct
class PathState:
    """A path between two vertices.

    `ray` is its next segment, and `scatter_pdf` the density of that direction, 0 if it was the only one possible.
    `throughput` is the product of all weights so far, and `eta_scale` the product of all squared relative indices. A
    path may go straight through surfaces: `passed_distance` is the distance since it was last scattered, and
    `surfaces_passed` counts them all. `receiver` is the last vertex for which a light was sampled. `previous_hit` is
    the surface that the ray leaves, and `origin_gap` the distance from there to the ray's origin, as the medium begins
    at the surface. `footprint` is the width of the camera ray's cone, and its growth; 0 once the path was scattered.
    `depth` counts the surfaces that scattered the path, and `medium_scatterings` the points in media.
    While indirect light is clamped, `direct_radiance` keeps the light of at most two segments once there may be more;
    the path then `is_indirect`. If Features.light_groups, `groups` and `direct_groups` have the same light by groups.
    It `was_blurred` if anything that is not smooth scattered it, where `Features` ask for it. It `has_gathered` if
    photons were gathered where it was last scattered by what is not smooth, and `has_settled` once that was a matt
    surface, which gathers the light of all caustics, however long its way. It `was_cast` if what scattered it last is
    smooth, or nearly smooth and throws caustics; only scenes with nearly smooth casters keep this. It `is_done` once it
    has ended, for whatever reason.
    """

    ray: Ray
    radiance: wp.vec3
    throughput: wp.vec3
    eta_scale: float
    scatter_pdf: float
    footprint: wp.vec2
    passed_distance: float
    rays: int
    depth: int
    surfaces_passed: int
    direct_radiance: wp.vec3
    is_indirect: bool
    was_blurred: bool
    has_gathered: bool
    has_settled: bool
    was_cast: bool
    receiver: Receiver
    medium_stack: BodyStack
    origin_gap: float
    medium_scatterings: int
    skin: Skin
    previous_hit: Hit
    is_done: bool
    groups: GroupSums
    direct_groups: GroupSums


@wp.struct
class SurfaceVertex:
    """The surface that a ray meets.

    The next ray starts at `origin_in_front`, or at `origin_behind`, within the bodies of `medium_stack_behind`. A
    surface that is not `is_solid` is a hole, or a boundary within a body of higher priority: light passes it. The stage
    `prepare_bsdf` sets `bsdf`, `wo` and the members after them.
    """

    hit: Hit
    surface: Surface
    material: int
    origin_in_front: wp.vec3
    origin_behind: wp.vec3
    medium_stack_behind: BodyStack
    is_solid: bool
    bsdf: Bsdf
    wo: wp.vec3
    is_pane: bool  # lets light through straight on
    samples_lights: bool  # false for delta lobes alone, and in scenes without lights


@wp.func
@inline_stage
def sees_no_lights(path: PathState, settings: PathSettings) -> bool:
    """Return whether a camera ray, which sees neither the environment nor lights without triangles, is still straight.

    Surfaces that let it pass do not count as vertices.
    """
    return settings.hides_lights != 0 and path.depth == 0 and path.medium_scatterings == 0


@wp.func
@inline_stage
def pass_hidden_light(path: PathState, hit: Hit) -> PathState:
    """Move a path straight on to behind a light that it does not see."""
    path.surfaces_passed += 1
    path.is_done = path.surfaces_passed > MOST_PASSED
    distance = hit.t * BEHIND_LIGHT
    path.passed_distance += distance
    path.ray.origin = path.ray.origin + path.ray.direction * distance
    path.origin_gap = 0.0
    return path


@specialised("light_groups")
def make_begin_indirect(features: Features) -> wp.Function:
    """Return the stage (path, has_two_segments) -> PathState that keeps what there is as direct light.

    Only the radiance that follows is clamped.
    """

    @wp.func
    @inline_stage
    def begin_indirect(path: PathState, has_two_segments: bool) -> PathState:
        if has_two_segments and not path.is_indirect:
            path.direct_radiance = path.radiance
            path.radiance = wp.vec3(0.0)
            path.is_indirect = True
            if wp.static(features.light_groups):
                path.direct_groups = path.groups
                path.groups = GroupSums()
        return path

    return begin_indirect


@wp.func
def clamping_scale(radiance: wp.vec3, clamp_indirect: float) -> float:
    """Return the factor, 1 at most, by which every channel of indirect radiance is at most `clamp_indirect`."""
    return wp.min(1.0, clamp_indirect / wp.max(wp.max(radiance), 1.0e-30))


@specialised("light_groups")
def make_path_result(features: Features) -> wp.Function:
    """Return the stage (path, clamp_indirect) -> PathResult or GroupedResult, with the indirect part clamped."""
    Result = result_type(features.light_groups)

    @wp.func
    @inline_stage
    def path_result(path: PathState, clamp_indirect: float) -> Result:
        result = Result()
        result.radiance = path.radiance
        result.rays = path.rays
        if wp.static(features.light_groups):
            result.groups = path.groups
        if path.is_indirect:
            scale = clamping_scale(path.radiance, clamp_indirect)
            result.radiance = path.direct_radiance + path.radiance * scale
            if wp.static(features.light_groups):
                result.groups = path.direct_groups + path.groups * scale
        return result

    return path_result


def result_type(light_groups: bool) -> Any:
    """Return the result of a path for Features.light_groups."""
    return GroupedResult if light_groups else PathResult
