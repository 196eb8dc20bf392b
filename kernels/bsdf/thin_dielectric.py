"""A thin pane of a transparent medium: two parallel faces so close that light leaves at the point of entry.

Light bounces between the faces any number of times. With R the reflectance of one face and T = 1 − R, the pane reflects
R + T²R + T²R³ + … = 2R / (1 + R) and transmits the rest straight on (Stokes 1862, "On the intensity of the light
reflected from or transmitted through a pile of plates", without absorption).
"""

import warp as wp

from wrt.kernels.bsdf.lobes.fresnel import fresnel_dielectric
from wrt.kernels.bsdf.record import (
    Bsdf,
    BsdfSample,
    Model,
    SpecularLobes,
    mirror_lobe,
    mirror_sample,
    zero_evaluate,
    zero_pdf,
)

IOR = wp.constant(0)  # n of the pane over n around it
REFLECTANCE = wp.constant(1)  # factor of reflected light
TRANSMITTANCE = wp.constant(2)  # factor of transmitted light


@wp.func
def pane_reflectance(cos_i: float, eta: float) -> float:
    """Return a pane's reflectance at cosθi ≥ 0, for eta = n of the pane over n around it."""
    r = fresnel_dielectric(cos_i, eta)
    return 2.0 * r / (1.0 + r)


@wp.func
def sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    """Return the mirror direction, or the one straight on."""
    s = mirror_sample(wo, bsdf.slots[REFLECTANCE])
    if u_lobe >= pane_reflectance(wo[2], bsdf.slots[IOR][0]):
        s.wi = -wo
        s.weight = bsdf.slots[TRANSMITTANCE]
    return s


@wp.func
def specular(bsdf: Bsdf, wo: wp.vec3) -> SpecularLobes:
    """Return the mirror direction and the one straight on."""
    reflectance = pane_reflectance(wo[2], bsdf.slots[IOR][0])
    lobes = mirror_lobe(bsdf.slots[REFLECTANCE] * reflectance)
    lobes.transmitted = bsdf.slots[TRANSMITTANCE] * (1.0 - reflectance)
    lobes.through = -wo
    return lobes


@wp.func
def straight(bsdf: Bsdf, wo: wp.vec3) -> wp.vec3:
    """Return the share of light that goes straight on."""
    return bsdf.slots[TRANSMITTANCE] * (1.0 - pane_reflectance(wo[2], bsdf.slots[IOR][0]))


MODEL = Model(
    zero_evaluate, zero_pdf, sample, slots=3, delta=True, transmits=True, specular=specular, straight=straight
)
