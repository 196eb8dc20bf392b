"""Rough plastic: a diffuse base under a rough transparent coat with inner reflections.

The model of kernels/bsdf/plastic.py with a microfacet reflection (Walter, Marschner, Li and Torrance 2007) in place of
the mirror, and tables (kernels/bsdf/lobes/coat_transmittance.py) in place of Fresnel's transmittance:

    f = F D G / (4 cosθo cosθi) + ρ/π T(θo) T(θi) / (η² (1 − R ρ)).

Light that the rough coat refracts to the base is assumed to lose its direction there.
"""

import warp as wp

from wrt.kernels.bsdf.lobes.coat_transmittance import (
    coat_column,
    coat_internal_reflectance,
    coat_transmittance,
    transmitted,
)
from wrt.kernels.bsdf.lobes.facets import make_sample, mirrored
from wrt.kernels.bsdf.plastic import base_reflectance, base_share
from wrt.kernels.bsdf.record import Bsdf, Model
from wrt.kernels.microfacet import BUMPY, LEAST_ALPHA, make_microfacet
from wrt.kernels.microfacet.bumpy_ggx import BumpyShape, bumpy_shape, rough_as_bumpy
from wrt.kernels.microfacet.widening import widened_evenly
from wrt.kernels.sampling.warps import INV_PI, square_to_cosine_hemisphere
from wrt.kernels.specialise import specialised

# The first two rows agree with plastic.py, for `base_share`.
REFLECTANCE = wp.constant(0)  # of the base
SPECULAR = wp.constant(1)  # factor of light reflected by the coat
IOR = wp.constant(2)  # n of the coat / n outside
ALPHA = wp.constant(3)
NONLINEAR = wp.constant(4)  # 1 if inner reflections shift colours, else 0


@wp.func
def coat_shape(bsdf: Bsdf) -> wp.vec3:
    """Return the shape of the distribution of normals, widened by a filtered normal map."""
    alpha = wp.clamp(bsdf.slots[ALPHA][0], LEAST_ALPHA, 1.0)
    return widened_evenly(wp.vec3(alpha, alpha, 0.0), bsdf.normal_variance)


@wp.func
def rough_as_bumpy_coat(bsdf: Bsdf) -> wp.vec3:
    """Return the same where a filtered normal map puts GGX on bumps."""
    alpha = wp.clamp(bsdf.slots[ALPHA][0], LEAST_ALPHA, 1.0)
    variance = 0.5 * (bsdf.normal_variance[0] + bsdf.normal_variance[1])
    return rough_as_bumpy(wp.vec3(alpha, alpha, 0.0), wp.vec2(variance))


@wp.func
def bumpy_coat_shape(bsdf: Bsdf) -> BumpyShape:
    """Return the distribution of normals of GGX on bumps."""
    alpha = wp.clamp(bsdf.slots[ALPHA][0], LEAST_ALPHA, 1.0)
    return bumpy_shape(wp.vec3(alpha, alpha, 0.0), rough_as_bumpy_coat(bsdf))


@wp.func
def let_in(bsdf: Bsdf, w: wp.vec3, alpha: float) -> float:
    """Return the share of light from w that reaches the base."""
    return coat_transmittance(bsdf.tables, bsdf.table, w[2], coat_column(bsdf.tables, bsdf.table, alpha))


@wp.func
def base_value(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3, alpha: float) -> wp.vec3:
    """Return f cosθi of the base."""
    internal = coat_internal_reflectance(bsdf.tables, bsdf.table, coat_column(bsdf.tables, bsdf.table, alpha))
    base = base_reflectance(bsdf.slots[REFLECTANCE], internal, bsdf.slots[NONLINEAR][0])
    eta = bsdf.slots[IOR][0]
    return base * (INV_PI * wi[2] * let_in(bsdf, wo, alpha) * let_in(bsdf, wi, alpha) / (eta * eta))


@specialised()
def make_rough_plastic(distribution: str, masking: str) -> Model:
    """Return the model for a masking and a distribution of normals with a roughness α (see kernels/microfacet).

    Raises:
        ValueError: if they do not go together.
    """
    parts = make_microfacet(distribution, masking)
    d, g, sample_normal, normal_pdf = parts.d, parts.g, parts.sample_normal, parts.normal_pdf
    bumpy = distribution == BUMPY
    rough_coat_shape = rough_as_bumpy_coat if bumpy else coat_shape

    @wp.func
    def evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
        if wi[2] <= 0.0 or wo[2] <= 0.0:
            return wp.vec3(0.0)
        shape = rough_coat_shape(bsdf)
        h = wo + wi
        m = wp.normalize(h)
        # wo·m = wi·m = |wo + wi| / 2, bit for bit the same when light and viewer are swapped.
        reflected = 1.0 - transmitted(wp.min(0.5 * wp.length(h), 1.0), bsdf.slots[IOR][0])
        if wp.static(bumpy):
            mixture = bumpy_coat_shape(bsdf)
            coat = reflected * d(m, mixture) * g(wo, wi, m, mixture) / (4.0 * wp.max(wo[2], 1.0e-15))
        else:
            coat = reflected * d(m, shape) * g(wo, wi, m, shape) / (4.0 * wp.max(wo[2], 1.0e-15))
        return bsdf.slots[SPECULAR] * coat + base_value(bsdf, wo, wi, shape[0])

    @wp.func
    def pdf(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
        if wi[2] <= 0.0 or wo[2] <= 0.0:
            return 0.0
        shape = rough_coat_shape(bsdf)
        share = base_share(bsdf, let_in(bsdf, wo, shape[0]))
        m = wp.normalize(wo + wi)
        # dω_m / dω_i = 1 / (4 wo·m): Walter et al. 2007, eq. 14.
        if wp.static(bumpy):
            coat = normal_pdf(wo, m, bumpy_coat_shape(bsdf)) / (4.0 * wp.max(wp.dot(wo, m), 1.0e-15))
        else:
            coat = normal_pdf(wo, m, shape) / (4.0 * wp.max(wp.dot(wo, m), 1.0e-15))
        return share * INV_PI * wi[2] + (1.0 - share) * coat

    @wp.func
    def direction(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> wp.vec3:
        shape = rough_coat_shape(bsdf)
        if u_lobe < base_share(bsdf, let_in(bsdf, wo, shape[0])):
            return square_to_cosine_hemisphere(u)
        if wp.static(bumpy):
            m = sample_normal(wo, bumpy_coat_shape(bsdf), u)
        else:
            m = sample_normal(wo, shape, u)
        return mirrored(wo, m)

    sample = make_sample(evaluate, pdf, direction)
    return Model(evaluate, pdf, sample, slots=5, widens=True)
