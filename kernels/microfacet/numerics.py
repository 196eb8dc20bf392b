"""Functions that keep their precision near zero, and normals from slopes.

Float32 cannot resolve a mirror-like lobe without them: at roughness 1e-4 a cosine of 1 − 5e-9 rounds to 1.
"""

import warp as wp

from wrt.kernels.math.exponential import exponential, logarithm
from wrt.kernels.math.trigonometry import sine_cosine
from wrt.kernels.sampling.warps import TWO_PI


@wp.func
def log1p_ratio(x: float) -> float:
    """Return ln(1 + x) / x for x > −1, and 1 at 0.

    Numerator and denominator contain the same rounding of 1 + x, which cancels (Kahan; Higham, "Accuracy and Stability
    of Numerical Algorithms", 2nd edition, 1.14.1).
    """
    y = 1.0 + x
    if y == 1.0:
        return 1.0
    return logarithm(y) / (y - 1.0)


@wp.func
def log1p(x: float) -> float:
    """Return ln(1 + x) for x > −1."""
    return x * log1p_ratio(x)


@wp.func
def expm1_ratio(x: float) -> float:
    """Return (eˣ − 1) / x, and 1 at 0 (Higham, 1.14.1)."""
    y = exponential(x)
    if y == 1.0:
        return 1.0
    if wp.abs(x) > 1.0:
        return (y - 1.0) / x
    return (y - 1.0) / logarithm(y)


@wp.func
def expm1(x: float) -> float:
    """Return eˣ − 1."""
    return x * expm1_ratio(x)


@wp.func
def power_integral(k: float, log_y: float) -> float:
    """Return ∫ y^(k − 1) dy from 1 to e^log_y: (e^(k log_y) − 1) / k, and log_y at k = 0."""
    return log_y * expm1_ratio(k * log_y)


@wp.func
def power_integral_inverse(k: float, area: float) -> float:
    """Return y − 1, where `power_integral` from 1 to y is `area`."""
    # Just above −1 the end of the integral exceeds what float32 can tell from its limit 1 / |k|.
    x = wp.max(k * area, -0.9999999)
    return expm1(area * log1p_ratio(x))


@wp.func
def tan2_theta(m: wp.vec3) -> float:
    """Return tan²θ of a unit vector, from its sine: 1 − cos²θ would lose small angles."""
    return (m[0] * m[0] + m[1] * m[1]) / wp.max(m[2] * m[2], 1.0e-30)


@wp.func
def normal_of(tan2: float, u: float) -> wp.vec3:
    """Return the unit vector with this tan²θ and the azimuth 2π u."""
    z = 1.0 / wp.sqrt(1.0 + tan2)
    r = wp.sqrt(tan2) * z
    turned = sine_cosine(TWO_PI * u)
    return wp.vec3(r * turned[1], r * turned[0], z)
