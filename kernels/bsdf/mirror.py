"""An ideal mirror of reflectance a at every angle."""

import warp as wp

from wrt.kernels.bsdf.record import Bsdf, BsdfSample, mirror_sample


@wp.func
def evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
    """Return zero: no direction but the mirrored one."""
    return wp.vec3(0.0)


@wp.func
def pdf(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
    """Return zero."""
    return 0.0


@wp.func
def sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    """Return the mirrored direction."""
    return mirror_sample(wo, bsdf.a)
