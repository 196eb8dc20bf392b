"""A smooth metal of refractive index a and extinction b: a mirror weighted by Fresnel reflectance."""

import warp as wp

from wrt.kernels.bsdf.record import Bsdf, BsdfSample, mirror_sample, zero_evaluate, zero_pdf
from wrt.kernels.fresnel import fresnel_conductor

evaluate = zero_evaluate
pdf = zero_pdf


@wp.func
def sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    """Return the mirrored direction."""
    return mirror_sample(wo, fresnel_conductor(wo[2], bsdf.a, bsdf.b))
