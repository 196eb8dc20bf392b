"""Layers on a base: a coat and sheen. Each passes the light that it does not reflect to the layers below.

f = f_layer + f_base · min(1 − E(wo), 1 − E(wi)), where E is the layer's own albedo. The base's share of light from wo
is at most 1 − E(wo), which conserves energy, and both directions count alike, which is reciprocal. The form is that of
Estevez and Kulla (2017) for sheen, and of KHR_materials_sheen after them.

A coat may have normals of its own, then given with those of its base in a frame in which neither is z. Each layer has
its cosines and its E about its own normal, and is reciprocal only with that cosine. z decides which directions are
above the surface; light that leaves a layer to another side than it does in that layer's frame is lost.
"""

from typing import NamedTuple

import warp as wp

from wrt.kernels.bsdf.lobes.albedo_fits import LEAST_SHEEN_ROUGHNESS, SHEEN_CUT, sheen_albedo, specular_albedo
from wrt.kernels.bsdf.lobes.facets import make_facet_response, make_round_shapes, mirrored
from wrt.kernels.bsdf.lobes.fresnel import fresnel_schlick
from wrt.kernels.core.bsdf import Bsdf
from wrt.kernels.core.elementary import exponential, sine_cosine
from wrt.kernels.core.specialise import specialised
from wrt.kernels.microfacet import LEAST_ALPHA, bumpy_ggx, ggx
from wrt.kernels.sampling.warps import BELOW_ONE, TWO_PI

COAT_F0 = wp.constant(0.04)
"""Reflectance at normal incidence of a coat of index 1.5."""


@wp.struct
class Response:
    """A BSDF for two directions.

    `value` is f |cosθi|, `density` that of sampling wi per solid angle, and `albedo` about the share of light from wo
    that is reflected or transmitted.
    """

    value: wp.vec3
    density: float
    albedo: float


class Layer(NamedTuple):
    """A layer with all below it, each lobe sampled in proportion to its reflection.

    Attributes:
        evaluate: (bsdf, wo, wi) -> Response, for wo above the surface.
        direction: (bsdf, wo, u: vec2, u_lobe) -> wi; zero for none.
        albedo: (bsdf, wo) -> float, `Response.albedo`.
    """

    evaluate: wp.Function
    direction: wp.Function
    albedo: wp.Function


@wp.func
def alpha_of(roughness: float) -> float:
    """Return α = roughness² (Burley 2012), clamped."""
    r = wp.clamp(roughness, 0.0, 1.0)
    return wp.max(r * r, LEAST_ALPHA)


@wp.func
def layer_share(reflected: float, below: float) -> float:
    """Return the probability of sampling a layer that reflects `reflected`, above one that reflects `below`."""
    return reflected / wp.max(reflected + (1.0 - reflected) * below, 1.0e-20)


@specialised()
def make_outside(body: bool) -> wp.Function:
    """Return the device function (bsdf, w) -> bool: whether a direction is on a side with layers.

    Layers lie on the outside of a body; an opaque surface and a thin sheet have them on both sides.
    """

    @wp.func
    def outside(bsdf: Bsdf, w: wp.vec3) -> bool:
        return wp.static(not body) or bsdf.front == (w[2] > 0.0)

    return outside


@wp.func
def _as_it_is(bsdf: Bsdf, w: wp.vec3, sign: float) -> wp.vec3:
    return w


@specialised()
def make_about(row: int) -> wp.Function:
    """Return the device function (bsdf, w, sign) -> vec3: w in a frame about the normal in a row, or with −1 back.

    The row has x and y of the normal as its second and third numbers. The frame is as for a normal map: its x is the
    projection of x. Without a row, which is −1, it is the frame of w.
    """
    if row < 0:
        return _as_it_is

    @wp.func
    def about(bsdf: Bsdf, w: wp.vec3, sign: float) -> wp.vec3:
        n_x = bsdf.slots[wp.static(row)][1]
        n_y = bsdf.slots[wp.static(row)][2]
        n = wp.vec3(n_x, n_y, wp.sqrt(wp.max(1.0 - n_x * n_x - n_y * n_y, 0.0)))
        x = wp.normalize(wp.vec3(1.0 - n_x * n_x, -n_x * n_y, -n_x * n[2]))
        y = wp.cross(n, x)
        if sign > 0.0:
            return wp.vec3(wp.dot(w, x), wp.dot(w, y), wp.dot(w, n))
        return x * w[0] + y * w[1] + n * w[2]

    return about


@wp.func
def same_side(a: wp.vec3, b: wp.vec3) -> bool:
    """Return whether a direction is above the surface, or below it, in two frames."""
    return (a[2] > 0.0) == (b[2] > 0.0)


@specialised()
def add_coat(
    below: Layer, coat: int, roughness: int, body: bool, bumpy: bool = False, own_normals: bool = False
) -> Layer:
    """Return a layer under a clear coat: KHR_materials_clearcoat, in a reciprocal form.

    Args:
        below: the layer below.
        coat: row of the share of the surface that is coated.
        roughness: row of the coat's roughness.
        body: whether the surface bounds a transparent body, which is coated outside only.
        bumpy: whether bumps make its distribution a `BumpyShape`.
        own_normals: whether the two rows have the normals of the coat and of the layer below, as in `make_about`.
    """
    outside = make_outside(body)
    about_coat, about_base = make_about(coat if own_normals else -1), make_about(roughness if own_normals else -1)
    shapes, facet_response = make_round_shapes(bumpy), make_facet_response(bumpy)
    distribution = bumpy_ggx if bumpy else ggx

    @wp.func
    def alpha_at(bsdf: Bsdf) -> float:
        return alpha_of(bsdf.slots[wp.static(roughness)][0])

    @wp.func
    def shape_of(bsdf: Bsdf) -> wp.vec3:
        return shapes.as_rough(alpha_at(bsdf), bsdf.normal_variance)

    @wp.func
    def reflected_at(bsdf: Bsdf, w: wp.vec3, alpha: float) -> float:
        if not outside(bsdf, w):
            return 0.0
        albedo = specular_albedo(wp.abs(about_coat(bsdf, w, 1.0)[2]), alpha)
        return wp.clamp(bsdf.slots[wp.static(coat)][0], 0.0, 1.0) * (COAT_F0 * (albedo[0] - albedo[1]) + albedo[1])

    @wp.func
    def base_response(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> Response:
        base_o = about_base(bsdf, wo, 1.0)
        base_i = about_base(bsdf, wi, 1.0)
        if wp.static(own_normals):
            if base_o[2] <= 0.0:
                return Response()
        base = below.evaluate(bsdf, base_o, base_i)
        if wp.static(own_normals):
            if not same_side(wi, base_i):
                base.value = wp.vec3(0.0)
                base.density = 0.0
        return base

    @wp.func
    def base_albedo(bsdf: Bsdf, wo: wp.vec3) -> float:
        base_o = about_base(bsdf, wo, 1.0)
        if wp.static(own_normals):
            if base_o[2] <= 0.0:
                return 0.0
        return below.albedo(bsdf, base_o)

    @wp.func
    def evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> Response:
        shape = shape_of(bsdf)
        reflected = reflected_at(bsdf, wo, shape[0])
        base = base_response(bsdf, wo, wi)
        share = layer_share(reflected, base.albedo)
        r = Response()
        r.albedo = reflected + (1.0 - reflected) * base.albedo
        r.value = base.value * (1.0 - wp.max(reflected, reflected_at(bsdf, wi, shape[0])))
        r.density = base.density * (1.0 - share)
        coat_o = about_coat(bsdf, wo, 1.0)
        coat_i = about_coat(bsdf, wi, 1.0)
        is_above = wi[2] > 0.0
        if wp.static(own_normals):
            is_above = is_above and coat_o[2] > 0.0 and coat_i[2] > 0.0
        if is_above and reflected > 0.0:
            facets = facet_response(coat_o, coat_i, shapes.of_normals(alpha_at(bsdf), shape))
            amount = wp.clamp(bsdf.slots[wp.static(coat)][0], 0.0, 1.0) * facets[0]
            r.value = r.value + fresnel_schlick(0.5 * wp.length(wo + wi), wp.vec3(COAT_F0)) * amount
            r.density += share * facets[1]
        return r

    @wp.func
    def direction(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> wp.vec3:
        shape = shape_of(bsdf)
        share = layer_share(reflected_at(bsdf, wo, shape[0]), base_albedo(bsdf, wo))
        if u_lobe < share:
            coat_o = about_coat(bsdf, wo, 1.0)
            m = distribution.sample_normal(coat_o, shapes.of_normals(alpha_at(bsdf), shape), u)
            coat_i = mirrored(coat_o, m)
            reflected = about_coat(bsdf, coat_i, -1.0)
            if wp.static(own_normals):
                if not same_side(reflected, coat_i):
                    return wp.vec3(0.0)
            return reflected
        base_o = about_base(bsdf, wo, 1.0)
        base_i = below.direction(bsdf, base_o, u, wp.min((u_lobe - share) / (1.0 - share), BELOW_ONE))
        wi = about_base(bsdf, base_i, -1.0)
        if wp.static(own_normals):
            if not same_side(wi, base_i):
                return wp.vec3(0.0)
        return wi

    @wp.func
    def albedo(bsdf: Bsdf, wo: wp.vec3) -> float:
        reflected = reflected_at(bsdf, wo, shape_of(bsdf)[0])
        return reflected + (1.0 - reflected) * base_albedo(bsdf, wo)

    return Layer(evaluate, direction, albedo)


@wp.func
def _curve(x: float, k: float) -> float:
    """Return ln Λ for cosθ = x ≤ 1/2 and k = (1 − r)²: a fit by Estevez and Kulla."""
    a = wp.lerp(21.5473, 25.3245, k)
    b = wp.lerp(3.82987, 3.32435, k)
    c = wp.lerp(0.19823, 0.16801, k)
    d = wp.lerp(-1.97760, -1.27393, k)
    e = wp.lerp(-4.32054, -4.85967, k)
    return a / (1.0 + b * wp.pow(x, c)) + d * x + e


@wp.func
def sheen_lambda(mu: float, roughness: float) -> float:
    """Return Λ at a cosine: their L(x), whose logarithm is point-mirrored above 1/2."""
    r = 1.0 - roughness * roughness
    k = r * r
    if mu < 0.5:
        return exponential(_curve(mu, k))
    return exponential(2.0 * _curve(0.5, k) - _curve(1.0 - wp.min(mu, 1.0), k))


@wp.func
def sheen(wo: wp.vec3, wi: wp.vec3, roughness: float, most_albedo: float) -> float:
    """Return f cosθi of white sheen for directions above the surface.

    Args:
        wo: towards the viewer.
        wi: towards the light.
        roughness: LEAST_SHEEN_ROUGHNESS to 1.
        most_albedo: the larger `sheen_albedo` of both directions.
    """
    h = wp.normalize(wo + wi)
    inverse = 1.0 / (roughness * roughness)
    sine2 = wp.min(h[0] * h[0] + h[1] * h[1], 1.0)
    d = (2.0 + inverse) * wp.pow(sine2, 0.5 * inverse) / TWO_PI
    mu_o = wp.max(wo[2], SHEEN_CUT)
    mu_i = wp.max(wi[2], SHEEN_CUT)
    hidden = sheen_lambda(mu_o, roughness) + sheen_lambda(mu_i, roughness)
    return d * wi[2] / (4.0 * mu_o * mu_i * (1.0 + hidden) * wp.max(most_albedo, 1.0))


@specialised()
def add_sheen(below: Layer, color: int, roughness: int, body: bool) -> Layer:
    """Return a layer under fibres: KHR_materials_sheen.

    Args:
        below: the layer below.
        color: row of the fibres' colour.
        roughness: row of their roughness.
        body: whether the surface bounds a transparent body, which has fibres outside only.
    """
    outside = make_outside(body)

    @wp.func
    def color_of(bsdf: Bsdf) -> wp.vec3:
        return wp.min(bsdf.slots[wp.static(color)], wp.vec3(1.0))

    @wp.func
    def white_albedo(bsdf: Bsdf, w: wp.vec3) -> float:
        if not outside(bsdf, w):
            return 0.0
        return sheen_albedo(wp.abs(w[2]), wp.clamp(bsdf.slots[wp.static(roughness)][0], LEAST_SHEEN_ROUGHNESS, 1.0))

    @wp.func
    def evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> Response:
        tint = color_of(bsdf)
        albedo_o = white_albedo(bsdf, wo)
        albedo_i = white_albedo(bsdf, wi)
        most = wp.max(albedo_o, albedo_i)
        reflected = wp.max(tint) * wp.min(albedo_o, 1.0)
        base = below.evaluate(bsdf, wo, wi)
        share = layer_share(reflected, base.albedo)
        r = Response()
        r.albedo = reflected + (1.0 - reflected) * base.albedo
        r.value = base.value * (1.0 - wp.max(tint) * wp.min(most, 1.0))
        r.density = base.density * (1.0 - share)
        if wi[2] > 0.0 and share > 0.0:
            smooth = wp.clamp(bsdf.slots[wp.static(roughness)][0], LEAST_SHEEN_ROUGHNESS, 1.0)
            r.value = r.value + tint * sheen(wo, wi, smooth, most)
            r.density += share / TWO_PI
        return r

    @wp.func
    def direction(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> wp.vec3:
        reflected = wp.max(color_of(bsdf)) * wp.min(white_albedo(bsdf, wo), 1.0)
        share = layer_share(reflected, below.albedo(bsdf, wo))
        if u_lobe < share:
            # Sample the hemisphere uniformly, as Estevez and Kulla recommend.
            z = 1.0 - u[0]
            radius = wp.sqrt(wp.max(0.0, 1.0 - z * z))
            turned = sine_cosine(TWO_PI * u[1])
            return wp.vec3(radius * turned[1], radius * turned[0], z)
        return below.direction(bsdf, wo, u, wp.min((u_lobe - share) / (1.0 - share), BELOW_ONE))

    @wp.func
    def albedo(bsdf: Bsdf, wo: wp.vec3) -> float:
        reflected = wp.max(color_of(bsdf)) * wp.min(white_albedo(bsdf, wo), 1.0)
        return reflected + (1.0 - reflected) * below.albedo(bsdf, wo)

    return Layer(evaluate, direction, albedo)
