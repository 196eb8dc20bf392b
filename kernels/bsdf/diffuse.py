"""Lambertian reflection: f = a / π, a the reflectance."""

import warp as wp

from wrt.kernels.bsdf.record import Bsdf, BsdfSample
from wrt.kernels.warps import INV_PI, square_to_cosine_hemisphere


@wp.func
def evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
    """Return f |cosθi|."""
    return bsdf.a * (INV_PI * wp.max(wi[2], 0.0))


@wp.func
def pdf(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
    """Return the density of `sample` per solid angle."""
    return INV_PI * wp.max(wi[2], 0.0)


@wp.func
def sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    """Return a direction with density cosθ/π."""
    s = BsdfSample()
    s.wi = square_to_cosine_hemisphere(u)
    s.weight = bsdf.a
    s.pdf = INV_PI * s.wi[2]
    s.delta = False
    s.eta = 1.0
    return s
