"""Next-event estimation: the light that arrives straight from a lamp where a path is scattered.

The power heuristic weighs it against what is found by following the path (Veach 1997, chapter 9).
"""

import functools

import warp as wp

from wrt.kernels.bsdf import make_bsdf, model_of
from wrt.kernels.bsdf.record import Bsdf
from wrt.kernels.features import Features
from wrt.kernels.geometry import Ray, Receiver, to_local
from wrt.kernels.intersect import INFINITE_DISTANCE
from wrt.kernels.light_shapes import light_shape_blocks
from wrt.kernels.lights import make_lights
from wrt.kernels.medium import make_extinction, transmittance
from wrt.kernels.phase import phase
from wrt.kernels.scene_data import BodyStack, SceneData
from wrt.kernels.shadow import dims_light, make_visibility
from wrt.kernels.skin import Skin, no_skin
from wrt.kernels.surface import Surface

# How light that both samplings can find is shared between them.
STRATEGY_MIS = wp.constant(0)
STRATEGY_LIGHT = wp.constant(1)
STRATEGY_BSDF = wp.constant(2)


@wp.struct
class DirectLight:
    """What arrives straight from a lamp and is scattered on along a path, and how many rays that took.

    Where `distance` is not negative, it does so only if nothing is on `way` before it.
    """

    radiance: wp.vec3
    rays: int
    way: Ray
    distance: float


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
def make_light_in_medium(features: Features) -> wp.Function:
    """Return the device function for the light that a medium scatters into the way of a path, `forward` so far.

    Its arguments are (scene, receiver, forward, g, inside, skin, u_light, strategy).
    """
    sample_light = make_lights(features).sample_light
    visibility = make_visibility(features)

    @wp.func
    def light_in_medium(
        scene: SceneData,
        receiver: Receiver,
        forward: wp.vec3,
        g: float,
        inside: BodyStack,
        skin: Skin,
        u_light: wp.vec4,
        strategy: int,
    ) -> DirectLight:
        result = DirectLight()
        result.distance = -1.0
        light = sample_light(scene, receiver, u_light)
        density = phase(wp.dot(forward, light.wi), g)
        arriving = light.radiance * density
        if not light.delta:
            arriving = arriving * mis_weight(strategy, light.pdf, density, STRATEGY_LIGHT)
        if wp.max(arriving) > 0.0:
            shadow = Ray()
            shadow.origin = receiver.position
            shadow.direction = light.wi
            shadow.time = receiver.time
            result.rays = 1
            result.radiance = wp.cw_mul(arriving, visibility(scene, shadow, light.distance, light.point, inside, skin))
        return result

    return light_in_medium


@functools.cache
def make_light_at_surface(features: Features) -> wp.Function:
    """Return the device function for the light that a surface scatters towards wo, from both of its sides.

    Its arguments are (scene, receiver, surface, beyond, bsdf, wo, inside, after, u_light, strategy):
    `receiver` is on the viewer's side, in the bodies `inside`, and `beyond` on the other, in `after`. Whether something
    is in the way it leaves to be asked where that is all that can happen to light.
    """
    bsdf_evaluate, bsdf_pdf, _, _, _ = make_bsdf(features.models)
    sample_light = make_lights(features).sample_light
    visibility = make_visibility(features)
    dims = dims_light(features)
    light_shapes = features.light_shapes
    media = features.media != "none"
    extinction_of = make_extinction(features.media)
    transmits = any(model_of(name).transmits for name in features.models)

    @wp.func
    def light_at_surface(
        scene: SceneData,
        receiver: Receiver,
        surface: Surface,
        beyond: wp.vec3,
        bsdf: Bsdf,
        wo: wp.vec3,
        inside: BodyStack,
        after: BodyStack,
        u_light: wp.vec4,
        strategy: int,
    ) -> DirectLight:
        result = DirectLight()
        result.distance = -1.0
        light = sample_light(scene, receiver, u_light)
        wi = to_local(surface.frame, light.wi)
        # A shading normal must not let light through: both normals must agree on the side.
        above = wp.dot(light.wi, surface.normal) > 0.0
        if above == (wi[2] > 0.0) and (above or wp.static(transmits)):
            arriving = wp.cw_mul(bsdf_evaluate(bsdf, wo, wi), light.radiance)
            if not light.delta:
                pdf = bsdf_pdf(bsdf, wo, wi)
                arriving = arriving * mis_weight(strategy, light.pdf, pdf, STRATEGY_LIGHT)
            if wp.max(arriving) > 0.0:
                shadow = Ray()
                shadow.origin = receiver.position
                shadow.direction = light.wi
                shadow.time = receiver.time
                distance = light.distance
                within = inside
                if wp.static(transmits):
                    if not above:
                        # The way to the same point from the other side of the surface.
                        shadow.origin = beyond
                        within = after
                        if distance < INFINITE_DISTANCE:
                            way = receiver.position + light.wi * distance - shadow.origin
                            distance = wp.length(way)
                            shadow.direction = way / distance
                result.rays = 1
                if wp.static(dims):
                    seen = visibility(scene, shadow, distance, light.point, within, no_skin())
                    result.radiance = wp.cw_mul(arriving, seen)
                else:
                    shaded = bool(False)
                    if wp.static(light_shapes):
                        shaded = light_shape_blocks(scene, shadow, distance, light.point)
                    if not shaded:
                        result.radiance = arriving
                        if wp.static(media):
                            left = transmittance(extinction_of(scene, within), distance)
                            result.radiance = wp.cw_mul(arriving, left)
                        result.way = shadow
                        result.distance = distance
        return result

    return light_at_surface
