"""Lambertian reflection: f = reflectance / π."""

import warp as wp

from wrt.kernels.core.bsdf import Bsdf, BsdfSample, Model, no_sample
from wrt.kernels.sampling.warps import INV_PI, square_to_cosine_hemisphere

REFLECTANCE = wp.constant(0)


@wp.func
def evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
    """Return f |cosθi|."""
    return bsdf.slots[REFLECTANCE] * (INV_PI * wp.max(wi[2], 0.0))


@wp.func
def pdf(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
    """Return the density of `sample` per solid angle."""
    return INV_PI * wp.max(wi[2], 0.0)


@wp.func
def sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    """Return a direction with density cosθ/π."""
    s = no_sample()
    s.wi = square_to_cosine_hemisphere(u)
    s.weight = bsdf.slots[REFLECTANCE]
    s.pdf = INV_PI * s.wi[2]
    return s


DIFFUSE = Model(evaluate, pdf, sample, slots=1, matt=True)
