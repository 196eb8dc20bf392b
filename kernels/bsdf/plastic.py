"""Plastic: a diffuse base under a smooth or rough transparent coat with inner reflections.

The coat reflects light or refracts it to the base, which reflects it diffusely; from below, the coat transmits it or
reflects it back to the base, any number of times. The geometric series is

    f = ρ/π T(θo) T(θi) / (η² (1 − R ρ)),    T = 1 − F,    R = 2 ∫ F_inside cosθ d cosθ

(Wolff 1994, "Diffuse-reflectance model for smooth dielectric surfaces"; its series is that of Saunderson 1942,
"Calculation of the color of pigmented plastics"). The division by η² is the spreading of radiance at the exit.
As 1 − R = (1 − R_outside) / η², a white base absorbs nothing. Without the nonlinear colour shift the denominator is
1 − R, as for a white base, and the albedo is ρ T(θo).

A rough coat adds a microfacet reflection F D G / (4 cosθo cosθi) in place of the mirror (Walter, Marschner, Li and
Torrance 2007), and T and R come from tables (`kernels/bsdf/lobes/coat_transmittance.py`). Light that it refracts to the
base is assumed to lose its direction there.
"""

import warp as wp

from wrt.kernels.bsdf.lobes.coat_transmittance import (
    coat_column,
    coat_internal_reflectance,
    coat_transmittance,
    transmitted,
)
from wrt.kernels.bsdf.lobes.facets import make_round_shapes, make_sample, mirrored
from wrt.kernels.core.bsdf import Bsdf, BsdfSample, Model, SpecularLobes, mirror_lobe, mirror_sample, no_sample
from wrt.kernels.core.specialise import specialised
from wrt.kernels.microfacet import BUMPY, LEAST_ALPHA, make_microfacet
from wrt.kernels.sampling.warps import INV_PI, square_to_cosine_hemisphere

REFLECTANCE = wp.constant(0)  # of the base
SPECULAR = wp.constant(1)  # factor of light reflected by the coat
IOR = wp.constant(2)  # n of the coat / n outside
INTERNAL = wp.constant(3)  # of a smooth coat: R, its reflectance for diffuse light from below
ALPHA = wp.constant(3)  # of a rough coat
NONLINEAR = wp.constant(4)  # 1 if inner reflections shift colours, else 0


@wp.func
def base_reflectance(rho: wp.vec3, internal: float, nonlinear: float) -> wp.vec3:
    """Return the base's reflectance with all inner reflections, ρ / (1 − R ρ), or ρ / (1 − R) if `nonlinear` is 0."""
    one = wp.vec3(1.0)
    return wp.cw_div(rho, one - (one + (rho - one) * nonlinear) * internal)


@wp.func
def base_value(bsdf: Bsdf, internal: float, cos_i: float, let_in_o: float, let_in_i: float) -> wp.vec3:
    """Return f cosθi of the base, from R and T of the coat for both directions."""
    eta = bsdf.slots[IOR][0]
    base = base_reflectance(bsdf.slots[REFLECTANCE], internal, bsdf.slots[NONLINEAR][0])
    return base * (INV_PI * cos_i * let_in_o * let_in_i / (eta * eta))


@wp.func
def mean(color: wp.vec3) -> float:
    """Return the mean of three channels."""
    return (color[0] + color[1] + color[2]) / 3.0


@wp.func
def base_share(bsdf: Bsdf, let_in: float) -> float:
    """Return the probability of sampling the base, from the share of light that the coat lets in.

    It leaves inner reflections out; without the nonlinear colour shift it is exact.
    """
    base = let_in * mean(bsdf.slots[REFLECTANCE])
    return base / wp.max(base + (1.0 - let_in) * mean(bsdf.slots[SPECULAR]), 1.0e-20)


# --- Smooth ----------------------------------------------------------------------------------------


@wp.func
def _evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
    """Return f |cosθi| of the base."""
    if wi[2] <= 0.0:
        return wp.vec3(0.0)
    eta = bsdf.slots[IOR][0]
    return base_value(bsdf, bsdf.slots[INTERNAL][0], wi[2], transmitted(wo[2], eta), transmitted(wi[2], eta))


@wp.func
def _pdf(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
    if wi[2] <= 0.0:
        return 0.0
    return base_share(bsdf, transmitted(wo[2], bsdf.slots[IOR][0])) * INV_PI * wi[2]


@wp.func
def _sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    let_in = transmitted(wo[2], bsdf.slots[IOR][0])
    share = base_share(bsdf, let_in)
    if u_lobe >= share:
        return mirror_sample(wo, bsdf.slots[SPECULAR] * ((1.0 - let_in) / (1.0 - share)))
    s = no_sample()
    s.wi = square_to_cosine_hemisphere(u)
    s.pdf = share * INV_PI * s.wi[2]
    if s.pdf > 0.0:
        s.weight = _evaluate(bsdf, wo, s.wi) / s.pdf
    return s


@wp.func
def _specular(bsdf: Bsdf, wo: wp.vec3) -> SpecularLobes:
    return mirror_lobe(bsdf.slots[SPECULAR] * (1.0 - transmitted(wo[2], bsdf.slots[IOR][0])))


PLASTIC = Model(_evaluate, _pdf, _sample, slots=5, specular=_specular)


# --- Rough -----------------------------------------------------------------------------------------


@wp.func
def alpha_of(bsdf: Bsdf) -> float:
    """Return the roughness of the coat, clamped."""
    return wp.clamp(bsdf.slots[ALPHA][0], LEAST_ALPHA, 1.0)


@wp.func
def let_in_at(bsdf: Bsdf, w: wp.vec3, column: float) -> float:
    """Return the share of light from w that reaches the base, from the table's column."""
    return coat_transmittance(bsdf.tables, bsdf.table, w[2], column)


@specialised()
def make_rough_plastic(distribution: str, masking: str) -> Model:
    """Return the model for a masking and a distribution of normals with a roughness α (see kernels/microfacet).

    Raises:
        ValueError: if they do not go together.
    """
    facet, shapes = make_microfacet(distribution, masking), make_round_shapes(distribution == BUMPY)

    @wp.func
    def shape_of(bsdf: Bsdf) -> wp.vec3:
        return shapes.as_rough(alpha_of(bsdf), bsdf.normal_variance)

    @wp.func
    def evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
        if wi[2] <= 0.0 or wo[2] <= 0.0:
            return wp.vec3(0.0)
        rough = shape_of(bsdf)
        shape = shapes.of_normals(alpha_of(bsdf), rough)
        h = wo + wi
        m = wp.normalize(h)
        # wo·m = wi·m = |wo + wi| / 2, bit for bit the same when light and viewer are swapped.
        reflected = 1.0 - transmitted(wp.min(0.5 * wp.length(h), 1.0), bsdf.slots[IOR][0])
        coat = reflected * facet.d(m, shape) * facet.g(wo, wi, m, shape) / (4.0 * wp.max(wo[2], 1.0e-15))
        column = coat_column(bsdf.tables, bsdf.table, rough[0])
        internal = coat_internal_reflectance(bsdf.tables, bsdf.table, column)
        base = base_value(bsdf, internal, wi[2], let_in_at(bsdf, wo, column), let_in_at(bsdf, wi, column))
        return bsdf.slots[SPECULAR] * coat + base

    @wp.func
    def pdf(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
        if wi[2] <= 0.0 or wo[2] <= 0.0:
            return 0.0
        rough = shape_of(bsdf)
        share = base_share(bsdf, let_in_at(bsdf, wo, coat_column(bsdf.tables, bsdf.table, rough[0])))
        m = wp.normalize(wo + wi)
        # dω_m / dω_i = 1 / (4 wo·m): Walter et al. 2007, eq. 14.
        coat = facet.normal_pdf(wo, m, shapes.of_normals(alpha_of(bsdf), rough)) / (
            4.0 * wp.max(wp.dot(wo, m), 1.0e-15)
        )
        return share * INV_PI * wi[2] + (1.0 - share) * coat

    @wp.func
    def direction(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> wp.vec3:
        rough = shape_of(bsdf)
        if u_lobe < base_share(bsdf, let_in_at(bsdf, wo, coat_column(bsdf.tables, bsdf.table, rough[0]))):
            return square_to_cosine_hemisphere(u)
        return mirrored(wo, facet.sample_normal(wo, shapes.of_normals(alpha_of(bsdf), rough), u))

    sample = make_sample(evaluate, pdf, direction)
    return Model(evaluate, pdf, sample, slots=5, widens=True)
