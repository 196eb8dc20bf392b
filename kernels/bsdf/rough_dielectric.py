"""A rough boundary between two transparent media, whose microfacets reflect and refract.

Walter, Marschner, Li and Torrance, "Microfacet models for refraction through rough surfaces" (2007); the equations
below are theirs. Sample a normal m for the viewer; Fresnel's equations at m choose between reflection and refraction.
Light comes from wi, where it was refracted in the medium of index n_t, and goes to wo, in that of n_i; eta = n_t / n_i.
Radiance is scaled by (n_i / n_t)² on refraction, as in `kernels/bsdf/dielectric.py` and in eq. 21. Optionally with
multiple bounces between facets (`kernels/bsdf/lobes/albedo_dielectric.py`).

With equal indices nothing is refracted, and half vectors degenerate. If the indices agree within INDEX_MATCHED, light
passes straight through.
"""

import warp as wp

from wrt.kernels.bsdf.dielectric import seen_from
from wrt.kernels.bsdf.lobes.albedo import missing_energy
from wrt.kernels.bsdf.lobes.albedo_dielectric import (
    DIELECTRIC_TABLE_SIZE,
    dielectric_lobes,
    dielectric_lobes_pdf,
    sample_dielectric_lobes,
    side_table,
)
from wrt.kernels.bsdf.lobes.dispersion import dispersive
from wrt.kernels.bsdf.lobes.facets import is_widened, make_alpha_of, make_sample, make_shape_of, mirrored
from wrt.kernels.bsdf.lobes.fresnel import fresnel_dielectric, refracted_by
from wrt.kernels.core.bsdf import Bsdf, BsdfSample, Model, delta_sample
from wrt.kernels.core.specialise import specialised
from wrt.kernels.microfacet import make_microfacet
from wrt.kernels.sampling.warps import BELOW_ONE

# Slot 0 is the shape of the distribution: see facets.py.
IOR = wp.constant(1)  # n_inside / n_outside
REFLECTANCE = wp.constant(2)  # factor of reflected light
TRANSMITTANCE = wp.constant(3)  # factor of refracted light
CHANNELS = 4  # of dispersion only: probabilities of the channels

INDEX_MATCHED = wp.constant(1.0e-3)
"""|eta − 1| below which a boundary is ignored. Half vectors lose digits as 1 / |eta − 1|. Such a boundary reflects at
most 2.5e-7 of the light at normal incidence and 1 % up to 86 degrees, and bends it by less than 0.06 degrees per unit
of slope."""

OPTIONS = ((), ("multiple",), ("dispersive",), ("multiple", "dispersive"))


@wp.func
def is_matched(eta: float) -> bool:
    """Return whether the two indices are practically the same."""
    return wp.abs(eta - 1.0) < INDEX_MATCHED


@wp.func
def facet_normal(wo: wp.vec3, wi: wp.vec3, eta: float) -> wp.vec3:
    """Return the normal of the facets that send light from wi to wo; zero if there are none.

    It belongs to reflection (eq. 13) or, if wi is below the surface, to refraction (eq. 16). Each direction must be on
    the same side of the facet as of the surface.
    """
    m = wp.normalize(wo + wi * wp.where(wi[2] > 0.0, 1.0, eta))
    m = wp.where(m[2] < 0.0, -m, m)
    if wo[2] <= 0.0 or wp.dot(wo, m) <= 0.0 or wp.dot(wi, m) * wi[2] <= 0.0:
        return wp.vec3(0.0)
    return m


@wp.func
def cosine_to(m: wp.vec3, wo: wp.vec3, wi: wp.vec3) -> float:
    """Return the cosine of wo to the facet; for reflection the mean with that of wi, which differs by rounding only."""
    cos_o = wp.dot(wo, m)
    if wi[2] > 0.0:
        return 0.5 * (cos_o + wp.dot(wi, m))
    return cos_o


@wp.func
def transmittance(cos_o: float, cos_i: float, eta: float) -> float:
    """Return 1 − F for positive cosines on both sides: precise when small, and the same from both sides.

    (T_s + T_p) / 2 (Born and Wolf, 1.5.3), where each is 4 n n' cosθ cosθ' over the square of a sum.
    """
    s = cos_o + eta * cos_i
    p = eta * cos_o + cos_i
    return 2.0 * eta * cos_o * cos_i * (1.0 / (s * s) + 1.0 / (p * p))


@wp.func
def refraction_density(cos_o: float, cos_i: float, eta: float) -> float:
    """Return dω_m / dω_i of refraction, eta² cosθi / (cosθo − eta cosθi)² (eq. 17), for positive cosines to m.

    By Snell's law the root of the denominator is (1 − eta²) / (cosθo + eta cosθi), which does not cancel.
    """
    root = eta * (cos_o + eta * cos_i) / ((1.0 - eta) * (1.0 + eta))
    return root * root * cos_i


@specialised()
def make_rough_dielectric(distribution: str, masking: str, *options: str) -> Model:
    """Return the model of a rough dielectric.

    Args:
        distribution: a name in `kernels.microfacet.DISTRIBUTIONS`, or BUMPY.
        masking: a name in `kernels.microfacet.MASKINGS` that goes with it.
        options: "multiple" for multiple bounces, with which no light is lost; "dispersive" for an index and a table for
            each channel.

    Raises:
        ValueError: if a name is unknown, or distribution and masking do not go together.
    """
    if options not in OPTIONS:
        raise ValueError(f"no rough dielectric of {options!r}")
    facet, shape_of = make_microfacet(distribution, masking), make_shape_of(distribution)

    @wp.func
    def evaluate_single(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
        eta = seen_from(bsdf.slots[IOR][0], bsdf.front)
        m = facet_normal(wo, wi, eta)
        cos_o = cosine_to(m, wo, wi)
        if cos_o <= 0.0 or is_matched(eta):
            return wp.vec3(0.0)
        shape = shape_of(bsdf)
        # Do not cancel cosθo against the cosine in G: both may be close to zero.
        value = facet.d(m, shape) * facet.g(wo, wi, m, shape) / wp.max(wo[2], 1.0e-15)
        if wi[2] > 0.0:
            return bsdf.slots[REFLECTANCE] * (0.25 * fresnel_dielectric(cos_o, eta) * value)  # eq. 20
        cos_i = -wp.dot(wi, m)
        scale = transmittance(cos_o, cos_i, eta) * cos_o * refraction_density(cos_o, cos_i, eta) / (eta * eta)
        return bsdf.slots[TRANSMITTANCE] * (scale * value)  # eq. 21

    @wp.func
    def pdf_single(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
        eta = seen_from(bsdf.slots[IOR][0], bsdf.front)
        m = facet_normal(wo, wi, eta)
        cos_o = cosine_to(m, wo, wi)
        if cos_o <= 0.0 or is_matched(eta):
            return 0.0
        density = facet.normal_pdf(wo, m, shape_of(bsdf))
        if wi[2] > 0.0:
            return fresnel_dielectric(cos_o, eta) * density / (4.0 * cos_o)  # eq. 14 and 38
        cos_i = -wp.dot(wi, m)
        return transmittance(cos_o, cos_i, eta) * density * refraction_density(cos_o, cos_i, eta)  # eq. 17 and 38

    @wp.func
    def direction_single(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> wp.vec3:
        eta = seen_from(bsdf.slots[IOR][0], bsdf.front)
        m = facet.sample_normal(wo, shape_of(bsdf), u)
        cos_o = wp.dot(wo, m)
        if cos_o <= 0.0:
            return wp.vec3(0.0)
        if u_lobe < fresnel_dielectric(cos_o, eta):
            return mirrored(wo, m)  # eq. 39; zero if below the surface, where it cannot be refraction
        wi = refracted_by(m, wo, cos_o, eta)
        return wp.where(wi[2] < 0.0, wp.normalize(wi), wp.vec3(0.0))

    evaluate, pdf, direction = evaluate_single, pdf_single, direction_single
    if "multiple" in options:
        evaluate, pdf, direction = _with_multiple_bounces(
            make_alpha_of(distribution), evaluate_single, pdf_single, direction_single
        )
    sample = _or_straight_on(make_sample(evaluate, pdf, direction))
    model = Model(evaluate, pdf, sample, slots=4, transmits=True, widens=is_widened(distribution), index_slot=int(IOR))
    return dispersive(model, CHANNELS, DIELECTRIC_TABLE_SIZE) if "dispersive" in options else model


def _or_straight_on(sample_facets: wp.Function) -> wp.Function:
    """Return the sampling of the facets or, if the indices match, of the direction straight on."""

    @wp.func
    def sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
        eta = seen_from(bsdf.slots[IOR][0], bsdf.front)
        if is_matched(eta):
            return delta_sample(-wo, bsdf.slots[TRANSMITTANCE])
        found = sample_facets(bsdf, wo, u, u_lobe)
        if found.wi[2] < 0.0:
            found.eta = eta
        return found

    return sample


def _with_multiple_bounces(
    alpha_of: wp.Function, evaluate_single: wp.Function, pdf_single: wp.Function, direction_single: wp.Function
) -> tuple[wp.Function, wp.Function, wp.Function]:
    """Return the functions of a single-bounce model with the lobes of all further bounces added.

    They are sampled in proportion to their share of the light, 1 − E(wo).
    """

    @wp.func
    def missing(bsdf: Bsdf, wo: wp.vec3) -> float:
        return missing_energy(bsdf.tables, side_table(bsdf.table, bsdf.front), wo, alpha_of(bsdf))

    @wp.func
    def evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
        eta = seen_from(bsdf.slots[IOR][0], bsdf.front)
        if wo[2] <= 0.0 or wi[2] == 0.0 or is_matched(eta):
            return wp.vec3(0.0)
        lobes = dielectric_lobes(bsdf.tables, bsdf.table, bsdf.front, wo, wi, alpha_of(bsdf))
        further = bsdf.slots[REFLECTANCE] * lobes
        if wi[2] < 0.0:
            further = bsdf.slots[TRANSMITTANCE] * (lobes / (eta * eta))
        return evaluate_single(bsdf, wo, wi) + further

    @wp.func
    def pdf(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
        if wo[2] <= 0.0 or wi[2] == 0.0 or is_matched(seen_from(bsdf.slots[IOR][0], bsdf.front)):
            return 0.0
        further = missing(bsdf, wo)
        density = dielectric_lobes_pdf(bsdf.tables, bsdf.table, bsdf.front, wi, alpha_of(bsdf))
        return (1.0 - further) * pdf_single(bsdf, wo, wi) + further * density

    @wp.func
    def direction(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> wp.vec3:
        further = missing(bsdf, wo)
        if u_lobe < further:
            return sample_dielectric_lobes(bsdf.tables, bsdf.table, bsdf.front, alpha_of(bsdf), u, u_lobe / further)
        return direction_single(bsdf, wo, u, wp.min((u_lobe - further) / (1.0 - further), BELOW_ONE))

    return evaluate, pdf, direction
