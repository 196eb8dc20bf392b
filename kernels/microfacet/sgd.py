"""The shifted gamma distribution (Bagher, Soler and Holzschuch 2012): slopes fitted to measured materials.

shape = (α, p, K). D = P22(tan²θ) / (π cos⁴θ), and with x = tan²θ

    P22(x) = α^(p − 1) / Γ(1 − p, α) · exp(−(α² + x) / α) / (α² + x)^p.

As dx = 2 tanθ / cos²θ dθ, ∫ D cosθ dω = ∫ P22 dx = 1. The incomplete gamma function costs too much for every ray, so
the host passes K = P22(0) = 1 / (α² exp(α) E_p(α)), E_p(α) = α^(p − 1) Γ(1 − p, α) (`sgd_normalization`), and

    P22(x) = K exp(−x / α) (1 + x / α²)^−p.

At p = 0 this is Beckmann's distribution of roughness √α.
"""

import warp as wp

from wrt.kernels.core.elementary import (
    exponential,
    log1p,
    logarithm,
    normal_of,
    power_integral,
    power_integral_inverse,
    tan2_theta,
)
from wrt.kernels.sampling.warps import INV_PI

INV_E = wp.constant(0.367879441171442)


@wp.func
def d(m: wp.vec3, shape: wp.vec3) -> float:
    """Return D(m)."""
    alpha = shape[0]
    t = tan2_theta(m)
    e = t / alpha
    if m[2] <= 0.0 or e > 80.0:
        return 0.0
    cos2 = m[2] * m[2]
    return INV_PI * shape[2] * exponential(-e - shape[1] * log1p(e / alpha)) / (cos2 * cos2)


@wp.func
def _areas(shape: wp.vec3) -> wp.vec2:
    """Return the integrals of the two parts of the density of `sample_normal`, over s = x / α²."""
    alpha = shape[0]
    log_end = log1p(1.0 / alpha)
    return wp.vec2(power_integral(1.0 - shape[1], log_end), INV_E * exponential(-shape[1] * log_end) / alpha)


@wp.func
def normal_pdf(wo: wp.vec3, m: wp.vec3, shape: wp.vec3) -> float:
    """Return the density of `sample_normal`; D cosθm is at most 1.5 times as much, for p ≥ 0 and α ≤ 1."""
    alpha = shape[0]
    t = tan2_theta(m)
    e = t / alpha
    if m[2] <= 0.0 or e > 80.0:
        return 0.0
    exponent = -shape[1] * log1p(wp.min(e, 1.0) / alpha)
    if e > 1.0:
        exponent -= e
    areas = _areas(shape)
    # From density in x to density in solid angle: dx = 2 sinθ / cos³θ dθ = dω / (π cos³θ).
    return INV_PI * exponential(exponent) / ((areas[0] + areas[1]) * alpha * alpha * m[2] * m[2] * m[2])


@wp.func
def sample_normal(wo: wp.vec3, shape: wp.vec3, u: wp.vec2) -> wp.vec3:
    """Return a normal with a density close to D cosθ.

    The density of s = tan²θ / α², exp(−αs) (1 + s)^−p, has no invertible cumulative distribution. Its first factor
    matters only at large s, its second mainly at small s: sample (1 + s)^−p up to s = 1/α, exp(−αs) beyond.
    """
    alpha = shape[0]
    areas = _areas(shape)
    place = u[0] * (areas[0] + areas[1])
    s = float(0.0)
    if place < areas[0]:
        s = wp.min(power_integral_inverse(1.0 - shape[1], place), 1.0 / alpha)
    else:
        above = wp.max(1.0 - (place - areas[0]) / areas[1], 6.0e-8)
        s = (1.0 - logarithm(above)) / alpha
    return normal_of(s * alpha * alpha, u[1])
