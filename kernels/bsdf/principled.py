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

from typing import NamedTuple

import warp as wp

from wrt.kernels.bsdf.lobes.albedo import (
    average_missing_energy,
    missing_energy,
    multiple_bounce_fresnel,
    multiple_bounce_lobe,
)
from wrt.kernels.bsdf.lobes.albedo_fits import average_facet_albedo, facet_albedo
from wrt.kernels.bsdf.lobes.coats import Layer, Response, add_coat, add_sheen, bumpy_facet_response, facet_response
from wrt.kernels.bsdf.lobes.dispersion import dispersive
from wrt.kernels.bsdf.lobes.facets import mirrored
from wrt.kernels.bsdf.lobes.fresnel import cos_transmitted_squared
from wrt.kernels.bsdf.lobes.principled_base import (
    FEATURE_ROWS,
    IOR,
    Base,
    average_schlick,
    film_on,
    make_base_of,
    make_bumpy_of,
    make_cos_outside,
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
"""So many facets tell a film's albedo to this share of what it changes, which the layer below does not get."""


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
    more = caution * wp.sqrt(wp.max(b.shape[0], b.shape[1]))
    change = wp.vec3(0.0)
    k = int(0)
    while k < facets:
        m = ggx.sample_normal(up, b.shape, lattice_point(k, facets))
        found = film_on(b, wp.dot(up, m), b.f0, b.f90)
        change += found + wp.vec3(wp.abs(found[0]), wp.abs(found[1]), wp.abs(found[2])) * more
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
    transmits = body or "thin" in features
    bounces = "bounces" in features
    filmed = "film" in features

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
        if wp.static(filmed):
            reflected = film_albedo(b, wo, white, 1, 0.0)
            below = (1.0 - b.metallic) * (1.0 - wp.min(reflected)) * wp.max(b.color)
            facets = wp.lerp(wp.max(reflected), schlick_albedo(white, wp.max(b.color), 1.0), b.metallic)
        if wp.static(transmits):
            facets += below * b.transmission
        if wp.static(body):
            if not bsdf.front:
                facets = wp.lerp(facets, 1.0, (1.0 - b.metallic) * b.transmission)
        spread = below * (1.0 - b.transmission)
        if wp.static(bounces):
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
    bounces = "bounces" in features
    energy = _make_energy(features)
    missing, bounced = energy.missing, energy.bounced

    @wp.func
    def diffuse(bsdf: Bsdf, b: Base, wo: wp.vec3, wi: wp.vec3, white: wp.vec2) -> wp.vec3:
        f0 = wp.max(b.f0)
        average = 1.0 - schlick_albedo(average_facet_albedo(b.shape), f0, b.f90)
        left_o = 1.0 - schlick_albedo(white, f0, b.f90)
        left_i = 1.0 - schlick_albedo(facet_albedo(wi, b.shape), f0, b.f90)
        lobe = wp.vec3(0.0)
        if wp.static(bounces):
            lost = average_missing_energy(bsdf.tables, bsdf.table, wp.sqrt(b.shape[0] * b.shape[1]))
            lost_o = missing(bsdf, b, wo)
            lost_i = missing(bsdf, b, wi)
            lobe = bounced(bsdf, b, lost) * multiple_bounce_lobe(lost_o, lost_i, lost)
            # The layer above reflects this light too.
            more = wp.max(multiple_bounce_fresnel(average_schlick(b.f0, b.f90), lost))
            average -= more * lost
            left_o -= more * lost_o
            left_i -= more * lost_i
        let_out = wp.max(left_o, 0.0) * wp.max(left_i, 0.0) / wp.max(average, 1.0e-4)
        base = b.color * ((1.0 - b.metallic) * (1.0 - b.transmission) * INV_PI * let_out)
        return (base + lobe) * wi[2]

    return diffuse


@specialised()
def _make_refraction(split: wp.Function, bumpy_of: wp.Function | None) -> wp.Function:
    """Return (bsdf, base, wo, wi, share) -> Response of facets that refract into a body."""
    bumpy = bumpy_of is not None

    @wp.func
    def refracted(bsdf: Bsdf, b: Base, wo: wp.vec3, wi: wp.vec3, share: float) -> Response:
        r = Response()
        eta = seen_index(bsdf)
        m = facet_normal(wo, wi, eta)
        cos_o = wp.dot(wo, m)
        if cos_o > 0.0:
            cos_i = -wp.dot(wi, m)
            s = split(b, cos_o, wp.where(bsdf.front, cos_o, cos_i))
            # G1(wi) = cosθi / P: the density of visible normals contains that of wo.
            if wp.static(bumpy):
                shape = bumpy_of(bsdf, b)
                density = bumpy_ggx.d(m, shape) * cos_o * refraction_density(cos_o, cos_i, eta)
                density = density / bumpy_ggx.projected_area(wo, shape)
                hidden = -wi[2] / bumpy_ggx.projected_area(-wi, shape)
            else:
                density = ggx.d(m, b.shape) * cos_o * refraction_density(cos_o, cos_i, eta)
                density = density / ggx.projected_area(wo, b.shape)
                hidden = -wi[2] / ggx.projected_area(-wi, b.shape)
            r.value = s.transmitted * (density * hidden / (eta * eta))
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
    bumpy_of = make_bumpy_of(features) if bumpy else None
    refracted = _make_refraction(split, bumpy_of)

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
            if wp.static(bumpy):
                facets = bumpy_facet_response(wo, wi, bumpy_of(bsdf, b))
            else:
                facets = facet_response(wo, wi, b.shape)
            r.value = s.reflected * facets[0]
            if parts[1] > 0.0:
                r.value = r.value + diffuse(bsdf, b, wo, wi, white)
            r.density = facets[1] * s.chosen * share + INV_PI * wi[2] * (1.0 - share)
            return r
        if wp.static(thin):
            through = wp.vec3(wi[0], wi[1], -wi[2])
            cos_m = 0.5 * wp.length(wo + through)
            s = split(b, cos_m, cos_m)
            if wp.static(bumpy):
                facets = bumpy_facet_response(wo, through, bumpy_of(bsdf, b))
            else:
                facets = facet_response(wo, through, b.shape)
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
        if wp.static(bumpy):
            m = bumpy_ggx.sample_normal(wo, bumpy_of(bsdf, b), u)
        else:
            m = ggx.sample_normal(wo, b.shape, u)
        wi = mirrored(wo, m)
        if wp.static(transmits):
            cos_o = wp.dot(wo, m)
            s = split(b, cos_o, outside(bsdf, cos_o))
            if u_lobe >= share * s.chosen:
                if wp.static(thin):
                    wi = wp.vec3(wi[0], wi[1], -wi[2])
                else:
                    eta = seen_index(bsdf)
                    cos_t = wp.sqrt(wp.max(cos_transmitted_squared(cos_o, eta), 0.0))
                    wi = wp.normalize(m * (cos_o / eta - cos_t) - wo / eta)
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
    given = set(features)
    contradicts = {"transmission", "thin"} <= given or {"film", "bounces"} <= given
    contradicts = contradicts or ("dispersion" in given and "transmission" not in given)
    if [f for f in FEATURE_ROWS if f in features] != list(features) or contradicts:
        raise ValueError(f"no principled model of {', '.join(features)}: features are {', '.join(FEATURE_ROWS)}")
    rows = rows_of(features)
    body = "transmission" in features
    transmits = body or "thin" in features
    layer = make_base_layer(tuple(f for f in features if f not in ("coat", "sheen")))
    if "sheen" in features:
        layer = add_sheen(layer, rows["sheen_color"], rows["sheen_roughness"], body)
    if "coat" in features:
        layer = add_coat(layer, rows["coat"], rows["coat_roughness"], body, "bumpy" in features)
    respond, direction = layer.evaluate, layer.direction

    @wp.func
    def respond_to(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> Response:
        if wo[2] <= 0.0 or wi[2] == 0.0:
            return Response()
        if wp.static(not transmits):
            if wi[2] < 0.0:
                return Response()
        return respond(bsdf, wo, wi)

    @wp.func
    def evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
        return respond_to(bsdf, wo, wi).value

    @wp.func
    def pdf(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
        return respond_to(bsdf, wo, wi).density

    @wp.func
    def sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
        s = no_sample()
        wi = direction(bsdf, wo, u, u_lobe)
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
    return dispersive(model, rows["channels"])._replace(slots=len(rows)) if "dispersion" in features else model
