"""Plastic: a diffuse base under a smooth transparent coat with inner reflections.

The coat mirrors light or refracts it to the base, which reflects it diffusely; from below, the coat transmits it or
reflects it back to the base, any number of times. The geometric series is

    f = ρ/π T(θo) T(θi) / (η² (1 − R ρ)),    T = 1 − F,    R = 2 ∫ F_inside cosθ d cosθ

(Wolff 1994, "Diffuse-reflectance model for smooth dielectric surfaces"; its series is that of Saunderson 1942,
"Calculation of the color of pigmented plastics"). The division by η² is the spreading of radiance on the way out.
As 1 − R = (1 − R_outside) / η², a white base absorbs nothing. Without the nonlinear colour shift the denominator is
that of a white base, 1 − R, and the albedo is ρ T(θo).
"""

import warp as wp

from wrt.kernels.bsdf.lobes.coat_transmittance import transmitted
from wrt.kernels.bsdf.record import Bsdf, BsdfSample, Model, SpecularLobes, mirror_lobe, mirror_sample
from wrt.kernels.sampling.warps import INV_PI, square_to_cosine_hemisphere

REFLECTANCE = wp.constant(0)  # of the base
SPECULAR = wp.constant(1)  # factor of light mirrored by the coat
IOR = wp.constant(2)  # n of the coat / n outside
INTERNAL = wp.constant(3)  # R, the coat's reflectance for diffuse light from below
NONLINEAR = wp.constant(4)  # 1 if inner reflections shift colours, else 0


@wp.func
def base_reflectance(rho: wp.vec3, internal: float, nonlinear: float) -> wp.vec3:
    """Return the base's reflectance with all inner reflections, ρ / (1 − R ρ), or ρ / (1 − R) if `nonlinear` is 0."""
    one = wp.vec3(1.0)
    return wp.cw_div(rho, one - (one + (rho - one) * nonlinear) * internal)


@wp.func
def mean(color: wp.vec3) -> float:
    """Return the mean of three channels."""
    return (color[0] + color[1] + color[2]) / 3.0


@wp.func
def base_share(bsdf: Bsdf, let_in: float) -> float:
    """Return the probability of sampling the base, from the share of light that the coat lets in.

    It leaves inner reflections out; without the nonlinear colour shift it is exact.
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
    """Return the mirror direction, or one with density cosθ/π from the base."""
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
