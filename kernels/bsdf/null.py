"""A boundary that light passes unchanged."""

import warp as wp

from wrt.kernels.bsdf.record import Bsdf, BsdfSample, Model, no_sample, zero_evaluate, zero_pdf


@wp.func
def sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    """Return the direction straight on."""
    s = no_sample()
    s.wi = -wo
    s.weight = wp.vec3(1.0)
    s.delta = True
    return s


@wp.func
def straight(bsdf: Bsdf, wo: wp.vec3) -> wp.vec3:
    """Return the share of light that goes straight on."""
    return wp.vec3(1.0)


MODEL = Model(zero_evaluate, zero_pdf, sample, slots=0, delta=True, transmits=True, straight=straight)
