"""Elementary functions without library calls, so that they vectorise, and forms that keep their precision near zero.

Warp calls the C library on the CPU. These functions are accurate to two units in the last place, the arc tangent to
three: polynomials of the Cephes Mathematical Library (Moshier 1992), after powers of two are taken out, or after the
argument reduction of Cody and Waite (1980).
"""

import warp as wp

_LOG2_E = wp.constant(1.44269504088896341)
# The logarithm of 2 in two parts, the first so short that its products with a small integer are exact.
_LOG2_FIRST = wp.constant(0.693359375)
_LOG2_SECOND = wp.constant(-2.12194440e-4)
_SQRT_HALF = wp.constant(0.707106781186547524)

# Below the first the result is 0, above the second infinity: the exponents of normal floats.
_LEAST = wp.constant(-87.3)
_MOST = wp.constant(88.37)


@wp.func
def exponential(x: float) -> float:
    """Return e to the power of x; 0 where x is below −87.3, infinity where it is above 88.37."""
    y = wp.clamp(x, _LEAST, _MOST)
    power = wp.floor(y * _LOG2_E + 0.5)
    y = (y - power * _LOG2_FIRST) - power * _LOG2_SECOND
    tail = ((1.9875691500e-4 * y + 1.3981999507e-3) * y + 8.3334519073e-3) * y + 4.1665795894e-2
    tail = (tail * y + 1.6666665459e-1) * y + 5.0000001201e-1
    result = (tail * y * y + y + 1.0) * wp.cast((int(power) + 127) << 23, wp.float32)
    result = wp.where(x < _LEAST, 0.0, result)
    return wp.where(x > _MOST, wp.inf, result)


@wp.func
def logarithm(x: float) -> float:
    """Return the natural logarithm of x; −infinity if x ≤ 0. Subnormal numbers count as about 1e−38."""
    bits = wp.cast(x, wp.int32)
    power = float((bits >> 23) - 126)
    y = wp.cast((bits & 0x7FFFFF) | 0x3F000000, wp.float32)  # in [0.5, 1)
    small = y < _SQRT_HALF
    power = wp.where(small, power - 1.0, power)
    y = wp.where(small, y + y - 1.0, y - 1.0)
    z = y * y
    tail = ((7.0376836292e-2 * y - 1.1514610310e-1) * y + 1.1676998740e-1) * y - 1.2420140846e-1
    tail = ((tail * y + 1.4249322787e-1) * y - 1.6668057665e-1) * y + 2.0000714765e-1
    tail = ((tail * y - 2.4999993993e-1) * y + 3.3333331174e-1) * y * z
    tail = tail + power * _LOG2_SECOND - 0.5 * z
    return wp.where(x > 0.0, (y + tail) + power * _LOG2_FIRST, -wp.inf)


@wp.func_grad(logarithm)
def _logarithm_adjoint(x: float, adj_ret: float):
    # Warp's own adjoint would end at the bits of x, and be 0.
    wp.adjoint[x] += adj_ret / x


_TWO_OVER_PI = wp.constant(0.6366197723675814)
# π/2 in three parts, the first two so short that their products with a small integer are exact.
_HALF_PI_FIRST = wp.constant(1.5703125)
_HALF_PI_SECOND = wp.constant(4.837512969970703125e-4)
_HALF_PI_THIRD = wp.constant(7.549789948768648e-8)

_HALF_PI = wp.constant(1.5707963267948966)
_QUARTER_PI = wp.constant(0.7853981633974483)
_PI = wp.constant(3.141592653589793)
_TWO_PI = wp.constant(6.28318530717959)


@wp.func
def sine_cosine(angle: float) -> wp.vec2:
    """Return sine and cosine of an angle of at most 8192 rad."""
    turns = wp.floor(angle * _TWO_OVER_PI + 0.5)
    x = ((angle - turns * _HALF_PI_FIRST) - turns * _HALF_PI_SECOND) - turns * _HALF_PI_THIRD
    z = x * x
    sine = x + x * z * (-1.6666654611e-1 + z * (8.3321608736e-3 - z * 1.9515295891e-4))
    cosine = 1.0 - 0.5 * z + z * z * (4.166664568298827e-2 + z * (-1.388731625493765e-3 + z * 2.443315711809948e-5))
    quarter = int(turns)
    swapped = (quarter & 1) != 0
    first = wp.where(swapped, cosine, sine)
    second = wp.where(swapped, sine, cosine)
    first = wp.where((quarter & 2) != 0, -first, first)
    second = wp.where(((quarter + 1) & 2) != 0, -second, second)
    return wp.vec2(first, second)


@wp.func
def arc_tangent(y: float, x: float) -> float:
    """Return the angle of (x, y) to the x axis, in [−π, π], as atan2 does; 0 of (0, 0)."""
    across = wp.abs(x)
    up = wp.abs(y)
    larger = wp.max(across, up)
    smaller = wp.min(across, up)
    # The polynomial takes t = smaller / larger; above tan π/8 it takes (t − 1) / (t + 1), and π/4 is added.
    steep = smaller > 0.41421356 * larger
    above = wp.where(steep, smaller - larger, smaller)
    below = wp.where(steep, smaller + larger, larger)
    t = above / wp.where(below > 0.0, below, 1.0)
    z = t * t
    tail = 8.05374449538e-2 * z - 1.38776856032e-1
    angle = t + t * z * ((tail * z + 1.99777106478e-1) * z - 3.33329491539e-1)
    angle = wp.where(steep, angle + _QUARTER_PI, angle)
    angle = wp.where(up > across, _HALF_PI - angle, angle)
    angle = wp.where(x < 0.0, _PI - angle, angle)
    return wp.where(y < 0.0, -angle, angle)


# --- Precise near zero -----------------------------------------------------------------------------
#
# Float32 cannot resolve a mirror-like lobe otherwise: at roughness 1e-4 a cosine of 1 − 5e-9 rounds to 1.


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


@wp.func_grad(log1p_ratio)
def _log1p_ratio_adjoint(x: float, adj_ret: float):
    # The quotient rule would divide rounding errors by x².
    slope = 2.0 / 3.0 * x - 0.5 - 0.75 * x * x
    if wp.abs(x) > 0.02:
        slope = (1.0 / (1.0 + x) - log1p_ratio(x)) / x
    wp.adjoint[x] += adj_ret * slope


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


@wp.func_grad(expm1_ratio)
def _expm1_ratio_adjoint(x: float, adj_ret: float):
    slope = 0.5 + x * (1.0 / 3.0 + 0.125 * x)
    if wp.abs(x) > 0.02:
        slope = (exponential(x) - expm1_ratio(x)) / x
    wp.adjoint[x] += adj_ret * slope


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
    turned = sine_cosine(_TWO_PI * u)
    return wp.vec3(r * turned[1], r * turned[0], z)
