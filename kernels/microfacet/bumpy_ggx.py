"""GGX facets on bumps too small to see, as a filtered normal map leaves them.

Slopes of facets and bumps add, so their distribution is the convolution of both. GGX is a mixture of Beckmann's
distributions, of roughness α/√t with t exponential:

    1 / (π α² (1 + s²/α²)²) = ∫ exp(−t) exp(−t s²/α²) t / (π α²) dt,

and Gaussian bumps of variance σ² turn each of them into one of α²/t + 2σ². The convolution has no closed form. Here it
is one GGX and three Beckmann distributions, whose weights and roughnesses follow σ/α along both axes. No single GGX is
near: one of α² + 2σ² is 24 % too bright in the middle at σ = α, and 20 % too dark beside it.

Smith's Λ is linear in the distribution, and so are visible areas: masking, visible normals and their density are exact
for the mixture. `docs/notes/filtered-highlights.md` has the fit and its errors.
"""

import warp as wp

from wrt.kernels.core.elementary import exponential, logarithm
from wrt.kernels.core.specialise import specialised
from wrt.kernels.microfacet import beckmann, ggx
from wrt.kernels.microfacet.masking import GENERAL, SMITH, sees, smith
from wrt.kernels.microfacet.widening import widened
from wrt.kernels.sampling.warps import BELOW_ONE

GGX_OWN = wp.constant(0.190711)  # by which α² of the GGX grows for all the weight that it lacks
GGX_BUMPS = wp.constant(0.555)  # logarithm of its share of 2σ²; by its weight more
GGX_BUMPS_BY_WEIGHT = wp.constant(-0.910)

ENERGY_SHARE = wp.constant(0.2)
"""The share of the bumps' 2σ² that, added to α² of GGX, makes it lose as much energy as the mixture, within 3 %. More
of it would take too little from the layers below; the mixture's tails are those of the facets alone."""


@wp.struct
class BumpyShape:
    """A GGX and three Beckmann distributions: roughnesses along x and y, and weights, GGX first."""

    ggx: wp.vec3
    first: wp.vec3
    second: wp.vec3
    third: wp.vec3
    weights: wp.vec4


@wp.struct
class Bumps:
    """2σ² along x and y, α² of the facets along them, and the three parameters of the fit."""

    squares: wp.vec2
    facets: wp.vec2
    mean: float
    log_m: float
    along: float


@wp.func
def beckmann_shape(bumps: Bumps, log_share: float, power: float) -> wp.vec3:
    """Return the shape of a Beckmann distribution with this logarithm of its share of α² at σ = 0."""
    share = exponential(log_share + power * bumps.log_m)
    x = bumps.facets[0] * share + bumps.squares[0]
    y = bumps.facets[1] * share + bumps.squares[1]
    return wp.vec3(wp.sqrt(x), wp.sqrt(y), 0.0)


@wp.func
def beckmann_weight(bumps: Bumps, weight: float, fall: float, turn: float) -> float:
    """Return its weight over the weight of the GGX."""
    return bumps.mean * exponential(weight + fall * bumps.log_m + turn * bumps.along)


@wp.func
def rough_as_bumpy(alpha: wp.vec3, variance: wp.vec2) -> wp.vec3:
    """Return the shape of GGX that loses about as much energy as facets on bumps of this variance along x and y."""
    return widened(alpha, variance * ENERGY_SHARE)


@wp.func
def bumpy_shape(alpha: wp.vec3, as_bumpy: wp.vec3) -> BumpyShape:
    """Return the shape of facets of roughness `alpha` on bumps, from `rough_as_bumpy`.

    With X = 2σ²/α² along either axis, m = √((1 + X)(1 + Y)) and v = 1 − m / (1 + (X + Y)/2), a Beckmann distribution
    has 2σ² + α² exp(a) m^b in place of α², and (X + Y)/2 exp(c + d ln m + e v) times the weight of the GGX, which has
    α² (1 + GGX_OWN Σ weights) + 2σ² exp(f + g w), w its weight.
    """
    shape = BumpyShape()
    shape.ggx = alpha
    shape.weights = wp.vec4(1.0, 0.0, 0.0, 0.0)
    if as_bumpy[0] == alpha[0] and as_bumpy[1] == alpha[1]:
        return shape
    bumps = Bumps()
    facets = wp.vec2(alpha[0] * alpha[0], alpha[1] * alpha[1])
    x = wp.max(as_bumpy[0] * as_bumpy[0] - facets[0], 0.0) / ENERGY_SHARE
    y = wp.max(as_bumpy[1] * as_bumpy[1] - facets[1], 0.0) / ENERGY_SHARE
    ratio_x = x / facets[0]
    ratio_y = y / facets[1]
    m2 = (1.0 + ratio_x) * (1.0 + ratio_y)
    bumps.squares = wp.vec2(x, y)
    bumps.facets = facets
    bumps.mean = 0.5 * (ratio_x + ratio_y)
    bumps.log_m = 0.5 * logarithm(m2)
    bumps.along = 1.0 - wp.sqrt(m2) / (1.0 + bumps.mean)
    shape.first = beckmann_shape(bumps, -0.966, 0.254)
    shape.second = beckmann_shape(bumps, 0.258, 0.480)
    shape.third = beckmann_shape(bumps, 2.115, 0.592)
    first = beckmann_weight(bumps, 1.272, -0.370, 0.439)
    second = beckmann_weight(bumps, 1.964, -0.811, 0.441)
    third = beckmann_weight(bumps, 1.136, -1.325, 0.739)
    total = 1.0 + first + second + third
    shape.weights = wp.vec4(1.0 / total, first / total, second / total, third / total)
    facet_share = 1.0 + GGX_OWN * (total - 1.0)
    bumps_share = exponential(GGX_BUMPS + GGX_BUMPS_BY_WEIGHT / total)
    x = facets[0] * facet_share + x * bumps_share
    y = facets[1] * facet_share + y * bumps_share
    shape.ggx = wp.vec3(wp.sqrt(x), wp.sqrt(y), 0.0)
    return shape


@wp.func
def d(m: wp.vec3, shape: BumpyShape) -> float:
    """Return D(m)."""
    total = shape.weights[0] * ggx.d(m, shape.ggx)
    if shape.weights[0] < 1.0:
        total += shape.weights[1] * beckmann.d(m, shape.first)
        total += shape.weights[2] * beckmann.d(m, shape.second)
        total += shape.weights[3] * beckmann.d(m, shape.third)
    return total


@wp.func
def smith_lambda(w: wp.vec3, shape: BumpyShape) -> float:
    """Return Λ(w), the ratio of masked to visible area."""
    total = shape.weights[0] * ggx.smith_lambda(w, shape.ggx)
    if shape.weights[0] < 1.0:
        total += shape.weights[1] * beckmann.smith_lambda(w, shape.first)
        total += shape.weights[2] * beckmann.smith_lambda(w, shape.second)
        total += shape.weights[3] * beckmann.smith_lambda(w, shape.third)
    return total


@wp.func
def areas(w: wp.vec3, shape: BumpyShape) -> wp.vec4:
    """Return what each distribution adds to the area of visible and masked facets projected along w."""
    of_ggx = shape.weights[0] * ggx.projected_area(w, shape.ggx)
    first = float(0.0)
    second = float(0.0)
    third = float(0.0)
    if shape.weights[0] < 1.0:
        first = shape.weights[1] * beckmann.projected_area(w, shape.first)
        second = shape.weights[2] * beckmann.projected_area(w, shape.second)
        third = shape.weights[3] * beckmann.projected_area(w, shape.third)
    return wp.vec4(of_ggx, first, second, third)


@wp.func
def projected_area(w: wp.vec3, shape: BumpyShape) -> float:
    """Return the sum of `areas`, cosθ (1 + Λ(w))."""
    found = areas(w, shape)
    return found[0] + found[1] + found[2] + found[3]


@wp.func
def normal_pdf(wo: wp.vec3, m: wp.vec3, shape: BumpyShape) -> float:
    """Return the density of visible normals, G1(wo) max(0, wo·m) D(m) / cosθo (Heitz 2018, eq. 3)."""
    return d(m, shape) * wp.max(wp.dot(wo, m), 0.0) / projected_area(wo, shape)


@wp.func
def sample_normal(wo: wp.vec3, shape: BumpyShape, u: wp.vec2) -> wp.vec3:
    """Return a visible normal: of one of the distributions, each as likely as its visible area."""
    found = areas(wo, shape)
    chosen = u[0] * (found[0] + found[1] + found[2] + found[3])
    if chosen < found[0]:
        return ggx.sample_normal(wo, shape.ggx, wp.vec2(chosen / found[0], u[1]))
    offset = chosen - found[0]
    size = found[1]
    lobe = shape.first
    if offset >= found[1]:
        offset -= found[1]
        size = found[2]
        lobe = shape.second
        if offset >= found[2]:
            offset -= found[2]
            size = found[3]
            lobe = shape.third
    x = wp.clamp(offset / wp.max(size, 1.0e-30), 0.0, BELOW_ONE)
    return beckmann.sample_normal(wo, lobe, wp.vec2(x, u[1]))


@specialised()
def make_bumpy_masking(masking: str) -> wp.Function:
    """Return g(wo, wi, m, shape) of a kind of masking, with Λ of the mixture where it depends on the distribution.

    Raises:
        ValueError: if it does not go with GGX.
    """
    if masking not in (*GENERAL, *SMITH):
        raise ValueError(f"masking {masking!r} is not known for the distribution 'bumpy-ggx'")
    if masking == "smith":
        return smith(smith_lambda, BumpyShape)
    if masking in GENERAL:
        general = GENERAL[masking]

        @wp.func
        def g_general(wo: wp.vec3, wi: wp.vec3, m: wp.vec3, shape: BumpyShape) -> float:
            return general(wo, wi, m, shape.ggx)

        return g_general

    @wp.func
    def separable(wo: wp.vec3, wi: wp.vec3, m: wp.vec3, shape: BumpyShape) -> float:
        if not sees(wo, m) or not sees(wi, m):
            return 0.0
        return 1.0 / ((1.0 + smith_lambda(wo, shape)) * (1.0 + smith_lambda(wi, shape)))

    return separable
