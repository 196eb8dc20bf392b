"""Sine, cosine and arc tangent without library calls, so that they vectorise.

Warp calls the C library on the CPU. These functions are accurate to two units in the last place, the arc tangent to
three: polynomials of the Cephes Mathematical Library (Moshier 1992), after the argument reduction of Cody and Waite
(1980).
"""

import warp as wp

_TWO_OVER_PI = wp.constant(0.6366197723675814)
# π/2 in three parts, the first two so short that their products with a small integer are exact.
_FIRST = wp.constant(1.5703125)
_SECOND = wp.constant(4.837512969970703125e-4)
_THIRD = wp.constant(7.549789948768648e-8)

_HALF_PI = wp.constant(1.5707963267948966)
_QUARTER_PI = wp.constant(0.7853981633974483)
_PI = wp.constant(3.141592653589793)


@wp.func
def sine_cosine(angle: float) -> wp.vec2:
    """Return sine and cosine of an angle of at most 8192 rad."""
    turns = wp.floor(angle * _TWO_OVER_PI + 0.5)
    x = ((angle - turns * _FIRST) - turns * _SECOND) - turns * _THIRD
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
