"""Beckmann's distribution: slopes are Gaussian (Beckmann and Spizzichino 1963; Walter et al. 2007).

Anisotropic: shape = (αu, αv, 0), of root-mean-square slopes αu/√2 along x and αv/√2 along y.
"""

import warp as wp

from wrt.kernels.core.elementary import exponential, logarithm
from wrt.kernels.sampling.warps import PI

INV_SQRT_PI = wp.constant(0.564189583547756)
MOST_SLOPE = wp.constant(4.0)
"""Slopes beyond this, in units of α, have a probability of 1.5e-8, less than the smallest random number."""

STEPS = wp.constant(24)


@wp.func
def d(m: wp.vec3, shape: wp.vec3) -> float:
    """Return D(m): Walter 2007, eq. 25, stretched along x and y (Heitz 2014, section 5)."""
    if m[2] <= 0.0:
        return 0.0
    cos2 = m[2] * m[2]
    x = m[0] / shape[0]
    y = m[1] / shape[1]
    e = (x * x + y * y) / wp.max(cos2, 1.0e-30)
    if e > 80.0:
        return 0.0
    return exponential(-e) / (PI * shape[0] * shape[1] * cos2 * cos2)


@wp.func
def stretched_cotangent(w: wp.vec3, shape: wp.vec3) -> float:
    """Return a = 1 / (α tanθ), α the roughness towards w (Heitz 2014, section 5).

    At most 10: beyond 5, masking is below the precision of float32.
    """
    x = shape[0] * w[0]
    y = shape[1] * w[1]
    return wp.abs(w[2]) / wp.max(wp.sqrt(x * x + y * y), 0.1 * wp.abs(w[2]) + 1.0e-30)


@wp.func
def smith_lambda(w: wp.vec3, shape: wp.vec3) -> float:
    """Return Λ(w) (Heitz 2014, section 5), with erf(a) − 1 = −erfc(a)."""
    a = wp.max(stretched_cotangent(w, shape), 1.0e-15)
    return 0.5 * wp.max(INV_SQRT_PI * exponential(-a * a) / a - wp.erfc(a), 0.0)


@wp.func
def projected_area(w: wp.vec3, shape: wp.vec3) -> float:
    """Return the area of visible and masked facets projected along w, cosθ (1 + Λ(w)), finite at grazing angles."""
    x = shape[0] * w[0]
    y = shape[1] * w[1]
    a = stretched_cotangent(w, shape)
    return 0.5 * (w[2] * (1.0 + wp.erf(a)) + INV_SQRT_PI * wp.sqrt(x * x + y * y) * exponential(-a * a))


@wp.func
def normal_pdf(wo: wp.vec3, m: wp.vec3, shape: wp.vec3) -> float:
    """Return the density of visible normals, G1(wo) max(0, wo·m) D(m) / cosθo (Heitz 2014, eq. 14)."""
    return d(m, shape) * wp.max(wp.dot(wo, m), 0.0) / projected_area(wo, shape)


@wp.func
def _visible_below(x: float, cos_o: float, sin_o: float) -> float:
    """Return twice the visible area of slopes up to x at α = 1, ∫ (cosθ − x sinθ) 2 exp(−x²)/√π dx."""
    return cos_o * wp.erfc(-x) + sin_o * INV_SQRT_PI * exponential(-x * x)


@wp.func
def sample_visible_slope(u: float, cos_o: float, sin_o: float) -> float:
    """Return a slope in the plane of the viewer at α = 1, with density ∝ max(0, cosθ − x sinθ) exp(−x²).

    The cumulative distribution has a closed form (Heitz and d'Eon 2014, supplement) and is inverted by Newton's method,
    as in Jakob, "An improved visible normal sampling routine for the Beckmann distribution" (2014). Here the iteration
    starts at the peak of the density. Above it the function is concave, so no step passes the root; below it its
    logarithm is, as the density is log-concave.
    """
    most = float(MOST_SLOPE)
    if cos_o < MOST_SLOPE * sin_o:
        most = cos_o / sin_o
    # The root of 0 = d/dx (cosθ − x sinθ) exp(−x²), without cancellation.
    x = -sin_o / (cos_o + wp.sqrt(cos_o * cos_o + 2.0 * sin_o * sin_o))
    target = wp.max(u, 2.0e-8) * _visible_below(most, cos_o, sin_o)
    before = target < _visible_below(x, cos_o, sin_o)
    x = float(x)
    for _ in range(STEPS):
        area = _visible_below(x, cos_o, sin_o)
        density = 2.0 * INV_SQRT_PI * (cos_o - x * sin_o) * exponential(-x * x)
        step = target - area
        if before:
            step = logarithm(target / area) * area
        step = step / wp.max(density, 1.0e-20)
        moved = wp.clamp(x + step, -5.0, most)
        change = wp.abs(moved - x)
        x = moved
        if change < 1.0e-5:
            break
    return x


@wp.func
def sample_normal(wo: wp.vec3, shape: wp.vec3, u: wp.vec2) -> wp.vec3:
    """Return a visible normal: stretch the viewer to α = 1, sample slopes there, and stretch them back.

    Heitz and d'Eon 2014, "Importance sampling microfacet-based BSDFs using the distribution of visible normals".
    """
    w = wp.normalize(wp.vec3(shape[0] * wo[0], shape[1] * wo[1], wo[2]))
    sin_o = wp.sqrt(w[0] * w[0] + w[1] * w[1])
    cos_phi = float(1.0)
    sin_phi = float(0.0)
    if sin_o > 1.0e-10:
        cos_phi = w[0] / sin_o
        sin_phi = w[1] / sin_o
    x = sample_visible_slope(u[0], w[2], sin_o)
    # Across the plane of the viewer slopes have their plain distribution.
    y = wp.erfinv(wp.clamp(2.0 * u[1] - 1.0, -0.9999999, 0.9999999))
    slope_x = shape[0] * (cos_phi * x - sin_phi * y)
    slope_y = shape[1] * (sin_phi * x + cos_phi * y)
    return wp.normalize(wp.vec3(-slope_x, -slope_y, 1.0))
