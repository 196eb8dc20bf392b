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
from wrt.kernels.bsdf.layering import (
    Layer,
    Response,
    add_coat,
    add_sheen,
    alpha_of,
    facet_response,
    mirrored,
    schlick,
)
from wrt.kernels.bsdf.record import Bsdf, BsdfSample, Model, no_sample
from wrt.kernels.bsdf.rough_dielectric import facet_normal, refraction_density
from wrt.kernels.fresnel import cos_transmitted_squared
from wrt.kernels.microfacet import ggx
from wrt.kernels.microfacet.widening import widened
from wrt.kernels.warps import INV_PI, square_to_cosine_hemisphere

BASE_COLOR = wp.constant(0)
METALLIC = wp.constant(1)
ROUGHNESS = wp.constant(2)
SPECULAR = wp.constant(3)
SPECULAR_COLOR = wp.constant(4)
IOR = wp.constant(5)

CORE_ROWS = ("base_color", "metallic", "roughness", "specular", "specular_color", "ior")
FEATURE_ROWS = {
    # Direction in tangent space, mapped to [0, 1]², and strength; cosine and sine of a further rotation.
    "anisotropic": ("anisotropy", "rotation"),
    "transmission": ("transmission",),
    "thin": ("transmission",),
    "coat": ("coat", "coat_roughness"),
    "sheen": ("sheen_color", "sheen_roughness"),
    "bounces": (),
}
"""What may follow "principled" in a model's name, in this order, and the values that it reads besides CORE_ROWS."""

LEAST_IOR = wp.constant(1.001)
"""Bodies of a lower index bend light as by this one: the half vectors of refraction lose digits as 1 / (ior − 1)."""


@wp.struct
class Base:
    """A metal or dielectric at one point; `f0` and `f90` are the dielectric's, `transmission` its clear share."""

    shape: wp.vec3
    color: wp.vec3
    metallic: float
    f0: wp.vec3
    f90: float
    transmission: float


@wp.func
def schlick_albedo(albedo: wp.vec2, f0: float, f90: float) -> float:
    """Return the albedo of facets that reflect F(f0, f90), from that of white ones."""
    return f0 * (albedo[0] - albedo[1]) + f90 * albedo[1]


@wp.func
def average_schlick(f0: wp.vec3, f90: float) -> wp.vec3:
    """Return 2 ∫ F μ dμ = f0 + (f90 − f0) / 21."""
    return f0 + (wp.vec3(f90) - f0) / 21.0


@wp.func
def _not_turned(bsdf: Bsdf, w: wp.vec3, sign: float) -> wp.vec3:
    return w


@functools.cache
def make_turned(anisotropy: int) -> wp.Function:
    """Return the device function (bsdf, w, sign) -> vec3: w in the frame of the grain, or with sign −1 back from it."""

    @wp.func(name=f"principled_turned_{anisotropy}")
    def turned(bsdf: Bsdf, w: wp.vec3, sign: float) -> wp.vec3:
        row = bsdf.slots[wp.static(anisotropy)]
        along = wp.vec2(2.0 * row[0] - 1.0, 2.0 * row[1] - 1.0)
        length = wp.length(along)
        along = wp.where(length > 1.0e-4, along / wp.max(length, 1.0e-4), wp.vec2(1.0, 0.0))
        turn = bsdf.slots[wp.static(anisotropy + 1)]
        c = along[0] * turn[0] - along[1] * turn[1]
        s = (along[1] * turn[0] + along[0] * turn[1]) * sign
        return wp.vec3(c * w[0] + s * w[1], c * w[1] - s * w[0], w[2])

    return turned


@functools.cache
def make_base_of(features: tuple[str, ...]) -> wp.Function:
    """Return the device function bsdf -> Base."""
    rows = rows_of(features)
    anisotropic = "anisotropic" in features
    anisotropy = rows.get("anisotropy", -1)
    transmission = rows.get("transmission", -1)
    transmits = transmission >= 0
    turned = make_turned(anisotropy) if anisotropic else _not_turned

    @wp.func(name=f"principled_base_{name_of(features)}")
    def base_of(bsdf: Bsdf) -> Base:
        b = Base()
        one = wp.vec3(1.0)
        b.color = wp.min(bsdf.slots[BASE_COLOR], one)
        b.metallic = wp.clamp(bsdf.slots[METALLIC][0], 0.0, 1.0)
        ior = bsdf.slots[IOR][0]
        root = (ior - 1.0) / (ior + 1.0)
        b.f90 = wp.clamp(bsdf.slots[SPECULAR][0], 0.0, 1.0)
        b.f0 = wp.min(bsdf.slots[SPECULAR_COLOR] * (root * root), one) * b.f90
        alpha = alpha_of(bsdf.slots[ROUGHNESS][0])
        along = alpha
        variance = bsdf.normal_variance
        if wp.static(anisotropic):
            strength = wp.clamp(bsdf.slots[wp.static(anisotropy)][2], 0.0, 1.0)
            along = wp.lerp(alpha, 1.0, strength * strength)
            # Of independent slopes along x and y.
            axis = turned(bsdf, wp.vec3(1.0, 0.0, 0.0), 1.0)
            c2 = axis[0] * axis[0]
            variance = wp.vec2(c2 * variance[0] + (1.0 - c2) * variance[1], (1.0 - c2) * variance[0] + c2 * variance[1])
        b.shape = widened(wp.vec3(along, alpha, 0.0), variance)
        b.transmission = 0.0
        if wp.static(transmits):
            b.transmission = wp.clamp(bsdf.slots[wp.static(transmission)][0], 0.0, 1.0)
        return b

    return base_of


@wp.func
def seen_index(bsdf: Bsdf) -> float:
    """Return n_t / n_i of a body for the viewer's side."""
    ior = wp.max(bsdf.slots[IOR][0], LEAST_IOR)
    return wp.where(bsdf.front, ior, 1.0 / ior)


@wp.func
def _cos_of_opaque(bsdf: Bsdf, cos_m: float) -> float:
    return cos_m


@wp.func
def _cos_of_body(bsdf: Bsdf, cos_m: float) -> float:
    if bsdf.front:
        return cos_m
    cos2_t = cos_transmitted_squared(cos_m, seen_index(bsdf))
    return wp.where(cos2_t > 0.0, wp.sqrt(wp.max(cos2_t, 0.0)), -1.0)


@wp.struct
class Split:
    """What a facet does with light: the shares that it reflects and lets through, and how often the first is drawn."""

    reflected: wp.vec3
    transmitted: wp.vec3
    chosen: float


@functools.cache
def make_split(transmits: bool) -> wp.Function:
    """Return the device function (base, wo·m, cosine outside) -> Split; the last is negative where that is nowhere."""

    @wp.func(name=f"principled_split_{int(transmits)}")
    def split(b: Base, cos_m: float, cos_outside: float) -> Split:
        s = Split()
        dielectric = schlick(cos_m, b.f0, b.f90)
        s.chosen = 1.0
        if wp.static(transmits):
            boundary = wp.vec3(1.0)
            if cos_outside >= 0.0:
                boundary = schlick(cos_outside, b.f0, b.f90)
            dielectric = wp.lerp(dielectric, boundary, b.transmission)
            s.transmitted = b.color * ((1.0 - b.metallic) * b.transmission * (1.0 - wp.max(boundary)))
        s.reflected = wp.lerp(dielectric, schlick(cos_m, b.color, 1.0), b.metallic)
        if wp.static(transmits):
            through = wp.max(s.transmitted)
            if through > 0.0:
                reflected = wp.max(s.reflected)
                s.chosen = reflected / (reflected + through)
        return s

    return split


@functools.cache
def make_base_layer(features: tuple[str, ...]) -> Layer:
    """Return the layer below sheen and coat."""
    body = "transmission" in features
    thin = "thin" in features
    transmits = body or thin
    bounces = "bounces" in features
    anisotropic = "anisotropic" in features
    rows = rows_of(features)
    name = name_of(features)
    base_of = make_base_of(features)
    split = make_split(transmits)
    outside = _cos_of_body if body else _cos_of_opaque
    turned = make_turned(rows["anisotropy"]) if anisotropic else _not_turned

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


def name_of(features: tuple[str, ...]) -> str:
    """Return an identifier for a set of features."""
    return "_".join(features) or "core"


def rows_of(features: tuple[str, ...]) -> dict[str, int]:
    """Return the numbers of the rows that the model of these features reads, by name."""
    names = list(CORE_ROWS)
    for feature in features:
        names += FEATURE_ROWS[feature]
    return {name: number for number, name in enumerate(names)}


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

    return Model(evaluate, pdf, sample, slots=len(rows), transmits=transmits, widens=True)
