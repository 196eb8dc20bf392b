"""The ABC distribution: D ∝ 1 / (1 + B (1 − cosθ))^C (Löw, Kronander, Ynnerman and Unger 2012).

shape = (B, C, 0): B sets the width of the peak, C the steepness of its tail. The paper's factor A includes the
normalisation of D; here D is normalised, so that a reflectance can be given.

∫ D cosθ dω, with v = 1 − cosθ, y = 1 + B v and Y = 1 + B:

    2π ∫₀¹ (1 − v) (1 + B v)^−C dv = 2π/B² ∫₁^Y (Y − y) y^−C dy = 2π/B² (Y E(1 − C) − E(2 − C)),

E(k) = ∫₁^Y y^(k − 1) dy = (Y^k − 1) / k, and ln Y at k = 0. The difference loses a factor of 1/B in accuracy, hence the
lower limit of B.
"""

import warp as wp

from wrt.kernels.core.elementary import exponential, log1p, power_integral, power_integral_inverse, sine_cosine
from wrt.kernels.sampling.warps import TWO_PI

LEAST_B = wp.constant(0.1)
"""The least B; below, the distribution is nearly constant for any C in use."""


@wp.func
def _one_minus_cos(m: wp.vec3) -> float:
    """Return 1 − cosθ computed from the sine: near 1, cosθ itself has no digits left."""
    return (m[0] * m[0] + m[1] * m[1]) / (1.0 + m[2])


@wp.func
def d(m: wp.vec3, shape: wp.vec3) -> float:
    """Return D(m)."""
    if m[2] <= 0.0:
        return 0.0
    b = wp.max(shape[0], LEAST_B)
    c = shape[1]
    log_y = log1p(b)
    area = (1.0 + b) * power_integral(1.0 - c, log_y) - power_integral(2.0 - c, log_y)
    return b / TWO_PI * (b / area) * exponential(-c * log1p(b * _one_minus_cos(m)))


@wp.func
def normal_pdf(wo: wp.vec3, m: wp.vec3, shape: wp.vec3) -> float:
    """Return the density of `sample_normal`, B (1 + B (1 − cosθ))^−C / (2π E(1 − C))."""
    if m[2] <= 0.0:
        return 0.0
    b = wp.max(shape[0], LEAST_B)
    c = shape[1]
    area = power_integral(1.0 - c, log1p(b))
    return b / (TWO_PI * area) * exponential(-c * log1p(b * _one_minus_cos(m)))


@wp.func
def sample_normal(wo: wp.vec3, shape: wp.vec3, u: wp.vec2) -> wp.vec3:
    """Return a normal with density ∝ D: its cumulative distribution can be inverted, unlike that of D cosθ."""
    b = wp.max(shape[0], LEAST_B)
    k = 1.0 - shape[1]
    v = wp.min(power_integral_inverse(k, u[0] * power_integral(k, log1p(b))) / b, 1.0)
    r = wp.sqrt(v * (2.0 - v))
    turned = sine_cosine(TWO_PI * u[1])
    return wp.vec3(r * turned[1], r * turned[0], 1.0 - v)
