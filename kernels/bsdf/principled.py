"""The metallic-roughness material of glTF, in a form that conserves energy and is reciprocal.

Khronos Group 2021, "glTF 2.0 Specification", appendix B, and KHR_materials_ior, _specular, _anisotropy, _transmission,
_volume (refraction), _clearcoat, _sheen; after Burley, "Physically based shading at Disney" (2012, 2015). Bottom up:

    metal       F(base_color, 1) D G / (4 cosθi cosθo),    F(f0, f90) = f0 + (f90 − f0)(1 − wo·m)⁵
    dielectric  F(f0, f90) D G / (4 cosθi cosθo) + base_color [(1 − t) diffuse + t (1 − F) refraction]
    base        metallic · metal + (1 − metallic) · dielectric
    sheen, coat on it (`kernels/bsdf/lobes/coats.py`)

with α = roughness², f0 = min(((ior − 1) / (ior + 1))² specular_color, 1) specular, f90 = specular, t = transmission.
Appendix B requires a BRDF to be positive, reciprocal and energy conserving, but its sample implementation is not. This
one differs from the sample:

- G is Smith's height-correlated form, which the appendix calls more accurate, not the product of both G1.
- Under the specular layer, diffuse = (1 − E(θo)) (1 − E(θi)) / (π (1 − E_avg)), where E is that layer's albedo, as the
  appendix recommends after Kulla and Conty (2017), instead of (1 − F(wo·m)) / π, which would reflect up to twice the
  light at grazing angles. A white dielectric reflects all light, less the overestimate of E in
  `kernels/bsdf/lobes/albedo_fits.py`.
- Coat and sheen leave the base min(1 − E(θo), 1 − E(θi)), where the sample's coat leaves 1 − F(θo).

The transmitting share t of a dielectric is a rough boundary (Walter et al. 2007) with Schlick's Fresnel on the side of
the lower index, so that it is the same both ways, and 1 under total internal reflection. The opaque share and metal
look the same from both sides. A thin sheet reflects as if it were opaque; its transmitted light has the directions of
reflected light, mirrored through the surface.
"""

from types import ModuleType
from typing import NamedTuple

import warp as wp

from wrt.kernels.bsdf.lobes.albedo import (
    average_missing_energy,
    missing_energy,
    multiple_bounce_fresnel,
    multiple_bounce_lobe,
)
from wrt.kernels.bsdf.lobes.albedo_fits import average_facet_albedo, facet_albedo
from wrt.kernels.bsdf.lobes.coats import Layer, Response, add_coat, add_sheen
from wrt.kernels.bsdf.lobes.dispersion import dispersive
from wrt.kernels.bsdf.lobes.facets import make_facet_response, mirrored
from wrt.kernels.bsdf.lobes.fresnel import refracted_by
from wrt.kernels.bsdf.lobes.principled_base import (
    FEATURE_ROWS,
    IOR,
    Base,
    average_schlick,
    film_on,
    make_base_of,
    make_cos_outside,
    make_shape_of,
    make_split,
    make_turned,
    rows_of,
    schlick_albedo,
    seen_index,
)
from wrt.kernels.bsdf.rough_dielectric import facet_normal, refraction_density
from wrt.kernels.core.bsdf import Bsdf, BsdfSample, Model, no_sample
from wrt.kernels.core.specialise import specialised
from wrt.kernels.microfacet import bumpy_ggx, ggx
from wrt.kernels.sampling.warps import INV_PI, lattice_point, square_to_cosine_hemisphere

FILM_FACETS = wp.constant(4)
FILM_CAUTION = wp.constant(0.15)
"""With FILM_FACETS facets, a film's albedo is known to this share of its change, which the layer below does not get."""


class _Energy(NamedTuple):
    """The energy balance at the facets, for a model with some features.

    Attributes:
        missing: (bsdf, base, w) -> the share of light that one bounce at white facets loses.
        bounced: (bsdf, base, average) -> the share of that which metal and opaque dielectric still reflect.
        shares: (bsdf, base, wo, white) -> the shares that facets reflect or transmit directly, and that are spread like
            a diffuse reflection.
    """

    missing: wp.Function
    bounced: wp.Function
    shares: wp.Function


@wp.func
def film_albedo(b: Base, w: wp.vec3, white: wp.vec2, facets: int, caution: float) -> wp.vec3:
    """Return the albedo of a dielectric's facets under a film, from that of white ones.

    A few visible facets stand for all. A share `caution` of what the film changes is added, times the root of the
    roughness.
    """
    plain = b.f0 * (white[0] - white[1]) + wp.vec3(b.f90 * white[1])
    up = wp.vec3(w[0], w[1], wp.max(wp.abs(w[2]), 1.0e-4))
    added = caution * wp.sqrt(wp.max(b.shape[0], b.shape[1]))
    change = wp.vec3(0.0)
    k = int(0)
    while k < facets:
        m = ggx.sample_normal(up, b.shape, lattice_point(k, facets))
        found = film_on(b, wp.dot(up, m), b.f0, b.f90)
        change += found + wp.vec3(wp.abs(found[0]), wp.abs(found[1]), wp.abs(found[2])) * added
        k += 1
    return plain + change * (white[0] / float(facets))


@wp.func
def average_film_albedo(b: Base, white: wp.vec2) -> wp.vec3:
    """Return the mean of that over the hemisphere, 2 ∫ E μ dμ, by Gauss's quadrature with three nodes."""
    average = wp.vec3(0.0)
    for node in range(3):
        mu = wp.where(node == 0, 0.2123405, wp.where(node == 1, 0.5905331, 0.9114120))
        weight = wp.where(node == 0, 0.1396540, wp.where(node == 1, 0.4584822, 0.4018638))
        average += film_albedo(b, wp.vec3(wp.sqrt(1.0 - mu * mu), 0.0, mu), white, 2, -FILM_CAUTION) * weight
    return average


@specialised()
def _make_energy(features: tuple[str, ...]) -> _Energy:
    body = "transmission" in features

    @wp.func
    def missing(bsdf: Bsdf, b: Base, w: wp.vec3) -> float:
        return missing_energy(bsdf.tables, bsdf.table, w, wp.sqrt(b.shape[0] * b.shape[1]))

    @wp.func
    def bounced(bsdf: Bsdf, b: Base, average: float) -> wp.vec3:
        metal = multiple_bounce_fresnel(average_schlick(b.color, 1.0), average)
        dielectric = multiple_bounce_fresnel(average_schlick(b.f0, b.f90), average) * (1.0 - b.transmission)
        return wp.lerp(dielectric, metal, b.metallic)

    @wp.func
    def shares(bsdf: Bsdf, b: Base, wo: wp.vec3, white: wp.vec2) -> wp.vec2:
        dielectric = schlick_albedo(white, wp.max(b.f0), b.f90)
        below = (1.0 - b.metallic) * (1.0 - dielectric) * wp.max(b.color)
        facets = wp.lerp(dielectric, schlick_albedo(white, wp.max(b.color), 1.0), b.metallic)
        if wp.static("film" in features):
            reflected = film_albedo(b, wo, white, 1, 0.0)
            below = (1.0 - b.metallic) * (1.0 - wp.min(reflected)) * wp.max(b.color)
            facets = wp.lerp(wp.max(reflected), schlick_albedo(white, wp.max(b.color), 1.0), b.metallic)
        if wp.static(body or "thin" in features):
            facets += below * b.transmission
        if wp.static(body):
            if not bsdf.front:
                facets = wp.lerp(facets, 1.0, (1.0 - b.metallic) * b.transmission)
        spread = below * (1.0 - b.transmission)
        if wp.static("bounces" in features):
            average = average_missing_energy(bsdf.tables, bsdf.table, wp.sqrt(b.shape[0] * b.shape[1]))
            spread += wp.max(bounced(bsdf, b, average)) * missing(bsdf, b, wo)
        return wp.vec2(facets, spread)

    return _Energy(missing, bounced, shares)


@wp.func
def _diffuse_below_film(bsdf: Bsdf, b: Base, wo: wp.vec3, wi: wp.vec3, white: wp.vec2) -> wp.vec3:
    one = wp.vec3(1.0)
    average = one - average_film_albedo(b, average_facet_albedo(b.shape))
    left_o = wp.max(one - film_albedo(b, wo, white, FILM_FACETS, FILM_CAUTION), wp.vec3(0.0))
    left_i = wp.max(one - film_albedo(b, wi, facet_albedo(wi, b.shape), FILM_FACETS, FILM_CAUTION), wp.vec3(0.0))
    let_out = wp.cw_div(wp.cw_mul(left_o, left_i), wp.max(average, wp.vec3(1.0e-4)))
    return wp.cw_mul(b.color, let_out) * ((1.0 - b.metallic) * (1.0 - b.transmission) * INV_PI * wi[2])


@specialised()
def _make_diffuse(features: tuple[str, ...]) -> wp.Function:
    """Return (bsdf, base, wo, wi, white) -> f cosθi of the diffuse layer and of light that facets blocked."""
    if "film" in features:
        return _diffuse_below_film
    energy = _make_energy(features)

    @wp.func
    def diffuse(bsdf: Bsdf, b: Base, wo: wp.vec3, wi: wp.vec3, white: wp.vec2) -> wp.vec3:
        f0 = wp.max(b.f0)
        average = 1.0 - schlick_albedo(average_facet_albedo(b.shape), f0, b.f90)
        left_o = 1.0 - schlick_albedo(white, f0, b.f90)
        left_i = 1.0 - schlick_albedo(facet_albedo(wi, b.shape), f0, b.f90)
        lobe = wp.vec3(0.0)
        if wp.static("bounces" in features):
            missing = average_missing_energy(bsdf.tables, bsdf.table, wp.sqrt(b.shape[0] * b.shape[1]))
            missing_o = energy.missing(bsdf, b, wo)
            missing_i = energy.missing(bsdf, b, wi)
            lobe = energy.bounced(bsdf, b, missing) * multiple_bounce_lobe(missing_o, missing_i, missing)
            # The layer above reflects this light too.
            reflected = wp.max(multiple_bounce_fresnel(average_schlick(b.f0, b.f90), missing))
            average -= reflected * missing
            left_o -= reflected * missing_o
            left_i -= reflected * missing_i
        let_out = wp.max(left_o, 0.0) * wp.max(left_i, 0.0) / wp.max(average, 1.0e-4)
        base = b.color * ((1.0 - b.metallic) * (1.0 - b.transmission) * INV_PI * let_out)
        return (base + lobe) * wi[2]

    return diffuse


def _distribution(features: tuple[str, ...]) -> ModuleType:
    """Return the module of the distribution of normals."""
    return bumpy_ggx if "bumpy" in features else ggx


@specialised()
def _make_refraction(features: tuple[str, ...]) -> wp.Function:
    """Return (bsdf, base, wo, wi, share) -> Response of facets that refract into a body."""
    split, shape_of, distribution = (
        make_split(True, "film" in features),
        make_shape_of(features),
        _distribution(features),
    )

    @wp.func
    def refracted(bsdf: Bsdf, b: Base, wo: wp.vec3, wi: wp.vec3, share: float) -> Response:
        r = Response()
        eta = seen_index(bsdf)
        m = facet_normal(wo, wi, eta)
        cos_o = wp.dot(wo, m)
        if cos_o > 0.0:
            cos_i = -wp.dot(wi, m)
            s = split(b, cos_o, wp.where(bsdf.front, cos_o, cos_i))
            shape = shape_of(bsdf, b)
            density = distribution.d(m, shape) * cos_o * refraction_density(cos_o, cos_i, eta)
            density = density / distribution.projected_area(wo, shape)
            # G1(wi) = cosθi / P: the density of visible normals contains that of wo.
            visible = -wi[2] / distribution.projected_area(-wi, shape)
            r.value = s.transmitted * (density * visible / (eta * eta))
            r.density = density * (1.0 - s.chosen) * share
        return r

    return refracted


@specialised()
def make_base_layer(features: tuple[str, ...]) -> Layer:
    """Return the layer below sheen and coat."""
    body = "transmission" in features
    thin = "thin" in features
    transmits = body or thin
    base_of = make_base_of(features)
    split = make_split(transmits, "film" in features)
    outside = make_cos_outside(body)
    turned = make_turned(features)
    shares = _make_energy(features).shares
    diffuse = _make_diffuse(features)
    bumpy = "bumpy" in features
    distribution, shape_of, facet_response = (
        _distribution(features),
        make_shape_of(features),
        make_facet_response(bumpy),
    )
    refracted = _make_refraction(features)

    @wp.func
    def evaluate(bsdf: Bsdf, viewer: wp.vec3, light: wp.vec3) -> Response:
        wo = turned(bsdf, viewer, 1.0)
        wi = turned(bsdf, light, 1.0)
        b = base_of(bsdf)
        white = facet_albedo(wo, b.shape)
        parts = shares(bsdf, b, wo, white)
        share = parts[0] / wp.max(parts[0] + parts[1], 1.0e-20)
        r = Response()
        r.albedo = wp.min(parts[0] + parts[1], 1.0)
        if wi[2] > 0.0:
            # wo·m is half the length of wo + wi, bit for bit the same when they are swapped.
            cos_m = 0.5 * wp.length(wo + wi)
            s = split(b, cos_m, outside(bsdf, cos_m))
            facets = facet_response(wo, wi, shape_of(bsdf, b))
            r.value = s.reflected * facets[0]
            if parts[1] > 0.0:
                r.value = r.value + diffuse(bsdf, b, wo, wi, white)
            r.density = facets[1] * s.chosen * share + INV_PI * wi[2] * (1.0 - share)
            return r
        if wp.static(thin):
            through = wp.vec3(wi[0], wi[1], -wi[2])
            cos_m = 0.5 * wp.length(wo + through)
            s = split(b, cos_m, cos_m)
            facets = facet_response(wo, through, shape_of(bsdf, b))
            r.value = s.transmitted * facets[0]
            r.density = facets[1] * (1.0 - s.chosen) * share
        if wp.static(body):
            through = refracted(bsdf, b, wo, wi, share)
            r.value = through.value
            r.density = through.density
        return r

    @wp.func
    def direction(bsdf: Bsdf, viewer: wp.vec3, u: wp.vec2, u_lobe: float) -> wp.vec3:
        wo = turned(bsdf, viewer, 1.0)
        b = base_of(bsdf)
        parts = shares(bsdf, b, wo, facet_albedo(wo, b.shape))
        share = parts[0] / wp.max(parts[0] + parts[1], 1.0e-20)
        if u_lobe >= share:
            return square_to_cosine_hemisphere(u)
        m = distribution.sample_normal(wo, shape_of(bsdf, b), u)
        wi = mirrored(wo, m)
        if wp.static(transmits):
            cos_o = wp.dot(wo, m)
            s = split(b, cos_o, outside(bsdf, cos_o))
            if u_lobe >= share * s.chosen:
                if wp.static(thin):
                    wi = wp.vec3(wi[0], wi[1], -wi[2])
                else:
                    eta = seen_index(bsdf)
                    wi = wp.normalize(refracted_by(m, wo, cos_o, eta))
                    wi = wp.where(wi[2] < 0.0, wi, wp.vec3(0.0))
        return turned(bsdf, wi, -1.0)

    @wp.func
    def albedo(bsdf: Bsdf, viewer: wp.vec3) -> float:
        b = base_of(bsdf)
        wo = turned(bsdf, viewer, 1.0)
        parts = shares(bsdf, b, wo, facet_albedo(wo, b.shape))
        return wp.min(parts[0] + parts[1], 1.0)

    return Layer(evaluate, direction, albedo)


@specialised()
def make_principled(*features: str) -> Model:
    """Return the model with some of FEATURE_ROWS, in that order; "transmission" is for bodies, "thin" for sheets.

    Raises:
        ValueError: if a feature is unknown or out of order, or does not go with the others.
    """
    contradicts = {"transmission", "thin"} <= set(features) or {"film", "bounces"} <= set(features)
    contradicts = contradicts or ("dispersion" in features and "transmission" not in features)
    own_normals = "coat_normal" in features
    contradicts = contradicts or (own_normals and ("coat" not in features or "bumpy" in features))
    if [f for f in FEATURE_ROWS if f in features] != list(features) or contradicts:
        raise ValueError(f"no principled model of {', '.join(features)}: features are {', '.join(FEATURE_ROWS)}")
    rows = rows_of(features)
    body = "transmission" in features
    transmits = body or "thin" in features
    layer = make_base_layer(tuple(f for f in features if f not in ("coat", "coat_normal", "sheen")))
    if "sheen" in features:
        layer = add_sheen(layer, rows["sheen_color"], rows["sheen_roughness"], body)
    if "coat" in features:
        layer = add_coat(layer, rows["coat"], rows["coat_roughness"], body, "bumpy" in features, own_normals)

    @wp.func
    def respond_to(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> Response:
        if wo[2] <= 0.0 or wi[2] == 0.0:
            return Response()
        if wp.static(not transmits):
            if wi[2] < 0.0:
                return Response()
        return layer.evaluate(bsdf, wo, wi)

    @wp.func
    def evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
        return respond_to(bsdf, wo, wi).value

    @wp.func
    def pdf(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
        return respond_to(bsdf, wo, wi).density

    @wp.func
    def sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
        s = no_sample()
        wi = layer.direction(bsdf, wo, u, u_lobe)
        r = respond_to(bsdf, wo, wi)
        if r.density > 0.0:
            s.wi = wi
            s.weight = r.value / r.density
            s.pdf = r.density
            if wp.static(body):
                if wi[2] < 0.0:
                    s.eta = seen_index(bsdf)
        return s

    index_slot = int(IOR) if body else -1
    model = Model(evaluate, pdf, sample, len(rows), transmits=transmits, widens=True, index_slot=index_slot)
    if own_normals:
        model = model._replace(coat_slot=rows["coat"])
    return dispersive(model, rows["channels"])._replace(slots=len(rows)) if "dispersion" in features else model
