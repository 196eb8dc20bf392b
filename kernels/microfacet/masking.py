"""Masking-shadowing G(wo, wi, m): the share of microfacets with normal m that both directions see.

Directions on different sides of the surface belong to refraction: every G but the implicit one then uses each
direction's own angle to m. G is 0 if a direction sees the back of m.
"""

import warp as wp

from wrt.kernels.core.elementary import exponential, log1p, logarithm
from wrt.kernels.core.specialise import specialised
from wrt.kernels.microfacet.beckmann import stretched_cotangent

HALF_LOG_TWO_PI = wp.constant(0.918938533204673)


@wp.func
def sees(w: wp.vec3, m: wp.vec3) -> bool:
    """Return whether w is on the same side of the microfacet as of the macrosurface."""
    return wp.dot(w, m) * w[2] > 0.0


# --- Smith (1967): slopes at a point and heights around it are independent -------------------------


@wp.func
def _stirling(x: float) -> float:
    """Return the remainder of Stirling's formula for ln Γ(x), to 3e-7 for x ≥ 3 (Abramowitz and Stegun, 6.1.41)."""
    y = 1.0 / (x * x)
    return (1.0 / 12.0 - y * (1.0 / 360.0 - y * (1.0 / 1260.0))) / x


@wp.func
def beta_from_one(a: float, b: float) -> float:
    """Return Euler's beta function B(1 + a, 1 + b) for a, b ≥ 0, symmetric to the last bit.

    Uses Stirling's formula at arguments two higher, then Γ(x + 1) = x Γ(x) twice.
    """
    low = 1.0 + wp.min(a, b)
    high = 1.0 + wp.max(a, b)
    x = low + 2.0
    y = high + 2.0
    s = x + y
    log_beta = (x - 0.5) * logarithm(x / s) + (y - 0.5) * log1p(-x / s) - 0.5 * logarithm(s)
    log_beta += HALF_LOG_TWO_PI + _stirling(x) + _stirling(y) - _stirling(s)
    n = low + high
    log_beta += logarithm(n / low) + logarithm((n + 1.0) / (low + 1.0))
    log_beta += logarithm((n + 2.0) / high) + logarithm((n + 3.0) / (high + 1.0))
    return wp.min(exponential(log_beta), 1.0)


@wp.func
def correlated(a: float, b: float, same_side: bool) -> float:
    """Return Smith's height-correlated G from Λ of both directions.

    On one side of the surface, both directions see high microfacets better: 1 / (1 + a + b) (Heitz 2014, eq. 99). A
    point high on one side is low on the other: B(1 + a, 1 + b) (Heitz, Hanika, d'Eon and Dachsbacher 2016).
    """
    if same_side:
        return 1.0 / (1.0 + (a + b))
    return beta_from_one(a, b)


def smith(smith_lambda: wp.Function, shape_type: type = wp.vec3) -> wp.Function:
    """Return the height-correlated form for a distribution with this Λ(w, shape)."""

    @wp.func
    def g(wo: wp.vec3, wi: wp.vec3, m: wp.vec3, shape: shape_type) -> float:
        if not sees(wo, m) or not sees(wi, m):
            return 0.0
        return correlated(smith_lambda(wo, shape), smith_lambda(wi, shape), wo[2] * wi[2] > 0.0)

    return g


def smith_separable(smith_lambda: wp.Function) -> wp.Function:
    """Return the separable form, the product of Smith's G1 for both directions (Walter 2007, eq. 23)."""

    @wp.func
    def g1(w: wp.vec3, m: wp.vec3, shape: wp.vec3) -> float:
        if not sees(w, m):
            return 0.0
        return 1.0 / (1.0 + smith_lambda(w, shape))

    @wp.func
    def g(wo: wp.vec3, wi: wp.vec3, m: wp.vec3, shape: wp.vec3) -> float:
        return g1(wo, m, shape) * g1(wi, m, shape)

    return g


@wp.func
def g1_walter(w: wp.vec3, m: wp.vec3, shape: wp.vec3) -> float:
    """Return a rational fit to Smith's G1 for Beckmann's distribution: Walter 2007, eq. 27; exceeds 1 by up to 6e-5."""
    if not sees(w, m):
        return 0.0
    a = stretched_cotangent(w, shape)
    if a >= 1.6:
        return 1.0
    return wp.min((3.535 + 2.181 * a) * a / (1.0 + (2.276 + 2.577 * a) * a), 1.0)


@wp.func
def g_walter(wo: wp.vec3, wi: wp.vec3, m: wp.vec3, shape: wp.vec3) -> float:
    """Return the product of both G1: Walter 2007, eq. 23."""
    return g1_walter(wo, m, shape) * g1_walter(wi, m, shape)


# --- Maskings that do not depend on the distribution ------------------------------------------------


@wp.func
def g1_cook_torrance(w: wp.vec3, m: wp.vec3, shape: wp.vec3) -> float:
    """Return the visible share of one side of a symmetric V-shaped groove (Torrance and Sparrow 1967)."""
    if not sees(w, m):
        return 0.0
    return wp.min(2.0 * wp.abs(m[2]) * wp.abs(w[2]) / wp.max(wp.abs(wp.dot(w, m)), 1.0e-20), 1.0)


@wp.func
def g_cook_torrance(wo: wp.vec3, wi: wp.vec3, m: wp.vec3, shape: wp.vec3) -> float:
    """Return the smaller G1 of the two directions (Cook and Torrance 1982)."""
    return wp.min(g1_cook_torrance(wo, m, shape), g1_cook_torrance(wi, m, shape))


@wp.func
def g_kelemen(wo: wp.vec3, wi: wp.vec3, m: wp.vec3, shape: wp.vec3) -> float:
    """Return cosθo cosθi / (wo·m)², hence G / (cosθo cosθi) = 1 / (wo·m)² = 2 / (1 + wo·wi).

    Kelemen and Szirmay-Kalos 2001. For reflection it is at most 1, as the mean of both cosines is (wo·m) cosθm; for
    refraction it is clamped to 1.
    """
    if not sees(wo, m) or not sees(wi, m):
        return 0.0
    angles = wp.abs(wp.dot(wo, m)) * wp.abs(wp.dot(wi, m))
    return wp.min(wp.abs(wo[2] * wi[2]) / wp.max(angles, 1.0e-20), 1.0)


@wp.func
def g1_implicit(w: wp.vec3, m: wp.vec3, shape: wp.vec3) -> float:
    """Return |cosθ|."""
    if not sees(w, m):
        return 0.0
    return wp.abs(w[2])


@wp.func
def g_implicit(wo: wp.vec3, wi: wp.vec3, m: wp.vec3, shape: wp.vec3) -> float:
    """Return |cosθo cosθi|, which cancels the cosines of the reflection model (Hoffman, SIGGRAPH 2014 course)."""
    return g1_implicit(wo, m, shape) * g1_implicit(wi, m, shape)


# --- By name ----------------------------------------------------------------------------------------

SMITH = {"smith": smith, "smith-separable": smith_separable}
"""For distributions with a closed-form Λ: height-correlated and separable."""

WALTER = {"walter": g_walter}
"""For distributions with Beckmann's Λ."""

GENERAL = {"cook-torrance": g_cook_torrance, "kelemen": g_kelemen, "implicit": g_implicit}
"""For every distribution."""


@specialised()
def make_masking(masking: str, distribution: str, smith_lambda: wp.Function | None, gaussian: bool) -> wp.Function:
    """Return g(wo, wi, m, shape) of a kind of masking for one distribution.

    Args:
        masking: a key of SMITH, WALTER or GENERAL.
        distribution: its name, for errors.
        smith_lambda: Λ(w, shape), or None where there is no closed form.
        gaussian: whether that Λ is Beckmann's.

    Raises:
        ValueError: if the masking is unknown or does not go with the distribution.
    """
    if masking in GENERAL:
        return GENERAL[masking]
    if masking in WALTER and gaussian:
        return WALTER[masking]
    if masking in SMITH and smith_lambda is not None:
        return SMITH[masking](smith_lambda)
    if masking not in SMITH and masking not in WALTER:
        raise ValueError(f"no masking {masking!r}: there are {', '.join([*SMITH, *WALTER, *GENERAL])}")
    raise ValueError(f"masking {masking!r} is not known for the distribution {distribution!r}")
