"""Gloss by a jittered mirror direction, as textbooks teach distribution ray tracing.

Cook, Porter and Carpenter, "Distributed ray tracing" (1984), in the form of Shirley and Marschner, "Fundamentals
of Computer Graphics" (3rd edition, section 13.4). There are two lobes around the mirror direction r.

"square": a square of side a lies at the tip of r, perpendicular to it, and light comes from a random point in it:

    r' = r + u U + v V,    u, v uniform in ±a/2.

At distance d = 1 / cosα from the shaded point, where α is the angle between r and r', the square's area a² subtends the
solid angle a² cosα / d², so r' has the density 1 / (a² cos³α) per solid angle. V is the axis of the square in the plane
of incidence.

"phong": the lobe of Phong, "Illumination for computer generated pictures" (1975), exactly: the density of r' is
(n + 1) / 2π cosⁿα.

Directions below the surface are lost. The model is defined by its sampler: f cosθi = reflectance · density. It is not
reciprocal, as f(wo, wi) cosθi = f(wi, wo) cosθo except in the square's corners; over all directions of view a surface
may reflect more light than it receives.
"""

import warp as wp

from wrt.kernels.core.bsdf import Bsdf, BsdfSample, Model, no_sample
from wrt.kernels.core.elementary import expm1, exponential, log1p, logarithm, sine_cosine
from wrt.kernels.core.specialise import specialised
from wrt.kernels.sampling.warps import INV_PI, TWO_PI

REFLECTANCE = wp.constant(0)
SIDE = wp.constant(1)  # of "square"
EXPONENT = wp.constant(1)  # of "phong"

LEAST_SIDE = wp.constant(1.0e-4)

ROUNDING = wp.constant(2.0e-7)
"""Tolerance beyond ±a/2 when a direction is evaluated, so that all sampled directions lie in the square."""


@wp.struct
class _Square:
    """The axes of the square, the mirror direction, and half the side."""

    u: wp.vec3
    v: wp.vec3
    r: wp.vec3
    half: float


@wp.func
def _square_of(bsdf: Bsdf, wo: wp.vec3) -> _Square:
    """Return the square for a viewer."""
    square = _Square()
    square.r = wp.vec3(-wo[0], -wo[1], wo[2])
    square.u = wp.vec3(0.0, 1.0, 0.0)
    sin_o = wp.sqrt(wo[0] * wo[0] + wo[1] * wo[1])
    if sin_o > 0.0:
        square.u = wp.vec3(wo[1] / sin_o, -wo[0] / sin_o, 0.0)
    square.v = wp.cross(square.r, square.u)
    square.half = 0.5 * wp.max(bsdf.slots[SIDE][0], LEAST_SIDE) + ROUNDING
    return square


@wp.func
def _density(square: _Square, wi: wp.vec3) -> float:
    """Return 1 / (a² cos³α) in the square, and 0 outside."""
    cos_a = wp.dot(wi, square.r)
    if cos_a <= 0.0:
        return 0.0
    if wp.max(wp.abs(wp.dot(wi, square.u)), wp.abs(wp.dot(wi, square.v))) > square.half * cos_a:
        return 0.0
    side = 2.0 * square.half
    return 1.0 / (side * side * cos_a * cos_a * cos_a)


@wp.func
def pdf_square(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
    """Return the density of `sample_square` per solid angle; directions lost below the surface are missing."""
    if wi[2] <= 0.0:
        return 0.0
    return _density(_square_of(bsdf, wo), wi)


@wp.func
def sample_square(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    """Return the direction to a uniform point in the square."""
    square = _square_of(bsdf, wo)
    side = 2.0 * (square.half - ROUNDING)
    s = no_sample()
    s.wi = wp.normalize(square.r + square.u * ((u[0] - 0.5) * side) + square.v * ((u[1] - 0.5) * side))
    if s.wi[2] > 0.0:
        s.pdf = _density(square, s.wi)
        s.weight = bsdf.slots[REFLECTANCE]
    return s


@wp.func
def pdf_phong(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
    """Return the density of `sample_phong` per solid angle; directions lost below the surface are missing."""
    if wi[2] <= 0.0:
        return 0.0
    off = wi - wp.vec3(-wo[0], -wo[1], wo[2])
    one_minus_cos = 0.5 * wp.dot(off, off)  # with all digits where α is small
    if one_minus_cos >= 1.0:
        return 0.0
    exponent = bsdf.slots[EXPONENT][0]
    return (exponent + 1.0) * (0.5 * INV_PI) * exponential(exponent * log1p(-one_minus_cos))


@wp.func
def sample_phong(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    """Return a direction of the lobe: cosα = u^(1/(n + 1))."""
    square = _square_of(bsdf, wo)
    one_minus_cos = -expm1(logarithm(1.0 - u[0]) / (bsdf.slots[EXPONENT][0] + 1.0))
    sin_a = wp.sqrt(one_minus_cos * (2.0 - one_minus_cos))
    turned = sine_cosine(TWO_PI * u[1])
    s = no_sample()
    cos_a = 1.0 - one_minus_cos
    s.wi = wp.normalize(square.r * cos_a + square.u * (sin_a * turned[1]) + square.v * (sin_a * turned[0]))
    s.pdf = pdf_phong(bsdf, wo, s.wi)
    if s.pdf > 0.0:
        s.weight = bsdf.slots[REFLECTANCE]
    return s


@specialised()
def make_glossy(lobe: str = "square") -> Model:
    """Return the model with the lobe "square" or "phong".

    Raises:
        ValueError: for another name.
    """
    if lobe not in ("square", "phong"):
        raise ValueError(f"no gloss of {lobe!r}")
    pdf, sample = (pdf_phong, sample_phong) if lobe == "phong" else (pdf_square, sample_square)

    @wp.func
    def evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
        return bsdf.slots[REFLECTANCE] * pdf(bsdf, wo, wi)

    return Model(evaluate, pdf, sample, slots=2, jitters=True)
