"""What models of microfacets share: their shape, the direction that a facet mirrors, and sampling by both.

Slot SHAPE of such a model is the shape of its distribution of normals (`kernels/microfacet`).
"""

import functools

import warp as wp

from wrt.kernels.bsdf.record import Bsdf, BsdfSample, no_sample
from wrt.kernels.microfacet import LEAST_ALPHA
from wrt.kernels.microfacet.widening import WIDENED, not_widened

SHAPE = wp.constant(0)

BY_ALPHA = ("ggx", "beckmann", "blinn-phong")
ISOTROPIC = ("blinn-phong",)


@wp.func
def mirrored(wo: wp.vec3, m: wp.vec3) -> wp.vec3:
    """Return the direction that a facet reflects to wo; zero where that is below the surface."""
    wi = wp.normalize(m * (2.0 * wp.dot(wo, m)) - wo)
    return wp.where(wi[2] > 0.0, wi, wp.vec3(0.0))


@functools.cache
def make_shape_of(distribution: str) -> wp.Function:
    """Return the device function bsdf -> shape of the distribution: within its limits, and widened by a normal map."""
    by_alpha = distribution in BY_ALPHA
    isotropic = distribution in ISOTROPIC
    widened = WIDENED.get(distribution, not_widened)

    @wp.func(name=f"facets_shape_{distribution.replace('-', '_')}")
    def shape_of(bsdf: Bsdf) -> wp.vec3:
        shape = bsdf.slots[SHAPE]
        if wp.static(by_alpha):
            along_x = wp.clamp(shape[0], LEAST_ALPHA, 1.0)
            along_y = wp.clamp(shape[1], LEAST_ALPHA, 1.0)
            if wp.static(isotropic):
                along_y = along_x
            shape = wp.vec3(along_x, along_y, 0.0)
        return widened(shape, bsdf.normal_variance)

    return shape_of


@functools.cache
def make_alpha_of(distribution: str) -> wp.Function:
    """Return the device function bsdf -> roughness: the geometric mean of that along x and that along y."""
    shape_of = make_shape_of(distribution)

    @wp.func(name=f"facets_alpha_{distribution.replace('-', '_')}")
    def alpha_of(bsdf: Bsdf) -> float:
        shape = shape_of(bsdf)
        return wp.sqrt(shape[0] * shape[1])

    return alpha_of


def make_sample(name: str, evaluate: wp.Function, pdf: wp.Function, direction: wp.Function) -> wp.Function:
    """Return the sampling of a model by a function (bsdf, wo, u, u_lobe) -> wi, which is zero where there is none.

    Value and density are those of the direction, not of the normal that it came from: at a roughness of 1e-4 the two
    differ by what float32 rounds, and the renderer asks for both again.

    Args:
        name: of the device function.
        evaluate: that of the model.
        pdf: that of the model; 0 for a direction that is zero.
        direction: what draws from that density.
    """

    @wp.func(name=name)
    def sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
        s = no_sample()
        wi = direction(bsdf, wo, u, u_lobe)
        density = pdf(bsdf, wo, wi)
        if density > 0.0:
            s.wi = wi
            s.weight = evaluate(bsdf, wo, wi) / density
            s.pdf = density
        return s

    return sample
