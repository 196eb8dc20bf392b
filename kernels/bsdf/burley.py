"""The principled model of Burley as Mitsuba 3 has it, as the boundary of a body or as a thin sheet.

Burley, "Physically based shading at Disney" (2012, section 5) and "Extending the Disney BRDF to a BSDF with integrated
subsurface scattering" (2015). Parts that Burley leaves open, such as which light each lobe gets, are as in Mitsuba's
`principled` and `principledthin` (Jakob et al. 2022), so that its scenes look alike; but both sides of
an opaque surface are the same.
"""

import warp as wp

from wrt.kernels.bsdf.dielectric import seen_from
from wrt.kernels.bsdf.lobes.facets import make_sample, mirrored
from wrt.kernels.bsdf.lobes.fresnel import fresnel_dielectric, fresnel_schlick, refracted_by, schlick_weight
from wrt.kernels.bsdf.rough_dielectric import cosine_to, facet_normal, is_matched, refraction_density, transmittance
from wrt.kernels.core.bsdf import Bsdf, Model
from wrt.kernels.core.elementary import sine_cosine
from wrt.kernels.core.specialise import specialised
from wrt.kernels.microfacet import make_microfacet
from wrt.kernels.sampling.warps import INV_PI, PI, TWO_PI, square_to_cosine_hemisphere

BASE = wp.constant(0)
METALLIC = wp.constant(1)  # of a thin sheet: the share of diffuse light that is transmitted
ROUGHNESS = wp.constant(2)
ANISOTROPY = wp.constant(3)
TRANSMISSION = wp.constant(4)  # share of the dielectric that is clear
IOR = wp.constant(5)
TINT = wp.constant(6)
SHEEN = wp.constant(7)
SHEEN_TINT = wp.constant(8)
FLATNESS = wp.constant(9)
COAT = wp.constant(10)
COAT_GLOSS = wp.constant(11)
SLOTS = 12

LEAST_ALPHA = wp.constant(0.001)
COAT_MASKING_ALPHA = wp.constant(0.25)
COAT_SHARE = wp.constant(0.25)
"""The coat reflects a quarter of what a layer of varnish would (Burley 2012, section 5.6)."""
COAT_F0 = wp.constant(0.04)


@wp.func
def alphas(roughness: float, anisotropy: float) -> wp.vec3:
    """Return the roughness of GGX along x and y (Burley 2012, section 5.4)."""
    aspect = wp.sqrt(1.0 - 0.9 * anisotropy)
    a = roughness * roughness
    return wp.vec3(wp.clamp(a / aspect, LEAST_ALPHA, 16.0), wp.clamp(a * aspect, LEAST_ALPHA, 16.0), 0.0)


@wp.func
def hue(color: wp.vec3) -> wp.vec3:
    """Return a colour of luminance 1; white for black."""
    luminance = 0.212671 * color[0] + 0.715160 * color[1] + 0.072169 * color[2]
    if luminance <= 0.0:
        return wp.vec3(1.0)
    return color / luminance


@wp.func
def diffuse(bsdf: Bsdf, cos_o: float, cos_i: float, cos_d: float) -> float:
    """Return π f of the base (Burley 2012, section 5.3) and of its flat variant (2015), for a white one.

    `cos_d` is the cosine between the light and the half vector.
    """
    weight_o = schlick_weight(cos_o)
    weight_i = schlick_weight(cos_i)
    back = 2.0 * bsdf.slots[ROUGHNESS][0] * cos_d * cos_d
    matt = (1.0 - 0.5 * weight_i) * (1.0 - 0.5 * weight_o)
    matt += back * (weight_o + weight_i + weight_o * weight_i * (back - 1.0))
    flatness = bsdf.slots[FLATNESS][0]
    if flatness == 0.0:
        return matt
    half = 0.5 * back
    flat = (1.0 + (half - 1.0) * weight_o) * (1.0 + (half - 1.0) * weight_i)
    flat = 1.25 * (flat * (1.0 / (cos_o + cos_i) - 0.5) + 0.5)
    return matt + (flat - matt) * flatness


@wp.func
def sheen(bsdf: Bsdf, cos_d: float) -> wp.vec3:
    """Return f of the fibres (Burley 2012, section 5.5)."""
    tint = bsdf.slots[SHEEN_TINT][0]
    color = wp.vec3(1.0) + (hue(bsdf.slots[BASE]) - wp.vec3(1.0)) * tint
    return color * (bsdf.slots[SHEEN][0] * schlick_weight(wp.abs(cos_d)))


@wp.func
def tinted_schlick(bsdf: Bsdf, cosine: float) -> wp.vec3:
    """Return Schlick's reflectance of a dielectric whose reflection at normal incidence has the hue of the base."""
    r = (bsdf.slots[IOR][0] - 1.0) / (bsdf.slots[IOR][0] + 1.0)
    return fresnel_schlick(cosine, hue(bsdf.slots[BASE]) * (r * r))


# --- Coat ------------------------------------------------------------------------------------------


@wp.func
def coat_alpha(bsdf: Bsdf) -> float:
    """Return the roughness of the coat's distribution."""
    return 0.1 + (0.001 - 0.1) * bsdf.slots[COAT_GLOSS][0]


@wp.func
def gtr1(cosine: float, alpha: float) -> float:
    """Return D of the generalised Trowbridge-Reitz distribution with γ = 1 (Burley 2012, eq. 4 and appendix B.2)."""
    a2 = alpha * alpha
    return (a2 - 1.0) / (PI * wp.log(a2) * (1.0 + (a2 - 1.0) * cosine * cosine))


@wp.func
def coat_masking(cosine: float) -> float:
    """Return G1 of GGX with the coat's fixed roughness."""
    c2 = cosine * cosine
    a2 = COAT_MASKING_ALPHA * COAT_MASKING_ALPHA
    return 2.0 * cosine / (cosine + wp.sqrt(c2 + a2 * (1.0 - c2)))


@wp.func
def coat(bsdf: Bsdf, m: wp.vec3, cos_m: float, wo: wp.vec3, wi: wp.vec3) -> float:
    """Return f |cosθi| of the coat."""
    fresnel = COAT_F0 + (1.0 - COAT_F0) * schlick_weight(cos_m)
    masking = coat_masking(wo[2]) * coat_masking(wi[2])
    return bsdf.slots[COAT][0] * COAT_SHARE * fresnel * gtr1(m[2], coat_alpha(bsdf)) * masking * wi[2]


@wp.func
def coat_normal(bsdf: Bsdf, u: wp.vec2) -> wp.vec3:
    """Return a normal with the density D cosθ (Burley 2012, eq. 5 and 6)."""
    alpha = coat_alpha(bsdf)
    a2 = alpha * alpha
    cos2 = (1.0 - wp.pow(a2, 1.0 - u[1])) / (1.0 - a2)
    sine = wp.sqrt(wp.max(1.0 - cos2, 0.0))
    turned = sine_cosine(TWO_PI * u[0])
    return wp.vec3(sine * turned[1], sine * turned[0], wp.sqrt(wp.max(cos2, 0.0)))


# --- A body ----------------------------------------------------------------------------------------


@wp.func
def clear(bsdf: Bsdf) -> float:
    """Return the share of the surface that is a clear dielectric."""
    return (1.0 - bsdf.slots[METALLIC][0]) * bsdf.slots[TRANSMISSION][0]


@wp.func
def matt(bsdf: Bsdf) -> float:
    """Return the share that is a dielectric that scatters."""
    return (1.0 - bsdf.slots[METALLIC][0]) * (1.0 - bsdf.slots[TRANSMISSION][0])


@wp.func
def reflected_share(bsdf: Bsdf, front: bool, cos_m: float, eta: float) -> float:
    """Return the probability with which a drawn facet reflects instead of refracting."""
    fresnel = fresnel_dielectric(cos_m, eta)
    if front:
        return 1.0 - clear(bsdf) * (1.0 - fresnel)
    return fresnel


@wp.func
def facet_reflectance(bsdf: Bsdf, front: bool, cos_m: float, eta: float) -> wp.vec3:
    """Return the reflectance of a facet: exact for a dielectric, Schlick's for metals and tints."""
    fresnel = fresnel_dielectric(cos_m, eta)
    if not front:
        return wp.vec3(clear(bsdf) * fresnel)
    metallic = bsdf.slots[METALLIC][0]
    tint = bsdf.slots[TINT][0]
    result = fresnel_schlick(cos_m, bsdf.slots[BASE]) * metallic + wp.vec3((1.0 - metallic) * (1.0 - tint) * fresnel)
    if tint > 0.0:
        result += tinted_schlick(bsdf, cos_m) * ((1.0 - metallic) * tint)
    return result


@wp.func
def lobe_weights(bsdf: Bsdf, front: bool) -> wp.vec3:
    """Return the probabilities of drawing from the facets, the coat and the base."""
    if not front:
        return wp.vec3(1.0, 0.0, 0.0)
    weights = wp.vec3(1.0, COAT_SHARE * bsdf.slots[COAT][0], matt(bsdf))
    return weights / (weights[0] + weights[1] + weights[2])


def _make_body(transmits: bool) -> Model:
    """Return the model of the boundary of a body."""
    facet = make_microfacet("ggx", "smith-separable")

    @wp.func
    def evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
        front = bsdf.front or wp.static(not transmits)
        eta = seen_from(bsdf.slots[IOR][0], front)
        if wo[2] <= 0.0 or wi[2] == 0.0 or (wi[2] < 0.0 and is_matched(eta)):
            return wp.vec3(0.0)
        value = wp.vec3(0.0)
        m = facet_normal(wo, wi, eta)
        cos_m = cosine_to(m, wo, wi)
        if cos_m > 0.0:
            shape = alphas(bsdf.slots[ROUGHNESS][0], bsdf.slots[ANISOTROPY][0])
            facets = facet.d(m, shape) * facet.g(wo, wi, m, shape) / wp.max(wo[2], 1.0e-15)
            if wi[2] > 0.0:
                value = facet_reflectance(bsdf, front, cos_m, eta) * (0.25 * facets)
            else:
                if wp.static(transmits):
                    cos_i = -wp.dot(wi, m)
                    scale = transmittance(cos_m, cos_i, eta) * cos_m * refraction_density(cos_m, cos_i, eta)
                    base = bsdf.slots[BASE]
                    root = wp.vec3(wp.sqrt(base[0]), wp.sqrt(base[1]), wp.sqrt(base[2]))
                    value = root * (clear(bsdf) * scale / (eta * eta) * facets)
        if wi[2] > 0.0 and front:
            half = wp.normalize(wo + wi)
            cos_d = wp.dot(wi, half)
            if bsdf.slots[COAT][0] > 0.0:
                value += wp.vec3(coat(bsdf, half, cos_d, wo, wi))
            value += bsdf.slots[BASE] * (matt(bsdf) * INV_PI * diffuse(bsdf, wo[2], wi[2], cos_d) * wi[2])
            if bsdf.slots[SHEEN][0] > 0.0:
                value += sheen(bsdf, cos_d) * ((1.0 - bsdf.slots[METALLIC][0]) * wi[2])
        return value

    @wp.func
    def pdf(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
        front = bsdf.front or wp.static(not transmits)
        eta = seen_from(bsdf.slots[IOR][0], front)
        if wo[2] <= 0.0 or wi[2] == 0.0 or (wi[2] < 0.0 and is_matched(eta)):
            return 0.0
        weights = lobe_weights(bsdf, front)
        density = float(0.0)
        m = facet_normal(wo, wi, eta)
        cos_m = cosine_to(m, wo, wi)
        if cos_m > 0.0:
            drawn = facet.normal_pdf(wo, m, alphas(bsdf.slots[ROUGHNESS][0], bsdf.slots[ANISOTROPY][0]))
            share = reflected_share(bsdf, front, cos_m, eta)
            if wi[2] > 0.0:
                density = weights[0] * share * drawn / (4.0 * cos_m)
            else:
                if wp.static(transmits):
                    density = weights[0] * (1.0 - share) * drawn * refraction_density(cos_m, -wp.dot(wi, m), eta)
        if wi[2] > 0.0:
            density += weights[2] * INV_PI * wi[2]
            if weights[1] > 0.0:
                half = wp.normalize(wo + wi)
                density += weights[1] * gtr1(half[2], coat_alpha(bsdf)) * half[2] / (4.0 * wp.dot(wo, half))
        return density

    @wp.func
    def direction(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> wp.vec3:
        front = bsdf.front or wp.static(not transmits)
        weights = lobe_weights(bsdf, front)
        if u_lobe >= weights[0] + weights[1]:
            return square_to_cosine_hemisphere(u)
        if u_lobe >= weights[0]:
            return mirrored(wo, coat_normal(bsdf, u))
        eta = seen_from(bsdf.slots[IOR][0], front)
        m = facet.sample_normal(wo, alphas(bsdf.slots[ROUGHNESS][0], bsdf.slots[ANISOTROPY][0]), u)
        cos_m = wp.dot(wo, m)
        if cos_m <= 0.0:
            return wp.vec3(0.0)
        if u_lobe / weights[0] < reflected_share(bsdf, front, cos_m, eta):
            return mirrored(wo, m)
        wi = refracted_by(m, wo, cos_m, eta)
        return wp.where(wi[2] < 0.0, wp.normalize(wi), wp.vec3(0.0))

    index_slot = int(IOR) if transmits else -1
    sample = make_sample(evaluate, pdf, direction)
    return Model(evaluate, pdf, sample, SLOTS, transmits=transmits, index_slot=index_slot)


# --- A thin sheet ----------------------------------------------------------------------------------


@wp.func
def above(w: wp.vec3) -> wp.vec3:
    """Return a direction mirrored to above the surface."""
    return wp.vec3(w[0], w[1], wp.abs(w[2]))


@wp.func
def thin_alphas(bsdf: Bsdf, through: bool) -> wp.vec3:
    """Return the roughness; light through a sheet is bent twice, which depends on the index (Burley 2015, 5.2)."""
    roughness = bsdf.slots[ROUGHNESS][0]
    if through:
        roughness *= wp.max(0.65 * bsdf.slots[IOR][0] - 0.35, 0.0)
    return alphas(roughness, bsdf.slots[ANISOTROPY][0])


@wp.func
def thin_weights(bsdf: Bsdf) -> wp.vec4:
    """Return the probabilities of facets that reflect and transmit, and of the base that reflects and transmits."""
    shiny = bsdf.slots[TRANSMISSION][0]
    through = bsdf.slots[METALLIC][0]
    return wp.vec4(0.5 * shiny, 0.5 * shiny, (1.0 - shiny) * (1.0 - through), (1.0 - shiny) * through)


def _make_thin() -> Model:
    """Return the model of a thin sheet, alike from both sides."""
    facet = make_microfacet("ggx", "smith-separable")

    @wp.func
    def evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
        if wo[2] <= 0.0 or wi[2] == 0.0:
            return wp.vec3(0.0)
        through = wi[2] < 0.0
        up = above(wi)
        m = wp.normalize(wo + up)
        cos_m = wp.dot(wo, m)
        shiny = bsdf.slots[TRANSMISSION][0]
        base = bsdf.slots[BASE]
        value = wp.vec3(0.0)
        if shiny > 0.0:
            shape = thin_alphas(bsdf, through)
            facets = 0.25 * shiny * facet.d(m, shape) * facet.g(wo, up, m, shape) / wp.max(wo[2], 1.0e-15)
            fresnel = fresnel_dielectric(cos_m, bsdf.slots[IOR][0])
            if through:
                value = base * ((1.0 - fresnel) * facets)
            else:
                tint = bsdf.slots[TINT][0]
                value = (wp.vec3((1.0 - tint) * fresnel) + tinted_schlick(bsdf, cos_m) * tint) * facets
        share = bsdf.slots[METALLIC][0]
        scattered = (1.0 - shiny) * INV_PI * up[2]
        if through:
            value += base * (scattered * share)
        else:
            value += base * (scattered * (1.0 - share) * diffuse(bsdf, wo[2], wi[2], cos_m))
            value += sheen(bsdf, cos_m) * ((1.0 - shiny) * (1.0 - share) * up[2])
        return value

    @wp.func
    def pdf(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
        if wo[2] <= 0.0 or wi[2] == 0.0:
            return 0.0
        through = wi[2] < 0.0
        up = above(wi)
        m = wp.normalize(wo + up)
        weights = thin_weights(bsdf)
        facets = wp.where(through, weights[1], weights[0])
        density = wp.where(through, weights[3], weights[2]) * INV_PI * up[2]
        if facets > 0.0:
            density += facets * facet.normal_pdf(wo, m, thin_alphas(bsdf, through)) / (4.0 * wp.dot(wo, m))
        return density

    @wp.func
    def direction(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> wp.vec3:
        weights = thin_weights(bsdf)
        shiny = weights[0] + weights[1]
        wi = wp.vec3(0.0)
        through = u_lobe >= shiny + weights[2]
        if u_lobe < shiny:
            through = u_lobe >= weights[0]
            m = facet.sample_normal(wo, thin_alphas(bsdf, through), u)
            if wp.dot(wo, m) > 0.0:
                wi = mirrored(wo, m)
        else:
            wi = square_to_cosine_hemisphere(u)
        return wp.where(through, wp.vec3(wi[0], wi[1], -wi[2]), wi)

    return Model(evaluate, pdf, make_sample(evaluate, pdf, direction), SLOTS, transmits=True)


@specialised()
def make_burley(kind: str = "opaque") -> Model:
    """Return the model of a kind: "opaque", "transmission" for bodies that light can enter, or "thin".

    Raises:
        ValueError: if there is no such kind.
    """
    if kind not in ("opaque", "transmission", "thin"):
        raise ValueError(f"no Burley model of the kind {kind!r}")
    return _make_thin() if kind == "thin" else _make_body(kind == "transmission")
