"""An ideal mirror with the same reflectance at every angle."""

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

REFLECTANCE = wp.constant(0)


@wp.func
def sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    """Return the mirror direction."""
    return mirror_sample(wo, bsdf.slots[REFLECTANCE])


@wp.func
def specular(bsdf: Bsdf, wo: wp.vec3) -> SpecularLobes:
    """Return the mirror direction."""
    return mirror_lobe(bsdf.slots[REFLECTANCE])


MODEL = Model(zero_evaluate, zero_pdf, sample, slots=1, delta=True, specular=specular)
