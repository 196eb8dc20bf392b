"""Next-event estimation: stages that sample a light where a path is scattered.

The power heuristic weighs it against light found by following the path (Veach 1997, chapter 9).
"""

import warp as wp

from wrt.kernels.bsdf import make_bsdf, models_with
from wrt.kernels.core.features import Features
from wrt.kernels.core.ray_tree import INFINITE_DISTANCE
from wrt.kernels.core.rays import Ray, to_local
from wrt.kernels.core.scene_data import NEEDS_ATTENUATION, NEEDS_BODIES, BodyStack, SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.core.spmd_marks import inline_stage
from wrt.kernels.integrators.path_state import PathState, SurfaceVertex
from wrt.kernels.integrators.shadow_rays import can_attenuate_shadows, make_visibility, may_leave_shadows
from wrt.kernels.lights.lights import make_lights
from wrt.kernels.lights.record import LightSample
from wrt.kernels.lights.shapes import make_light_shapes
from wrt.kernels.media.grids import make_shadow_in_media
from wrt.kernels.media.medium import phase
from wrt.kernels.media.skin import no_skin
from wrt.kernels.textures.normal_maps import bump_shadow

# The weights of light that both light sampling and BSDF sampling can find.
STRATEGY_MIS = wp.constant(0)
STRATEGY_LIGHT = wp.constant(1)
STRATEGY_BSDF = wp.constant(2)


@wp.struct
class DirectLight:
    """Light from a light source that a vertex scatters along a path, and the number of shadow rays.

    If `t_max` is not negative, the light arrives only if `shadow_ray` meets nothing before that distance.
    """

    radiance: wp.vec3
    rays: int
    shadow_ray: Ray
    t_max: float


@wp.struct
class LightForGradients:
    """A DirectLight with its factors: `radiance` is `value` times `weight` times the radiance of the sample `light`.

    `value` is the vertex's f |cosθi| towards `wi`, in the vertex's frame, or the phase function; `weight` the MIS
    weight, bump shadow and visibility, as far as the shadow ray is not left to the caller. `medium_stack` holds the
    bodies at the ray's origin. A vertex that scatters nothing has the weight 0, but not if the light alone is black.
    """

    radiance: wp.vec3
    rays: int
    shadow_ray: Ray
    t_max: float
    light: LightSample
    wi: wp.vec3
    value: wp.vec3
    weight: wp.vec3
    medium_stack: BodyStack


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


@specialised(*make_lights.fields, *make_visibility.fields)
def make_light_in_medium(features: Features, *, factors: bool = False) -> wp.Function:
    """Return the stage (scene, path, g, u_light, strategy) -> DirectLight that a medium scatters into the path.

    The path and its receiver are at the point of scattering; its ray still has the direction in which it came. With
    `factors` it returns LightForGradients.
    """
    sample_light, visibility = make_lights(features).sample_light, make_visibility(features)
    Result = LightForGradients if factors else DirectLight  # noqa: N806

    @wp.func
    @inline_stage
    def light_in_medium(scene: SceneData, path: PathState, g: float, u_light: wp.vec4, strategy: int) -> Result:
        result = Result()
        result.t_max = -1.0
        light = sample_light(scene, path.receiver, u_light)
        density = phase(wp.dot(path.ray.direction, light.wi), g)
        arriving = light.radiance * density
        weight = float(1.0)
        if not light.delta:
            weight = mis_weight(strategy, light.pdf, density, STRATEGY_LIGHT)
            arriving = arriving * weight
        arrives = wp.max(arriving) > 0.0
        if wp.static(factors):
            result.light = light
            result.value = wp.vec3(density)
            arrives = weight > 0.0 and (light.pdf > 0.0 or light.delta)
        if arrives:
            shadow_ray = Ray()
            shadow_ray.origin = path.receiver.position
            shadow_ray.direction = light.wi
            shadow_ray.time = path.receiver.time
            result.rays = 1
            visible = visibility(scene, shadow_ray, light.distance, light.point, path.medium_stack, path.skin, u_light)
            result.radiance = wp.cw_mul(arriving, visible)
            if wp.static(factors):
                result.weight = visible * weight
                result.shadow_ray = shadow_ray
                result.t_max = light.distance
                result.medium_stack = path.medium_stack
        return result

    return light_in_medium


@specialised(
    *("models", "media", "grid_media", "light_shapes", "tangents", "sampler"),
    *(*make_lights.fields, *make_visibility.fields),
)
def make_light_at_surface(features: Features, *, factors: bool = False) -> wp.Function:
    """Return the stage (scene, path, vertex, u_light, strategy) -> DirectLight, which either side scatters to the path.

    The path's receiver must be at the vertex. If surfaces either block light or are absent, the caller is to trace the
    shadow ray. With `factors` it returns LightForGradients.
    """
    Result = LightForGradients if factors else DirectLight  # noqa: N806
    bsdf, sample_light = make_bsdf(features.models), make_lights(features).sample_light
    visibility, shadow_in_media = make_visibility(features), make_shadow_in_media(features)
    attenuates_shadows, may_leave = can_attenuate_shadows(features), may_leave_shadows(features) and not factors
    light_shapes = make_light_shapes(features.light_shapes)
    transmits = bool(models_with(features.models, "transmits"))

    @wp.func
    @inline_stage
    def light_at_surface(
        scene: SceneData, path: PathState, vertex: SurfaceVertex, u_light: wp.vec4, strategy: int
    ) -> Result:
        result = Result()
        result.t_max = -1.0
        if vertex.samples_lights:
            light = sample_light(scene, path.receiver, u_light)
            wi = to_local(vertex.surface.frame, light.wi)
            # A shading normal must not let light through: both normals must agree on the side.
            above = wp.dot(light.wi, vertex.surface.normal) > 0.0
            if above == (wi[2] > 0.0) and (above or wp.static(transmits)):
                value = bsdf.evaluate(vertex.bsdf, vertex.wo, wi)
                arriving = wp.cw_mul(value, light.radiance)
                weight = wp.vec3(1.0)
                if wp.static(features.tangents):
                    shadow = bump_shadow(vertex.surface, light.wi, wi[2])
                    arriving = arriving * shadow
                    weight = weight * shadow
                if not light.delta:
                    pdf = bsdf.pdf(vertex.bsdf, vertex.wo, wi)
                    light_weight = mis_weight(strategy, light.pdf, pdf, STRATEGY_LIGHT)
                    arriving = arriving * light_weight
                    weight = weight * light_weight
                arrives = wp.max(arriving) > 0.0
                if wp.static(factors):
                    result.light = light
                    result.wi = wi
                    result.value = value
                    arrives = wp.max(weight) > 0.0 and (light.pdf > 0.0 or light.delta)
                if arrives:
                    shadow_ray = Ray()
                    shadow_ray.origin = path.receiver.position
                    shadow_ray.direction = light.wi
                    shadow_ray.time = path.receiver.time
                    t_max = light.distance
                    shadow_stack = path.medium_stack
                    if wp.static(transmits):
                        if not above:
                            # Towards the same point of the light from the other side of the surface
                            shadow_ray.origin = vertex.origin_behind
                            shadow_stack = vertex.medium_stack_behind
                            if t_max < INFINITE_DISTANCE:
                                to_light = path.receiver.position + light.wi * t_max - shadow_ray.origin
                                t_max = wp.length(to_light)
                                shadow_ray.direction = to_light / t_max
                    result.rays = 1
                    is_left = bool(True)  # to the caller, which traces the shadow ray
                    if wp.static(attenuates_shadows):
                        is_left = False
                        if wp.static(may_leave):
                            is_left = scene.needs & NEEDS_ATTENUATION == 0
                        if not is_left:
                            visible = visibility(
                                scene, shadow_ray, t_max, light.point, shadow_stack, no_skin(), u_light
                            )
                            result.radiance = wp.cw_mul(arriving, visible)
                            if wp.static(factors):
                                result.weight = wp.cw_mul(weight, visible)
                                result.shadow_ray = shadow_ray
                                result.t_max = t_max
                    if wp.static(may_leave or not attenuates_shadows):
                        blocked = not is_left
                        if wp.static(bool(features.light_shapes)):
                            blocked = blocked or light_shapes.blocks(scene, shadow_ray, t_max, light.point)
                        if not blocked:
                            result.radiance = arriving
                            if wp.static(factors):
                                result.weight = weight
                            if wp.static(features.media != "none"):
                                if scene.needs & NEEDS_BODIES != 0:
                                    share = shadow_in_media(scene, shadow_ray, 0.0, t_max, shadow_stack, u_light, 0)
                                    result.radiance = wp.cw_mul(arriving, share)
                                    if wp.static(factors):
                                        result.weight = wp.cw_mul(weight, share)
                            result.shadow_ray = shadow_ray
                            result.t_max = t_max
                    if wp.static(factors):
                        result.medium_stack = shadow_stack
        return result

    return light_at_surface
