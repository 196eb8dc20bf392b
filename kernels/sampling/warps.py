"""Maps from the unit square to the domains that are sampled, each with its density."""

import warp as wp

from wrt.kernels.core.elementary import sine_cosine

PI = wp.constant(3.14159265358979)
TWO_PI = wp.constant(6.28318530717959)
BELOW_ONE = wp.constant(1.0 - 2.0**-24)  # the largest number that a sampler returns
INV_PI = wp.constant(0.318309886183791)

_GOLDEN = wp.constant(wp.uint32(2654435769))
"""The golden ratio's fraction in units of 2^-32."""


@wp.func
def lattice_point(k: int, points: int) -> wp.vec2:
    """Return point k of a Fibonacci lattice in the unit square, by multiples of the golden ratio modulo 1."""
    # 24 bits: the nearest float to a 32-bit fraction may be 1.
    across = float(int((wp.uint32(k) * _GOLDEN) >> wp.uint32(8))) * 5.9604644775390625e-08
    return wp.vec2((float(k) + 0.5) / float(points), across)


@wp.func
def square_to_disk(u: wp.vec2) -> wp.vec2:
    """Return a point on the unit disk, density 1/π (concentric map, Shirley and Chiu 1997)."""
    a = 2.0 * u[0] - 1.0
    b = 2.0 * u[1] - 1.0
    if a == 0.0 and b == 0.0:
        return wp.vec2(0.0, 0.0)
    if wp.abs(a) > wp.abs(b):
        phi = 0.25 * PI * (b / a)
        turned = sine_cosine(phi)
        return wp.vec2(a * turned[1], a * turned[0])
    phi = 0.5 * PI - 0.25 * PI * (a / b)
    turned = sine_cosine(phi)
    return wp.vec2(b * turned[1], b * turned[0])


@wp.func
def square_to_cosine_hemisphere(u: wp.vec2) -> wp.vec3:
    """Return a direction around +z, density cosθ/π (Malley's method)."""
    d = square_to_disk(u)
    z = wp.sqrt(wp.max(0.0, 1.0 - d[0] * d[0] - d[1] * d[1]))
    return wp.vec3(d[0], d[1], z)


@wp.func
def square_to_sphere(u: wp.vec2) -> wp.vec3:
    """Return a direction, density 1/4π (Archimedes: slices of a sphere of equal height have equal areas)."""
    z = 1.0 - 2.0 * u[0]
    r = wp.sqrt(wp.max(0.0, 1.0 - z * z))
    turned = sine_cosine(TWO_PI * u[1])
    return wp.vec3(r * turned[1], r * turned[0], z)


@wp.func
def square_to_triangle(u: wp.vec2) -> wp.vec2:
    """Return barycentric (u, v) uniform over a triangle (Heitz 2019, low-distortion map)."""
    if u[1] > u[0]:
        b0 = 0.5 * u[0]
        return wp.vec2(b0, u[1] - b0)
    b1 = 0.5 * u[1]
    return wp.vec2(u[0] - b1, b1)


@wp.struct
class Choice:
    """An index, and the rescaled random number that chose it: uniform in [0, 1) for every index."""

    index: int
    rest: float


@wp.func
def sample_alias(thresholds: wp.array(dtype=float), aliases: wp.array(dtype=int), u: float, u_more: float) -> Choice:
    """Return an index sampled from an alias table (Walker 1977; Vose 1991) by the number `u`.

    `u_more` extends its digits: the 24 bits of one number would not reach all slots equally often.
    """
    n = thresholds.shape[0]
    high = wp.int64(u * 16777216.0) * wp.int64(n)
    low = wp.int64(u_more * 16777216.0) * wp.int64(n)
    place = high + (low >> wp.int64(24))
    i = int(place >> wp.int64(24))
    keep = float(place & wp.int64(16777215)) * 5.9604644775390625e-08
    threshold = thresholds[i]
    choice = Choice()
    if keep < threshold:
        choice.index = i
        choice.rest = wp.min(keep / threshold, BELOW_ONE)
    else:
        choice.index = aliases[i]
        choice.rest = wp.min((keep - threshold) / (1.0 - threshold), BELOW_ONE)
    return choice
