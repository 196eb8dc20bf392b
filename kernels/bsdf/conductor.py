"""Metals: mirrors weighted by Fresnel's reflectance, smooth or made of microfacets, with a thin film on them or not.

A rough metal has f = F D G / (4 cosθi cosθo): Torrance and Sparrow 1967; Cook and Torrance 1982; Walter et al. 2007,
eq. 20. Optionally its facets reflect several times (`kernels/bsdf/lobes/albedo.py`).
"""

import warp as wp

from wrt.kernels.bsdf.lobes.albedo import (
    average_missing_energy,
    missing_energy,
    multiple_bounce_fresnel,
    multiple_bounce_lobe,
    multiple_bounces_pdf,
    sample_multiple_bounces,
)
from wrt.kernels.bsdf.lobes.facets import is_widened, make_alpha_of, make_sample, make_shape_of, mirrored
from wrt.kernels.bsdf.lobes.fresnel import fresnel_conductor, fresnel_schlick
from wrt.kernels.bsdf.lobes.thin_film import filmed_conductor, filmed_schlick
from wrt.kernels.core.bsdf import (
    Bsdf,
    BsdfSample,
    Model,
    SpecularLobes,
    mirror_lobe,
    mirror_sample,
    zero_evaluate,
    zero_pdf,
)
from wrt.kernels.core.specialise import specialised
from wrt.kernels.microfacet import make_microfacet

ROWS_OF_FRESNEL = {"conductor": 2, "schlick": 1}

# --- Smooth ----------------------------------------------------------------------------------------


@specialised()
def make_reflectance(fresnel: str, filmed: bool, first: int) -> wp.Function:
    """Return the device function (bsdf, cos_i) -> vec3, the reflectance of a metal.

    Its values are in the rows from `first` on: real and imaginary part of the index ("conductor"), or the reflectance
    at normal incidence ("schlick"); then, of a film, its thickness, nm, and its index.
    """
    film = first + ROWS_OF_FRESNEL[fresnel]

    @wp.func
    def of_reflectance(bsdf: Bsdf, cos_i: float) -> wp.vec3:
        f0 = bsdf.slots[wp.static(first)]
        if wp.static(filmed):
            found = filmed_schlick(cos_i, f0, bsdf.slots[wp.static(film)][0], bsdf.slots[wp.static(film + 1)][0])
        else:
            found = fresnel_schlick(cos_i, f0)
        return found

    @wp.func
    def of_index(bsdf: Bsdf, cos_i: float) -> wp.vec3:
        eta = bsdf.slots[wp.static(first)]
        k = bsdf.slots[wp.static(first + 1)]
        if wp.static(filmed):
            thickness = bsdf.slots[wp.static(film)][0]
            found = filmed_conductor(cos_i, eta, k, thickness, bsdf.slots[wp.static(film + 1)][0])
        else:
            found = fresnel_conductor(cos_i, eta, k)
        return found

    return of_reflectance if fresnel == "schlick" else of_index


@specialised()
def make_conductor(*options: str) -> Model:
    """Return the model with exact Fresnel equations, or Schlick's approximation ("schlick"), and a "film" or none.

    Raises:
        ValueError: for other options.
    """
    if options not in ((), ("schlick",), ("film",), ("schlick", "film")):
        raise ValueError(f"no conductor of {options!r}")
    fresnel = "schlick" if "schlick" in options else "conductor"
    slots = ROWS_OF_FRESNEL[fresnel] + (2 if "film" in options else 0)
    return _make_mirror(make_reflectance(fresnel, "film" in options, 0), slots)


@wp.func
def _same_reflectance(bsdf: Bsdf, cos_i: float) -> wp.vec3:
    return bsdf.slots[0]


@specialised()
def make_mirror() -> Model:
    """Return the model of an ideal mirror, whose reflectance is the same at every angle."""
    return _make_mirror(_same_reflectance, 1)


def _make_mirror(reflectance: wp.Function, slots: int) -> Model:
    """Return the model of a smooth surface that reflects only, by a function (bsdf, cos_i) -> vec3."""

    @wp.func
    def sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
        return mirror_sample(wo, reflectance(bsdf, wo[2]))

    @wp.func
    def specular(bsdf: Bsdf, wo: wp.vec3) -> SpecularLobes:
        return mirror_lobe(reflectance(bsdf, wo[2]))

    return Model(zero_evaluate, zero_pdf, sample, slots=slots, delta=True, specular=specular)


# --- Rough -----------------------------------------------------------------------------------------

# Row 0 is the shape of the distribution: see facets.py. Fresnel's rows follow the next one.
REFLECTANCE = wp.constant(1)  # factor of Fresnel's reflectance
F0 = wp.constant(2)  # of "schlick"
AVERAGE = wp.constant(4)  # of "conductor" with multiple bounces: mean reflectance over the hemisphere, 2 ∫ F μ dμ

BOUNCES = ("single", "multiple", "film")


@wp.func
def _average_conductor(bsdf: Bsdf) -> wp.vec3:
    return wp.cw_mul(bsdf.slots[REFLECTANCE], bsdf.slots[AVERAGE])


@wp.func
def _average_schlick(bsdf: Bsdf) -> wp.vec3:
    # 2 ∫ (F0 + (1 − F0)(1 − μ)⁵) μ dμ = F0 + (1 − F0) / 21
    f0 = bsdf.slots[F0]
    return wp.cw_mul(bsdf.slots[REFLECTANCE], f0 + (wp.vec3(1.0) - f0) / 21.0)


@specialised()
def make_rough_conductor(distribution: str, masking: str, fresnel: str, bounces: str = "single") -> Model:
    """Return the model of a rough metal.

    Args:
        distribution: a name in `kernels.microfacet.DISTRIBUTIONS`, or BUMPY.
        masking: a name in `kernels.microfacet.MASKINGS` that goes with it.
        fresnel: "conductor" with a complex index η + ik, or "schlick" with the reflectance at normal incidence.
        bounces: "single"; "multiple", with which a white surface reflects all light; or "film", single with a film.

    Raises:
        ValueError: if a name is unknown, or distribution and masking do not go together.
    """
    if fresnel not in ROWS_OF_FRESNEL or bounces not in BOUNCES:
        raise ValueError(f"no rough conductor of {fresnel!r} and {bounces!r} bounces")
    facet, shape_of = make_microfacet(distribution, masking), make_shape_of(distribution)
    reflectance = make_reflectance(fresnel, bounces == "film", 2)

    @wp.func
    def evaluate_single(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
        if wi[2] <= 0.0 or wo[2] <= 0.0:
            return wp.vec3(0.0)
        shape = shape_of(bsdf)
        m = wp.normalize(wo + wi)
        # Do not cancel cosθo against the cosine in G: both may be close to zero.
        value = facet.d(m, shape) * facet.g(wo, wi, m, shape) / (4.0 * wp.max(wo[2], 1.0e-15))
        return wp.cw_mul(bsdf.slots[REFLECTANCE], reflectance(bsdf, wp.min(wp.dot(wo, m), 1.0))) * value

    @wp.func
    def pdf_single(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
        if wi[2] <= 0.0 or wo[2] <= 0.0:
            return 0.0
        m = wp.normalize(wo + wi)
        # dω_m / dω_i = 1 / (4 wo·m): Walter et al. 2007, eq. 14.
        return facet.normal_pdf(wo, m, shape_of(bsdf)) / (4.0 * wp.max(wp.dot(wo, m), 1.0e-15))

    @wp.func
    def direction_single(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> wp.vec3:
        return mirrored(wo, facet.sample_normal(wo, shape_of(bsdf), u))

    evaluate, pdf, direction = evaluate_single, pdf_single, direction_single
    slots = 2 + ROWS_OF_FRESNEL[fresnel] + (2 if bounces == "film" else 0)
    if bounces == "multiple":
        average = _average_schlick
        if fresnel == "conductor":
            average, slots = _average_conductor, slots + 1
        evaluate, pdf, direction = _with_multiple_bounces(
            make_alpha_of(distribution), average, evaluate_single, pdf_single, direction_single
        )
    sample = make_sample(evaluate, pdf, direction)
    return Model(evaluate, pdf, sample, slots=slots, widens=is_widened(distribution))


def _with_multiple_bounces(
    alpha_of: wp.Function,
    average: wp.Function,
    evaluate_single: wp.Function,
    pdf_single: wp.Function,
    direction_single: wp.Function,
) -> tuple[wp.Function, wp.Function, wp.Function]:
    """Return the functions of a single-bounce model with the lobe of all further bounces added.

    The lobe is sampled in proportion to its share of a white surface's reflection, 1 − E(wo).
    """

    @wp.func
    def missing(bsdf: Bsdf, w: wp.vec3) -> float:
        return missing_energy(bsdf.tables, bsdf.table, w, alpha_of(bsdf))

    @wp.func
    def evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
        if wi[2] <= 0.0 or wo[2] <= 0.0:
            return wp.vec3(0.0)
        missing_average = average_missing_energy(bsdf.tables, bsdf.table, alpha_of(bsdf))
        lobe = multiple_bounce_lobe(missing(bsdf, wo), missing(bsdf, wi), missing_average) * wi[2]
        return evaluate_single(bsdf, wo, wi) + multiple_bounce_fresnel(average(bsdf), missing_average) * lobe

    @wp.func
    def pdf(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
        if wi[2] <= 0.0 or wo[2] <= 0.0:
            return 0.0
        share = missing(bsdf, wo)
        density = multiple_bounces_pdf(bsdf.tables, bsdf.table, wi, alpha_of(bsdf))
        return (1.0 - share) * pdf_single(bsdf, wo, wi) + share * density

    @wp.func
    def direction(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> wp.vec3:
        if u_lobe < missing(bsdf, wo):
            return sample_multiple_bounces(bsdf.tables, bsdf.table, alpha_of(bsdf), u)
        return direction_single(bsdf, wo, u, u_lobe)

    return evaluate, pdf, direction
