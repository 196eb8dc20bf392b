"""Plastic: a diffuse base under a smooth transparent coat, which the base's light leaves only in part.

Light is mirrored by the coat, or refracted into it; there the base reflects it diffusely, and what meets the coat from
below is let out or sent back to the base, any number of times. That makes a geometric series:

    f = ρ/π T(θo) T(θi) / (η² (1 − R ρ)),    T = 1 − F,    R = 2 ∫ F_inside cosθ d cosθ

(Wolff 1994, "Diffuse-reflectance model for smooth dielectric surfaces"; its series is that of Saunderson 1942,
"Calculation of the color of pigmented plastics"). The division by η² is the spreading of radiance on the way out.
As 1 − R = (1 − R_outside) / η², a white base keeps nothing. Without the nonlinear shift of colours the denominator is
that of a white base, 1 − R, and the albedo is ρ T(θo).
"""

import warp as wp

from wrt.kernels.bsdf.record import Bsdf, BsdfSample, Model, SpecularLobes, mirror_lobe, mirror_sample
from wrt.kernels.coat import transmitted
from wrt.kernels.warps import INV_PI, square_to_cosine_hemisphere

REFLECTANCE = wp.constant(0)  # of the base
SPECULAR = wp.constant(1)  # what light mirrored by the coat is multiplied by
IOR = wp.constant(2)  # n of the coat / n outside
INTERNAL = wp.constant(3)  # R, the coat's reflectance for diffuse light from below
NONLINEAR = wp.constant(4)  # 1 where colours shift by inner reflections, else 0


@wp.func
def base_reflectance(rho: wp.vec3, internal: float, nonlinear: float) -> wp.vec3:
    """Return what the base sends up with all inner reflections, ρ / (1 − R ρ); or ρ / (1 − R) if `nonlinear` is 0."""
    one = wp.vec3(1.0)
    return wp.cw_div(rho, one - (one + (rho - one) * nonlinear) * internal)


@wp.func
def mean(color: wp.vec3) -> float:
    """Return the mean of three channels."""
    return (color[0] + color[1] + color[2]) / 3.0


@wp.func
def base_share(bsdf: Bsdf, let_in: float) -> float:
    """Return how often the base is sampled, by the share of light that it sends back of what the coat lets in.

    Inner reflections are left out; without nonlinear shifts of colour the share is exact.
    """
    base = let_in * mean(bsdf.slots[REFLECTANCE])
    return base / wp.max(base + (1.0 - let_in) * mean(bsdf.slots[SPECULAR]), 1.0e-20)


@wp.func
def evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
    """Return f |cosθi| of the base."""
    if wi[2] <= 0.0:
        return wp.vec3(0.0)
    eta = bsdf.slots[IOR][0]
    base = base_reflectance(bsdf.slots[REFLECTANCE], bsdf.slots[INTERNAL][0], bsdf.slots[NONLINEAR][0])
    return base * (INV_PI * wi[2] * transmitted(wo[2], eta) * transmitted(wi[2], eta) / (eta * eta))


@wp.func
def pdf(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
    """Return the density of `sample` per solid angle, without the mirrored direction."""
    if wi[2] <= 0.0:
        return 0.0
    return base_share(bsdf, transmitted(wo[2], bsdf.slots[IOR][0])) * INV_PI * wi[2]


@wp.func
def sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    """Return the mirrored direction, or one of density cosθ/π from the base."""
    let_in = transmitted(wo[2], bsdf.slots[IOR][0])
    share = base_share(bsdf, let_in)
    if u_lobe >= share:
        return mirror_sample(wo, bsdf.slots[SPECULAR] * ((1.0 - let_in) / (1.0 - share)))
    s = BsdfSample()
    s.wi = square_to_cosine_hemisphere(u)
    s.delta = False
    s.eta = 1.0
    s.pdf = share * INV_PI * s.wi[2]
    s.weight = wp.vec3(0.0)
    if s.pdf > 0.0:
        s.weight = evaluate(bsdf, wo, s.wi) / s.pdf
    return s


@wp.func
def specular(bsdf: Bsdf, wo: wp.vec3) -> SpecularLobes:
    """Return the direction mirrored by the coat."""
    return mirror_lobe(bsdf.slots[SPECULAR] * (1.0 - transmitted(wo[2], bsdf.slots[IOR][0])))


MODEL = Model(evaluate, pdf, sample, slots=5, specular=specular)
