"""A smooth boundary between two transparent media.

Reflection and refraction by the exact Fresnel equations, chosen in their proportion. Radiance is
scaled by (n_i / n_t)² on refraction, because a refracted beam fills another solid angle.
"""

import warp as wp

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
from wrt.kernels.fresnel import cos_transmitted_squared, fresnel_dielectric

IOR = wp.constant(0)  # n_inside / n_outside
REFLECTANCE = wp.constant(1)  # what reflected light is multiplied by
TRANSMITTANCE = wp.constant(2)  # what refracted light is multiplied by


@wp.func
def seen_from(inside_over_outside: float, front: bool) -> float:
    """Return n_t / n_i, the index on the other side over that on the viewer's, who is in front or not."""
    return wp.where(front, inside_over_outside, 1.0 / inside_over_outside)


@wp.func
def refracted(wo: wp.vec3, eta: float) -> wp.vec3:
    """Return the direction beyond the boundary, where there is one; eta = n_t / n_i."""
    cos_t = wp.sqrt(wp.max(0.0, cos_transmitted_squared(wo[2], eta)))
    scale = 1.0 / eta
    return wp.vec3(-wo[0] * scale, -wo[1] * scale, -cos_t)


@wp.func
def sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    """Return the reflected or the refracted direction."""
    eta = seen_from(bsdf.slots[IOR][0], bsdf.front)
    s = mirror_sample(wo, bsdf.slots[REFLECTANCE])
    if u_lobe >= fresnel_dielectric(wo[2], eta):
        scale = 1.0 / eta
        s.wi = refracted(wo, eta)
        s.weight = bsdf.slots[TRANSMITTANCE] * (scale * scale)
        s.eta = eta
    return s


@wp.func
def specular(bsdf: Bsdf, wo: wp.vec3) -> SpecularLobes:
    """Return the reflected and the refracted direction."""
    eta = seen_from(bsdf.slots[IOR][0], bsdf.front)
    reflectance = fresnel_dielectric(wo[2], eta)
    lobes = mirror_lobe(bsdf.slots[REFLECTANCE] * reflectance)
    lobes.transmitted = bsdf.slots[TRANSMITTANCE] * ((1.0 - reflectance) / (eta * eta))
    lobes.through = refracted(wo, eta)
    lobes.eta = eta
    return lobes


MODEL = Model(
    zero_evaluate, zero_pdf, sample, slots=3, delta=True, transmits=True, specular=specular, index_slot=int(IOR)
)
