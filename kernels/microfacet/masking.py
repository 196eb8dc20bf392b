"""Shadowing and masking G(wo, wi, m): how much of the microfacets of normal m both directions see.

Directions on different sides of the surface are those of refraction: every G but the implicit one then takes each
direction's own angle to m. 0 where a direction sees m from the back.
"""

import functools
from typing import NamedTuple

import warp as wp

from wrt.kernels.exponential import exponential, logarithm
from wrt.kernels.microfacet.beckmann import stretched_cotangent
from wrt.kernels.microfacet.numerics import log1p

HALF_LOG_TWO_PI = wp.constant(0.918938533204673)


class Masking(NamedTuple):
    """The two functions of a kind of masking: g(wo, wi, m, shape), and g1(w, m, shape) of one direction alone."""

    g: wp.Function
    g1: wp.Function


@wp.func
def sees(w: wp.vec3, m: wp.vec3) -> bool:
    """Return whether w is on the same side of the microfacet as of the surface."""
    return wp.dot(w, m) * w[2] > 0.0


# --- Smith (1967): slopes at a point and heights around it are independent -------------------------


@wp.func
def _stirling(x: float) -> float:
    """Return what Stirling's formula for ln Γ(x) leaves out; to 3e-7 for x ≥ 3 (Abramowitz and Stegun, 6.1.41)."""
    y = 1.0 / (x * x)
    return (1.0 / 12.0 - y * (1.0 / 360.0 - y * (1.0 / 1260.0))) / x


@wp.func
def beta_from_one(a: float, b: float) -> float:
    """Return Euler's beta function B(1 + a, 1 + b) for a, b ≥ 0, symmetric to the last bit.

    By Stirling's formula at arguments two higher, and Γ(x + 1) = x Γ(x) back down.
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
    """Return Smith's G from Λ of both directions, a microfacet's height having one value for both.

    High microfacets are seen more from both directions on one side: 1 / (1 + a + b) (Heitz 2014, eq. 99). What is high
    on one side is low on the other: B(1 + a, 1 + b) (Heitz, Hanika, d'Eon and Dachsbacher 2016).
    """
    if same_side:
        return 1.0 / (1.0 + (a + b))
    return beta_from_one(a, b)


def _smith(name: str, smith_lambda: wp.Function) -> Masking:
    @wp.func(name=f"g1_smith_{name}")
    def g1(w: wp.vec3, m: wp.vec3, shape: wp.vec3) -> float:
        if not sees(w, m):
            return 0.0
        return 1.0 / (1.0 + smith_lambda(w, shape))

    @wp.func(name=f"g_smith_{name}")
    def g(wo: wp.vec3, wi: wp.vec3, m: wp.vec3, shape: wp.vec3) -> float:
        if not sees(wo, m) or not sees(wi, m):
            return 0.0
        return correlated(smith_lambda(wo, shape), smith_lambda(wi, shape), wo[2] * wi[2] > 0.0)

    return Masking(g, g1)


def _smith_separable(name: str, smith_lambda: wp.Function) -> Masking:
    """Return Smith's G1 of both directions multiplied (Walter 2007, eq. 23)."""
    g1 = _smith(name, smith_lambda).g1

    @wp.func(name=f"g_smith_separable_{name}")
    def g(wo: wp.vec3, wi: wp.vec3, m: wp.vec3, shape: wp.vec3) -> float:
        return g1(wo, m, shape) * g1(wi, m, shape)

    return Masking(g, g1)


@wp.func
def g1_walter(w: wp.vec3, m: wp.vec3, shape: wp.vec3) -> float:
    """Return Smith's G1 of Beckmann's distribution by a rational fit: Walter 2007, eq. 27, which passes 1 by 6e-5."""
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


# --- Others, which know nothing of the distribution -------------------------------------------------


@wp.func
def g1_cook_torrance(w: wp.vec3, m: wp.vec3, shape: wp.vec3) -> float:
    """Return what one side of a symmetric V-shaped groove hides of the other (Torrance and Sparrow 1967)."""
    if not sees(w, m):
        return 0.0
    return wp.min(2.0 * wp.abs(m[2]) * wp.abs(w[2]) / wp.max(wp.abs(wp.dot(w, m)), 1.0e-20), 1.0)


@wp.func
def g_cook_torrance(wo: wp.vec3, wi: wp.vec3, m: wp.vec3, shape: wp.vec3) -> float:
    """Return the smaller of what both directions see: Cook and Torrance 1982."""
    return wp.min(g1_cook_torrance(wo, m, shape), g1_cook_torrance(wi, m, shape))


@wp.func
def g1_kelemen(w: wp.vec3, m: wp.vec3, shape: wp.vec3) -> float:
    """Return |cosθ / w·m|, at most 1: a direction's share of `g_kelemen`, which is not the product of two such."""
    if not sees(w, m):
        return 0.0
    return wp.min(wp.abs(w[2]) / wp.max(wp.abs(wp.dot(w, m)), 1.0e-20), 1.0)


@wp.func
def g_kelemen(wo: wp.vec3, wi: wp.vec3, m: wp.vec3, shape: wp.vec3) -> float:
    """Return cosθo cosθi / (wo·m)², and so G / (cosθo cosθi) = 1 / (wo·m)² = 2 / (1 + wo·wi).

    Kelemen and Szirmay-Kalos 2001. On reflection it is at most 1, as the mean of both cosines is (wo·m) cosθm; on
    refraction it is cut there.
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

SMITH = {"smith": _smith, "smith-separable": _smith_separable}
"""For distributions whose Λ is known in closed form; height-correlated, and not."""

WALTER = {"walter": Masking(g_walter, g1_walter)}
"""For Beckmann's distribution and those that borrow its Λ."""

GENERAL = {
    "cook-torrance": Masking(g_cook_torrance, g1_cook_torrance),
    "kelemen": Masking(g_kelemen, g1_kelemen),
    "implicit": Masking(g_implicit, g1_implicit),
}
"""For every distribution."""


@functools.cache
def make_masking(masking: str, distribution: str, smith_lambda: wp.Function | None, gaussian: bool) -> Masking:
    """Return the functions of a kind of masking for one distribution.

    Args:
        masking: a key of SMITH, WALTER or GENERAL.
        distribution: its name, for the names of the functions and of errors.
        smith_lambda: Λ(w, shape), or None where there is no closed form.
        gaussian: whether that Λ is Beckmann's.

    Raises:
        ValueError: where the two do not go together, or there is no such masking.
    """
    if masking in GENERAL:
        return GENERAL[masking]
    if masking in WALTER and gaussian:
        return WALTER[masking]
    if masking in SMITH and smith_lambda is not None:
        return SMITH[masking](distribution.replace("-", "_"), smith_lambda)
    if masking not in SMITH and masking not in WALTER:
        raise ValueError(f"no masking {masking!r}: there are {', '.join([*SMITH, *WALTER, *GENERAL])}")
    raise ValueError(f"masking {masking!r} is not known for the distribution {distribution!r}")
