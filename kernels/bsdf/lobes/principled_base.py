"""The principled material at a point: its values, the anisotropic frame, and reflection and refraction at a facet."""

import warp as wp

from wrt.kernels.bsdf.lobes.coats import alpha_of
from wrt.kernels.bsdf.lobes.fresnel import cos_transmitted_squared, schlick
from wrt.kernels.bsdf.lobes.thin_film import film_change
from wrt.kernels.core.bsdf import Bsdf
from wrt.kernels.core.specialise import specialised
from wrt.kernels.microfacet.bumpy_ggx import BumpyShape, bumpy_shape, rough_as_bumpy
from wrt.kernels.microfacet.widening import widened

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
    # Probabilities of the channels: `kernels/bsdf/lobes/dispersion.py`.
    "dispersion": ("channels",),
    # Share of the surface, thickness in nm, index: `kernels/bsdf/lobes/thin_film.py`.
    "film": ("film", "film_thickness", "film_ior"),
    "coat": ("coat", "coat_roughness"),
    # Normals of the coat and of what it lies on: y and z of these two rows (`kernels/bsdf/lobes/coats.py`).
    "coat_normal": (),
    "sheen": ("sheen_color", "sheen_roughness"),
    "bounces": (),
    "bumpy": (),
}
"""Features that may follow "principled" in a model's name, in this order, and their values besides CORE_ROWS."""

LEAST_IOR = wp.constant(1.001)
"""Lower indices of bodies are clamped to this: half vectors of refraction lose digits as 1 / (ior − 1)."""


def rows_of(features: tuple[str, ...]) -> dict[str, int]:
    """Return the row numbers that the model with these features reads, by name.

    A film's index has no row where there are rotations: it is the third number of that row.
    """
    names = list(CORE_ROWS)
    for feature in features:
        names += [row for row in FEATURE_ROWS[feature] if row != "film_ior" or "anisotropic" not in features]
    return {name: number for number, name in enumerate(names)}


@wp.struct
class Base:
    """A metal or dielectric at one point; `f0` and `f90` are the dielectric's, `transmission` its clear share.

    `film` is the share of the surface under a film, the film's index, and its thickness, µm.
    """

    shape: wp.vec3
    color: wp.vec3
    metallic: float
    f0: wp.vec3
    f90: float
    transmission: float
    film: wp.vec3


@wp.func
def schlick_albedo(albedo: wp.vec2, f0: float, f90: float) -> float:
    """Return the albedo of facets with Fresnel F(f0, f90), from that of white ones."""
    return f0 * (albedo[0] - albedo[1]) + f90 * albedo[1]


@wp.func
def average_schlick(f0: wp.vec3, f90: float) -> wp.vec3:
    """Return 2 ∫ F μ dμ = f0 + (f90 − f0) / 21."""
    return f0 + (wp.vec3(f90) - f0) / 21.0


@wp.func
def _not_turned(bsdf: Bsdf, w: wp.vec3, sign: float) -> wp.vec3:
    return w


@specialised()
def make_turned(features: tuple[str, ...]) -> wp.Function:
    """Return the device function (bsdf, w, sign) -> vec3: w in the anisotropic frame, or with sign −1 back from it."""
    if "anisotropic" not in features:
        return _not_turned
    anisotropy = rows_of(features)["anisotropy"]

    @wp.func
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


@specialised()
def make_alphas(features: tuple[str, ...]) -> wp.Function:
    """Return the device function bsdf -> vec3, the roughness along x and y before any normal map."""
    anisotropy = rows_of(features).get("anisotropy", -1)

    @wp.func
    def alphas(bsdf: Bsdf) -> wp.vec3:
        alpha = alpha_of(bsdf.slots[ROUGHNESS][0])
        along = alpha
        if wp.static(anisotropy >= 0):
            strength = wp.clamp(bsdf.slots[wp.static(anisotropy)][2], 0.0, 1.0)
            along = wp.lerp(alpha, 1.0, strength * strength)
        return wp.vec3(along, alpha, 0.0)

    return alphas


@specialised()
def make_base_of(features: tuple[str, ...]) -> wp.Function:
    """Return the device function bsdf -> Base."""
    rows, anisotropic = rows_of(features), "anisotropic" in features
    transmission, film = rows.get("transmission", -1), rows.get("film", -1)
    film_row, film_part = (rows.get("rotation", -1), 2) if anisotropic else (rows.get("film_ior", -1), 0)
    turned, alphas = make_turned(features), make_alphas(features)

    @wp.func
    def base_of(bsdf: Bsdf) -> Base:
        b = Base()
        one = wp.vec3(1.0)
        b.color = wp.min(bsdf.slots[BASE_COLOR], one)
        b.metallic = wp.clamp(bsdf.slots[METALLIC][0], 0.0, 1.0)
        ior = bsdf.slots[IOR][0]
        root = (ior - 1.0) / (ior + 1.0)
        b.f90 = wp.clamp(bsdf.slots[SPECULAR][0], 0.0, 1.0)
        b.f0 = wp.min(bsdf.slots[SPECULAR_COLOR] * (root * root), one) * b.f90
        variance = bsdf.normal_variance
        if wp.static(anisotropic):
            # For independent slopes along x and y.
            axis = turned(bsdf, wp.vec3(1.0, 0.0, 0.0), 1.0)
            c2 = axis[0] * axis[0]
            variance = wp.vec2(c2 * variance[0] + (1.0 - c2) * variance[1], (1.0 - c2) * variance[0] + c2 * variance[1])
        if wp.static("bumpy" in features):
            b.shape = rough_as_bumpy(alphas(bsdf), variance)
        else:
            b.shape = widened(alphas(bsdf), variance)
        if wp.static(transmission >= 0):
            b.transmission = wp.clamp(bsdf.slots[wp.static(transmission)][0], 0.0, 1.0)
        if wp.static(film >= 0):
            index = bsdf.slots[wp.static(film_row)][wp.static(film_part)]
            thickness = wp.max(bsdf.slots[wp.static(film + 1)][0], 0.0)
            b.film = wp.vec3(wp.clamp(bsdf.slots[wp.static(film)][0], 0.0, 1.0), index, 1.0e-3 * thickness)
        return b

    return base_of


@wp.func
def _shape_of_base(bsdf: Bsdf, b: Base) -> wp.vec3:
    return b.shape


@specialised()
def make_shape_of(features: tuple[str, ...]) -> wp.Function:
    """Return the device function (bsdf, base) -> shape of the facets: `Base.shape`, or a `BumpyShape` as rough."""
    if "bumpy" not in features:
        return _shape_of_base
    alphas = make_alphas(features)

    @wp.func
    def shape_on_bumps(bsdf: Bsdf, b: Base) -> BumpyShape:
        return bumpy_shape(alphas(bsdf), b.shape)

    return shape_on_bumps


@wp.func
def seen_index(bsdf: Bsdf) -> float:
    """Return n_t / n_i of a body, seen from the viewer's side."""
    ior = wp.max(bsdf.slots[IOR][0], LEAST_IOR)
    return wp.where(bsdf.front, ior, 1.0 / ior)


@specialised()
def make_cos_outside(body: bool) -> wp.Function:
    """Return the device function (bsdf, wo·m) -> cosine outside of the body; negative under total reflection."""

    @wp.func
    def cos_outside(bsdf: Bsdf, cos_m: float) -> float:
        cosine = cos_m
        if wp.static(body):
            if not bsdf.front:
                cos2_t = cos_transmitted_squared(cos_m, seen_index(bsdf))
                cosine = wp.where(cos2_t > 0.0, wp.sqrt(wp.max(cos2_t, 0.0)), -1.0)
        return cosine

    return cos_outside


@wp.struct
class Split:
    """A facet's shares of reflection and transmission, and the probability of sampling reflection."""

    reflected: wp.vec3
    transmitted: wp.vec3
    chosen: float


@wp.func
def film_on(b: Base, cos_m: float, f0: wp.vec3, f90: float) -> wp.vec3:
    """Return by how much the film changes Schlick's reflectance of f0 and f90, so that this stays from 0 to 1."""
    plain = schlick(cos_m, f0, f90)
    with_film = plain + film_change(b.film, cos_m, f0 / wp.max(f90, 1.0e-6)) * f90
    return wp.min(wp.max(with_film, wp.vec3(0.0)), wp.vec3(1.0)) - plain


@specialised()
def make_split(transmits: bool, filmed: bool = False) -> wp.Function:
    """Return the device function (base, wo·m, cosine outside) -> Split; see `make_cos_outside`."""

    @wp.func
    def split(b: Base, cos_m: float, cos_outside: float) -> Split:
        s = Split()
        dielectric = schlick(cos_m, b.f0, b.f90)
        if wp.static(filmed):
            if b.metallic < 1.0:
                dielectric += film_on(b, cos_m, b.f0, b.f90)
        s.chosen = 1.0
        if wp.static(transmits):
            boundary = wp.vec3(1.0)
            if cos_outside >= 0.0:
                boundary = schlick(cos_outside, b.f0, b.f90)
                if wp.static(filmed):
                    boundary += film_on(b, cos_outside, b.f0, b.f90)
            dielectric = wp.lerp(dielectric, boundary, b.transmission)
            if wp.static(filmed):
                s.transmitted = wp.cw_mul(b.color, wp.vec3(1.0) - boundary) * ((1.0 - b.metallic) * b.transmission)
            else:
                s.transmitted = b.color * ((1.0 - b.metallic) * b.transmission * (1.0 - wp.max(boundary)))
        metal = schlick(cos_m, b.color, 1.0)
        if wp.static(filmed):
            if b.metallic > 0.0:
                metal += film_on(b, cos_m, b.color, 1.0)
        s.reflected = wp.lerp(dielectric, metal, b.metallic)
        if wp.static(transmits):
            through = wp.max(s.transmitted)
            if through > 0.0:
                reflected = wp.max(s.reflected)
                s.chosen = reflected / (reflected + through)
        return s

    return split
