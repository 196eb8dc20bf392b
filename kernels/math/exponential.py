"""Exponential and logarithm without library calls, so that they vectorise.

Warp calls the C library on the CPU. These functions are accurate to two units in the last place: polynomials of the
Cephes Mathematical Library (Moshier 1992), after powers of two are taken out.
"""

import warp as wp

_LOG2_E = wp.constant(1.44269504088896341)
# The logarithm of 2 in two parts, the first so short that its products with a small integer are exact.
_FIRST = wp.constant(0.693359375)
_SECOND = wp.constant(-2.12194440e-4)
_SQRT_HALF = wp.constant(0.707106781186547524)

# Below the first the result is 0, above the second infinity: the exponents of normal floats.
_LEAST = wp.constant(-87.3)
_MOST = wp.constant(88.37)


@wp.func
def exponential(x: float) -> float:
    """Return e to the power of x; 0 where x is below −87.3, infinity where it is above 88.37."""
    y = wp.clamp(x, _LEAST, _MOST)
    power = wp.floor(y * _LOG2_E + 0.5)
    y = (y - power * _FIRST) - power * _SECOND
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
    tail = tail + power * _SECOND - 0.5 * z
    return wp.where(x > 0.0, (y + tail) + power * _FIRST, -wp.inf)
