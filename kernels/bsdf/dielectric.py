"""A smooth boundary between two transparent media.

Reflection and refraction by the exact Fresnel equations, chosen in their proportion. Radiance is
scaled by (n_i / n_t)² on refraction, because a refracted beam fills another solid angle.
"""

import warp as wp

from wrt.kernels.bsdf.record import Bsdf, BsdfSample, Model, mirror_sample, zero_evaluate, zero_pdf
from wrt.kernels.fresnel import cos_transmitted_squared, fresnel_dielectric

IOR = wp.constant(0)  # n_inside / n_outside
REFLECTANCE = wp.constant(1)  # what reflected light is multiplied by
TRANSMITTANCE = wp.constant(2)  # what refracted light is multiplied by


@wp.func
def seen_from(inside_over_outside: float, front: bool) -> float:
    """Return n_t / n_i, the index on the other side over that on the viewer's, who is in front or not."""
    return wp.where(front, inside_over_outside, 1.0 / inside_over_outside)


@wp.func
def sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    """Return the reflected or the refracted direction."""
    eta = seen_from(bsdf.slots[IOR][0], bsdf.front)
    s = mirror_sample(wo, bsdf.slots[REFLECTANCE])
    if u_lobe >= fresnel_dielectric(wo[2], eta):
        scale = 1.0 / eta
        cos_t = wp.sqrt(wp.max(0.0, cos_transmitted_squared(wo[2], eta)))
        s.wi = wp.vec3(-wo[0] * scale, -wo[1] * scale, -cos_t)
        s.weight = bsdf.slots[TRANSMITTANCE] * (scale * scale)
        s.eta = eta
    return s


MODEL = Model(zero_evaluate, zero_pdf, sample, slots=3, delta=True, transmits=True)
