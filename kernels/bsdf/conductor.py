"""A smooth metal: a mirror weighted by Fresnel reflectance."""

import warp as wp

from wrt.kernels.bsdf.record import Bsdf, BsdfSample, Model, mirror_sample, zero_evaluate, zero_pdf
from wrt.kernels.fresnel import fresnel_conductor

ETA = wp.constant(0)
K = wp.constant(1)


@wp.func
def sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    """Return the mirrored direction."""
    return mirror_sample(wo, fresnel_conductor(wo[2], bsdf.slots[ETA], bsdf.slots[K]))


MODEL = Model(zero_evaluate, zero_pdf, sample, slots=2, delta=True)
