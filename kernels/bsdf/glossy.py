"""Gloss by a jittered mirror direction: distribution ray tracing as it is taught.

Cook, Porter and Carpenter, "Distributed ray tracing" (1984), in the form of Shirley and Marschner, "Fundamentals
of Computer Graphics" (3rd edition, section 13.4). A square of side a lies at the tip of the mirrored direction r,
perpendicular to it, and light comes from a random point of it:

    r' = r + u U + v V,    u, v uniform in ±a/2.

At distance d = 1 / cosα from the viewed point, α the angle between r and r', the square's area a² fills the solid
angle a² cosα / d², so that r' has the density 1 / (a² cos³α) per solid angle. What falls below the surface is lost.

The model is defined by its sampler: f cosθi = reflectance · density. It is not reciprocal, as
f(wo, wi) cosθi = f(wi, wo) cosθo but for the square's corners; from all directions of view together a surface may
send back more than it got. V is the axis of the square in the plane of incidence.
"""

import warp as wp

from wrt.kernels.bsdf.record import Bsdf, BsdfSample, Model, no_sample

REFLECTANCE = wp.constant(0)
SIDE = wp.constant(1)

LEAST_SIDE = wp.constant(1.0e-4)

ROUNDING = wp.constant(2.0e-7)
"""How far the square reaches beyond ±a/2 when a direction is looked up, so that all that are drawn lie in it."""


@wp.struct
class _Square:
    """The axes of the square, the mirrored direction, and half the side."""

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
def evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
    """Return f |cosθi|."""
    return bsdf.slots[REFLECTANCE] * pdf(bsdf, wo, wi)


@wp.func
def pdf(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
    """Return the density of `sample` per solid angle; it lacks what falls below the surface."""
    if wi[2] <= 0.0:
        return 0.0
    return _density(_square_of(bsdf, wo), wi)


@wp.func
def sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    """Return the direction of a uniform point in the square."""
    square = _square_of(bsdf, wo)
    side = 2.0 * (square.half - ROUNDING)
    s = no_sample()
    s.wi = wp.normalize(square.r + square.u * ((u[0] - 0.5) * side) + square.v * ((u[1] - 0.5) * side))
    if s.wi[2] > 0.0:
        s.pdf = _density(square, s.wi)
        s.weight = bsdf.slots[REFLECTANCE]
    return s


MODEL = Model(evaluate, pdf, sample, slots=2)
