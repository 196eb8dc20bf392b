"""Parts shared by microfacet models: shapes of distributions, reflection of GGX facets, and sampling.

Slot SHAPE of such a model is the shape of its distribution of normals (`kernels/microfacet`).
"""

from typing import NamedTuple

import warp as wp

from wrt.kernels.core.bsdf import Bsdf, BsdfSample, no_sample
from wrt.kernels.core.specialise import specialised
from wrt.kernels.microfacet import BUMPY, LEAST_ALPHA, bumpy_ggx, ggx
from wrt.kernels.microfacet.bumpy_ggx import BumpyShape, bumpy_shape, rough_as_bumpy
from wrt.kernels.microfacet.widening import WIDENED, not_widened, widened_evenly

SHAPE = wp.constant(0)

BY_ALPHA = ("ggx", "beckmann", "blinn-phong")
ISOTROPIC = ("blinn-phong",)


@wp.func
def mirrored(wo: wp.vec3, m: wp.vec3) -> wp.vec3:
    """Return the direction that a facet reflects to wo; zero if it is below the surface."""
    wi = wp.normalize(m * (2.0 * wp.dot(wo, m)) - wo)
    return wp.where(wi[2] > 0.0, wi, wp.vec3(0.0))


@specialised()
def make_facet_response(bumpy: bool) -> wp.Function:
    """Return the device function (wo, wi, shape) -> vec2 for reflection by GGX, or by its facets on bumps.

    The two numbers are D G cosθi / (4 cosθo cosθi) and the density of reflection by visible normals. With
    G = 1 / (1 + Λo + Λi) and the areas P = cosθ (1 + Λ) the first is D cosθi / (4 (Po cosθi + cosθo Pi − cosθo cosθi)),
    finite at grazing angles. The second is D / (4 Po).
    """
    distribution, shape_type = (bumpy_ggx, BumpyShape) if bumpy else (ggx, wp.vec3)

    @wp.func
    def facet_response(wo: wp.vec3, wi: wp.vec3, shape: shape_type) -> wp.vec2:
        d = distribution.d(wp.normalize(wo + wi), shape)
        area_o = distribution.projected_area(wo, shape)
        area_i = distribution.projected_area(wi, shape)
        # P ≥ cosθ: the sum is at least Po cosθi.
        area = wp.max(area_o * wi[2] + wo[2] * (area_i - wi[2]), 1.0e-30)
        return wp.vec2(0.25 * d * (wi[2] / area), 0.25 * d / area_o)

    return facet_response


class RoundShapes(NamedTuple):
    """Device functions for the shape of isotropic facets of roughness alpha under a filtered normal map.

    Attributes:
        as_rough: (alpha, normal_variance) -> vec3, the shape of GGX that loses about as much energy.
        of_normals: (alpha, as_rough) -> the shape of the distribution: `as_rough`, or a `BumpyShape`.
    """

    as_rough: wp.Function
    of_normals: wp.Function


@specialised()
def make_round_shapes(bumpy: bool) -> RoundShapes:
    """Return the functions for facets that a filtered normal map widens, or puts on bumps."""

    @wp.func
    def as_rough(alpha: float, variance: wp.vec2) -> wp.vec3:
        shape = wp.vec3(alpha, alpha, 0.0)
        if wp.static(bumpy):
            shape = rough_as_bumpy(shape, wp.vec2(0.5 * (variance[0] + variance[1])))
        else:
            shape = widened_evenly(shape, variance)
        return shape

    return RoundShapes(as_rough, _on_bumps if bumpy else _same_shape)


@wp.func
def _on_bumps(alpha: float, as_rough: wp.vec3) -> BumpyShape:
    return bumpy_shape(wp.vec3(alpha, alpha, 0.0), as_rough)


@wp.func
def _same_shape(alpha: float, as_rough: wp.vec3) -> wp.vec3:
    return as_rough


def is_widened(distribution: str) -> bool:
    """Return whether variance of slopes makes a distribution rougher."""
    return distribution == BUMPY or distribution in WIDENED


@wp.func
def _bumpy_shape_of(bsdf: Bsdf) -> BumpyShape:
    shape = bsdf.slots[SHAPE]
    alpha = wp.vec3(wp.clamp(shape[0], LEAST_ALPHA, 1.0), wp.clamp(shape[1], LEAST_ALPHA, 1.0), 0.0)
    return bumpy_shape(alpha, rough_as_bumpy(alpha, bsdf.normal_variance))


@specialised()
def make_shape_of(distribution: str) -> wp.Function:
    """Return the device function bsdf -> shape of the distribution, clamped, and widened by a filtered normal map.

    It is a vec3, for BUMPY a `BumpyShape`.
    """
    if distribution == BUMPY:
        return _bumpy_shape_of
    by_alpha = distribution in BY_ALPHA
    isotropic = distribution in ISOTROPIC
    widened = WIDENED.get(distribution, not_widened)

    @wp.func
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


@specialised()
def make_alpha_of(distribution: str) -> wp.Function:
    """Return the device function bsdf -> roughness, the geometric mean along x and y."""
    shape_of = make_shape_of(distribution)

    @wp.func
    def alpha_of(bsdf: Bsdf) -> float:
        shape = shape_of(bsdf)
        return wp.sqrt(shape[0] * shape[1])

    return alpha_of


@specialised()
def make_sample(evaluate: wp.Function, pdf: wp.Function, direction: wp.Function) -> wp.Function:
    """Return a model's `sample` from a function (bsdf, wo, u, u_lobe) -> wi, which is zero for no direction.

    Value and density are evaluated for the direction, not for the sampled normal: at a roughness of 1e-4 the two differ
    by float32 rounding, and the renderer evaluates both again.

    Args:
        evaluate: the model's.
        pdf: the model's; 0 for a zero direction.
        direction: samples that density.
    """

    @wp.func
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
