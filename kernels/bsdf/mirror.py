"""An ideal mirror of reflectance a at every angle."""

import warp as wp

from wrt.kernels.bsdf.record import Bsdf, BsdfSample, mirror_sample, zero_evaluate, zero_pdf

evaluate = zero_evaluate
pdf = zero_pdf


@wp.func
def sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    """Return the mirrored direction."""
    return mirror_sample(wo, bsdf.a)
