"""Next-event estimation: the light that arrives straight from a lamp where a path is scattered.

The power heuristic weighs it against what is found by following the path (Veach 1997, chapter 9).
"""

import warp as wp

from wrt.kernels.bsdf import make_bsdf, models_with
from wrt.kernels.core.bsdf import Bsdf
from wrt.kernels.core.features import Features
from wrt.kernels.core.ray_tree import INFINITE_DISTANCE
from wrt.kernels.core.rays import Ray, Receiver, to_local
from wrt.kernels.core.scene_data import BodyStack, SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.geometry.surface import Surface
from wrt.kernels.integrators.shadow_rays import can_attenuate_shadows, make_visibility
from wrt.kernels.lights.lights import make_lights
from wrt.kernels.lights.shapes import make_light_shapes
from wrt.kernels.media.grids import make_shadow_in_media
from wrt.kernels.media.medium import make_extinction, phase, transmittance
from wrt.kernels.media.skin import Skin, no_skin
from wrt.kernels.sampling.sampler import stream_key
from wrt.kernels.textures.normal_maps import bump_shadow

# How light that both samplings can find is shared between them.
STRATEGY_MIS = wp.constant(0)
STRATEGY_LIGHT = wp.constant(1)
STRATEGY_BSDF = wp.constant(2)


@wp.struct
class DirectLight:
    """Light that arrives straight from a lamp and is scattered on along a path, and the number of shadow rays.

    If `t_max` is not negative, the light arrives only if nothing is on `shadow_ray` before that distance.
    """

    radiance: wp.vec3
    rays: int
    shadow_ray: Ray
    t_max: float


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
def make_light_in_medium(features: Features) -> wp.Function:
    """Return the device function for the light that a medium scatters into a path, whose direction was `forward`.

    Its arguments are (scene, receiver, forward, g, medium_stack, skin, u_light, strategy).
    """
    sample_light = make_lights(features).sample_light
    visibility = make_visibility(features)

    @wp.func
    def light_in_medium(
        scene: SceneData,
        receiver: Receiver,
        forward: wp.vec3,
        g: float,
        medium_stack: BodyStack,
        skin: Skin,
        u_light: wp.vec4,
        strategy: int,
    ) -> DirectLight:
        result = DirectLight()
        result.t_max = -1.0
        light = sample_light(scene, receiver, u_light)
        density = phase(wp.dot(forward, light.wi), g)
        arriving = light.radiance * density
        if not light.delta:
            arriving = arriving * mis_weight(strategy, light.pdf, density, STRATEGY_LIGHT)
        if wp.max(arriving) > 0.0:
            shadow_ray = Ray()
            shadow_ray.origin = receiver.position
            shadow_ray.direction = light.wi
            shadow_ray.time = receiver.time
            result.rays = 1
            seen = visibility(scene, shadow_ray, light.distance, light.point, medium_stack, skin, u_light)
            result.radiance = wp.cw_mul(arriving, seen)
        return result

    return light_in_medium


@specialised("models", "media", "grid_media", "light_shapes", "tangents", *make_lights.fields, *make_visibility.fields)
def make_light_at_surface(features: Features) -> wp.Function:
    """Return the device function for the light that a surface scatters towards wo, from both of its sides.

    Its arguments are (scene, receiver, surface, origin_behind, bsdf, wo, medium_stack, medium_stack_behind, u_light,
    strategy). `receiver` is on the viewer's side, in the bodies of `medium_stack`, and `origin_behind` on the other. If
    surfaces either block light or are not there, the caller is to trace the shadow ray.
    """
    bsdf_evaluate, bsdf_pdf = make_bsdf(features.models).evaluate, make_bsdf(features.models).pdf
    sample_light = make_lights(features).sample_light
    visibility = make_visibility(features)
    attenuates_shadows = can_attenuate_shadows(features)
    light_shapes = bool(features.light_shapes)
    light_shape_blocks = make_light_shapes(features.light_shapes).blocks
    media, grid_media, tangents = features.media != "none", features.grid_media, features.tangents
    extinction_of, shadow_in_media = make_extinction(features.media), make_shadow_in_media(features.media)
    transmits = bool(models_with(features.models, "transmits"))

    @wp.func
    def light_at_surface(
        scene: SceneData,
        receiver: Receiver,
        surface: Surface,
        origin_behind: wp.vec3,
        bsdf: Bsdf,
        wo: wp.vec3,
        medium_stack: BodyStack,
        medium_stack_behind: BodyStack,
        u_light: wp.vec4,
        strategy: int,
    ) -> DirectLight:
        result = DirectLight()
        result.t_max = -1.0
        light = sample_light(scene, receiver, u_light)
        wi = to_local(surface.frame, light.wi)
        # A shading normal must not let light through: both normals must agree on the side.
        above = wp.dot(light.wi, surface.normal) > 0.0
        if above == (wi[2] > 0.0) and (above or wp.static(transmits)):
            arriving = wp.cw_mul(bsdf_evaluate(bsdf, wo, wi), light.radiance)
            if wp.static(tangents):
                arriving = arriving * bump_shadow(surface, light.wi, wi[2])
            if not light.delta:
                pdf = bsdf_pdf(bsdf, wo, wi)
                arriving = arriving * mis_weight(strategy, light.pdf, pdf, STRATEGY_LIGHT)
            if wp.max(arriving) > 0.0:
                shadow_ray = Ray()
                shadow_ray.origin = receiver.position
                shadow_ray.direction = light.wi
                shadow_ray.time = receiver.time
                t_max = light.distance
                shadow_stack = medium_stack
                if wp.static(transmits):
                    if not above:
                        # Towards the same point of the light from the other side of the surface
                        shadow_ray.origin = origin_behind
                        shadow_stack = medium_stack_behind
                        if t_max < INFINITE_DISTANCE:
                            to_light = receiver.position + light.wi * t_max - shadow_ray.origin
                            t_max = wp.length(to_light)
                            shadow_ray.direction = to_light / t_max
                result.rays = 1
                if wp.static(attenuates_shadows):
                    seen = visibility(scene, shadow_ray, t_max, light.point, shadow_stack, no_skin(), u_light)
                    result.radiance = wp.cw_mul(arriving, seen)
                else:
                    blocked = bool(False)
                    if wp.static(light_shapes):
                        blocked = light_shape_blocks(scene, shadow_ray, t_max, light.point)
                    if not blocked:
                        result.radiance = arriving
                        if wp.static(grid_media):
                            left = shadow_in_media(scene, shadow_ray, 0.0, t_max, shadow_stack, stream_key(u_light, 0))
                            result.radiance = wp.cw_mul(arriving, left)
                        elif wp.static(media):
                            transmitted = transmittance(extinction_of(scene, shadow_stack), t_max)
                            result.radiance = wp.cw_mul(arriving, transmitted)
                        result.shadow_ray = shadow_ray
                        result.t_max = t_max
        return result

    return light_at_surface
