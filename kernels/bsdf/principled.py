"""The metalness workflow: what a glTF material means, in forms that conserve energy and are reciprocal.

Khronos Group 2021, "glTF 2.0 Specification", appendix B, and KHR_materials_ior, _specular, _anisotropy, _transmission,
_volume (refraction), _clearcoat, _sheen; after Burley, "Physically based shading at Disney" (2012, 2015). From below:

    metal       F(base_color, 1) D G / (4 cosθi cosθo),    F(f0, f90) = f0 + (f90 − f0)(1 − wo·m)⁵
    dielectric  F(f0, f90) D G / (4 cosθi cosθo) + base_color [(1 − t) diffuse + t (1 − F) refraction]
    base        metallic · metal + (1 − metallic) · dielectric
    sheen, coat on it (`kernels/bsdf/layering.py`)

with α = roughness², f0 = min(((ior − 1) / (ior + 1))² specular_color, 1) specular, f90 = specular, t = transmission.
Appendix B asks that a BRDF be positive, reciprocal and energy conserving, but its sample implementation is not. Where
this differs from that:

- G is Smith's height-correlated form, which the appendix calls more accurate, not the product of both G1.
- Under the specular layer lies diffuse = (1 − E(θo)) (1 − E(θi)) / (π (1 − E_avg)), E being that layer's albedo, as the
  appendix recommends after Kulla and Conty (2017), instead of (1 − F(wo·m)) / π: at grazing angles that would reflect
  up to twice the light. A white dielectric reflects all light, less what `kernels/albedo_fits.py` overestimates E by.
- Coat and sheen leave the base min(1 − E(θo), 1 − E(θi)), where the coat has 1 − F(θo).

A transmitting share t of a dielectric is a rough boundary (Walter et al. 2007) with Schlick's Fresnel taken on the side
of the lower index, so that it is the same both ways, and 1 under total internal reflection. The opaque share and metal
look the same from both sides. A thin sheet reflects as if it were opaque, and what it lets through goes on as if
reflected and mirrored through the surface.
"""

import functools

import warp as wp

from wrt.kernels.albedo import average_missing_energy, missing_energy, multiple_bounce_fresnel, multiple_bounce_lobe
from wrt.kernels.albedo_fits import average_facet_albedo, facet_albedo
from wrt.kernels.bsdf.facets import mirrored
from wrt.kernels.bsdf.layering import Layer, Response, add_coat, add_sheen, facet_response
from wrt.kernels.bsdf.principled_base import (
    FEATURE_ROWS,
    IOR,
    Base,
    average_schlick,
    make_base_of,
    make_cos_outside,
    make_split,
    make_turned,
    name_of,
    rows_of,
    schlick_albedo,
    seen_index,
)
from wrt.kernels.bsdf.record import Bsdf, BsdfSample, Model, no_sample
from wrt.kernels.bsdf.rough_dielectric import facet_normal, refraction_density
from wrt.kernels.fresnel import cos_transmitted_squared
from wrt.kernels.microfacet import ggx
from wrt.kernels.warps import INV_PI, square_to_cosine_hemisphere


@functools.cache
def make_base_layer(features: tuple[str, ...]) -> Layer:
    """Return the layer below sheen and coat."""
    body = "transmission" in features
    thin = "thin" in features
    transmits = body or thin
    bounces = "bounces" in features
    name = name_of(features)
    base_of = make_base_of(features)
    split = make_split(transmits)
    outside = make_cos_outside(body)
    turned = make_turned(features)

    @wp.func(name=f"principled_missing_{name}")
    def missing(bsdf: Bsdf, b: Base, w: wp.vec3) -> float:
        return missing_energy(bsdf.tables, bsdf.table, w, wp.sqrt(b.shape[0] * b.shape[1]))

    @wp.func(name=f"principled_bounced_{name}")
    def bounced(bsdf: Bsdf, b: Base, average: float) -> wp.vec3:
        """Return the share of light blocked once that comes out after all, of the metal and the opaque dielectric."""
        metal = multiple_bounce_fresnel(average_schlick(b.color, 1.0), average)
        dielectric = multiple_bounce_fresnel(average_schlick(b.f0, b.f90), average) * (1.0 - b.transmission)
        return wp.lerp(dielectric, metal, b.metallic)

    @wp.func(name=f"principled_shares_{name}")
    def shares(bsdf: Bsdf, b: Base, wo: wp.vec3, white: wp.vec2) -> wp.vec2:
        """Return what facets reflect or let through at once, and what is spread like a diffuse reflection."""
        dielectric = schlick_albedo(white, wp.max(b.f0), b.f90)
        below = (1.0 - b.metallic) * (1.0 - dielectric) * wp.max(b.color)
        facets = wp.lerp(dielectric, schlick_albedo(white, wp.max(b.color), 1.0), b.metallic)
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

    @wp.func(name=f"principled_spread_{name}")
    def spread(bsdf: Bsdf, b: Base, wo: wp.vec3, wi: wp.vec3, white: wp.vec2) -> wp.vec3:
        """Return f cosθi of what lies under the facets, and of light that they blocked."""
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
        diffuse = b.color * ((1.0 - b.metallic) * (1.0 - b.transmission) * INV_PI * let_out)
        return (diffuse + lobe) * wi[2]

    @wp.func(name=f"principled_refracted_{name}")
    def refracted(bsdf: Bsdf, b: Base, wo: wp.vec3, wi: wp.vec3, share: float) -> Response:
        r = Response()
        eta = seen_index(bsdf)
        m = facet_normal(wo, wi, eta)
        cos_o = wp.dot(wo, m)
        if cos_o > 0.0:
            cos_i = -wp.dot(wi, m)
            s = split(b, cos_o, wp.where(bsdf.front, cos_o, cos_i))
            density = ggx.d(m, b.shape) * cos_o * refraction_density(cos_o, cos_i, eta)
            density = density / ggx.projected_area(wo, b.shape)
            # G1(wi) = cosθi / P: with visible normals that of wo is in the density.
            hidden = -wi[2] / ggx.projected_area(-wi, b.shape)
            r.value = s.transmitted * (density * hidden / (eta * eta))
            r.density = density * (1.0 - s.chosen) * share
        return r

    @wp.func(name=f"principled_evaluate_{name}")
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
            # wo·m is half the length of wo + wi, the same from both sides to the last bit.
            cos_m = 0.5 * wp.length(wo + wi)
            s = split(b, cos_m, outside(bsdf, cos_m))
            facets = facet_response(wo, wi, b.shape)
            r.value = s.reflected * facets[0]
            if parts[1] > 0.0:
                r.value = r.value + spread(bsdf, b, wo, wi, white)
            r.density = facets[1] * s.chosen * share + INV_PI * wi[2] * (1.0 - share)
            return r
        if wp.static(thin):
            through = wp.vec3(wi[0], wi[1], -wi[2])
            cos_m = 0.5 * wp.length(wo + through)
            s = split(b, cos_m, cos_m)
            facets = facet_response(wo, through, b.shape)
            r.value = s.transmitted * facets[0]
            r.density = facets[1] * (1.0 - s.chosen) * share
        if wp.static(body):
            through = refracted(bsdf, b, wo, wi, share)
            r.value = through.value
            r.density = through.density
        return r

    @wp.func(name=f"principled_direction_{name}")
    def direction(bsdf: Bsdf, viewer: wp.vec3, u: wp.vec2, u_lobe: float) -> wp.vec3:
        wo = turned(bsdf, viewer, 1.0)
        b = base_of(bsdf)
        parts = shares(bsdf, b, wo, facet_albedo(wo, b.shape))
        share = parts[0] / wp.max(parts[0] + parts[1], 1.0e-20)
        if u_lobe >= share:
            return square_to_cosine_hemisphere(u)
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

    @wp.func(name=f"principled_albedo_{name}")
    def albedo(bsdf: Bsdf, viewer: wp.vec3) -> float:
        b = base_of(bsdf)
        wo = turned(bsdf, viewer, 1.0)
        parts = shares(bsdf, b, wo, facet_albedo(wo, b.shape))
        return wp.min(parts[0] + parts[1], 1.0)

    return Layer(evaluate, direction, albedo)


@functools.cache
def make_principled(*features: str) -> Model:
    """Return the model with some of FEATURE_ROWS, in that order; "transmission" of a body or "thin", of a sheet.

    Raises:
        ValueError: where there is no such feature, or they come in another order.
    """
    if [f for f in FEATURE_ROWS if f in features] != list(features) or {"transmission", "thin"} <= set(features):
        raise ValueError(f"no principled model of {', '.join(features)}: features are {', '.join(FEATURE_ROWS)}")
    rows = rows_of(features)
    body = "transmission" in features
    transmits = body or "thin" in features
    name = name_of(features)
    layer = make_base_layer(tuple(f for f in features if f not in ("coat", "sheen")))
    if "sheen" in features:
        layer = add_sheen(name, layer, rows["sheen_color"], rows["sheen_roughness"], body)
    if "coat" in features:
        layer = add_coat(name, layer, rows["coat"], rows["coat_roughness"], body)
    respond, direction = layer.evaluate, layer.direction

    @wp.func(name=f"principled_{name}")
    def respond_to(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> Response:
        if wo[2] <= 0.0 or wi[2] == 0.0:
            return Response()
        if wp.static(not transmits):
            if wi[2] < 0.0:
                return Response()
        return respond(bsdf, wo, wi)

    @wp.func(name=f"principled_value_{name}")
    def evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
        return respond_to(bsdf, wo, wi).value

    @wp.func(name=f"principled_pdf_{name}")
    def pdf(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
        return respond_to(bsdf, wo, wi).density

    @wp.func(name=f"principled_sample_{name}")
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

    return Model(
        evaluate, pdf, sample, slots=len(rows), transmits=transmits, widens=True, index_slot=int(IOR) if body else -1
    )
