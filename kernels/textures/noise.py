"""Noise on a lattice: Perlin's (2002, "Improving noise") and Worley's (1996, "A cellular texture basis function")."""

import warp as wp

from wrt.kernels.core.bsdf import slot_values
from wrt.kernels.geometry.surface import Surface
from wrt.kernels.textures.patterns import FIRST, SECOND, SOLID, place_of, widths_of
from wrt.kernels.textures.procedures import Procedure

OCTAVES = wp.constant(4)

_TO_UNIT = wp.constant(2.0**-24)

MEAN_DISTANCE = wp.constant(0.4296)
"""The mean of `worley` in the plane, at most 1, which far cells have; tests measure it."""


@wp.func
def random_of_cell(x: int, y: int, z: int) -> wp.vec3:
    """Return three random numbers in [0, 1) that depend on a cell alone.

    The hash is pcg3d of Jarzynski and Olano (2020), "Hash functions for GPU rendering".
    """
    a = wp.uint32(x) * wp.uint32(1664525) + wp.uint32(1013904223)
    b = wp.uint32(y) * wp.uint32(1664525) + wp.uint32(1013904223)
    c = wp.uint32(z) * wp.uint32(1664525) + wp.uint32(1013904223)
    a = a + b * c
    b = b + c * a
    c = c + a * b
    a = a ^ (a >> wp.uint32(16))
    b = b ^ (b >> wp.uint32(16))
    c = c ^ (c >> wp.uint32(16))
    a = a + b * c
    b = b + c * a
    c = c + a * b
    return wp.vec3(float(a >> wp.uint32(8)), float(b >> wp.uint32(8)), float(c >> wp.uint32(8))) * _TO_UNIT


@wp.func
def _slope(x: int, y: int, z: int, to: wp.vec3) -> float:
    """Return the product of a vector from a lattice point with the point's gradient, to the middle of a cube's edge."""
    h = int(16.0 * random_of_cell(x, y, z)[0])
    a = wp.where(h < 8, to[0], to[1])
    b = wp.where(h < 4, to[1], wp.where(h == 12 or h == 14, to[0], to[2]))
    return wp.where((h & 1) == 0, a, -a) + wp.where((h & 2) == 0, b, -b)


@wp.func
def _fade(t: float) -> float:
    return t * t * t * (t * (t * 6.0 - 15.0) + 10.0)


@wp.func
def perlin(p: wp.vec3) -> float:
    """Return noise with the mean 0, from −1 to 1 nearly; 0 at points of the lattice."""
    x = int(wp.floor(p[0]))
    y = int(wp.floor(p[1]))
    z = int(wp.floor(p[2]))
    t = p - wp.vec3(wp.floor(p[0]), wp.floor(p[1]), wp.floor(p[2]))
    u = _fade(t[0])
    v = _fade(t[1])
    w = _fade(t[2])
    total = float(0.0)
    for k in range(8):
        i = k & 1
        j = (k >> 1) & 1
        m = k >> 2
        corner = wp.vec3(float(i), float(j), float(m))
        weight = wp.where(i == 1, u, 1.0 - u) * wp.where(j == 1, v, 1.0 - v) * wp.where(m == 1, w, 1.0 - w)
        total += weight * _slope(x + i, y + j, z + m, t - corner)
    return total


@wp.func
def _nearby(k: int) -> int:
    """Return 0, −1, 1, −2, 2 for k from 0 to 4."""
    return wp.where((k & 1) == 1, -((k + 1) >> 1), k >> 1)


@wp.func
def _gap(offset: int, t: float) -> float:
    """Return how far a point at t in its cell is from the cell with this offset."""
    return wp.max(wp.max(float(offset) - t, t - float(offset) - 1.0), 0.0)


@wp.func
def worley(p: wp.vec3, solid: bool) -> float:
    """Return the distance to the nearest of random points, one in each cell of space or of the plane."""
    x = int(wp.floor(p[0]))
    y = int(wp.floor(p[1]))
    z = int(wp.floor(p[2]))
    t = p - wp.vec3(wp.floor(p[0]), wp.floor(p[1]), wp.floor(p[2]))
    nearest = float(8.0)  # squared
    # The nearest point may be two cells away, as the one in the own cell may be √3 away.
    k = int(0)
    while k < 125:
        i = _nearby(k % 5)
        j = _nearby((k // 5) % 5)
        m = _nearby(k // 25)
        if solid or m == 0:
            gap = wp.vec3(_gap(i, t[0]), _gap(j, t[1]), _gap(m, t[2]))
            if wp.length_sq(gap) < nearest:
                to = random_of_cell(x + i, y + j, z + m) + wp.vec3(float(i), float(j), float(m)) - t
                if not solid:
                    to[2] = 0.0
                nearest = wp.min(nearest, wp.length_sq(to))
        k += 1
    return wp.sqrt(nearest)


@wp.func
def shown(width: float) -> float:
    """Return how much is left of features one cell large in a footprint that is `width` cells wide."""
    return wp.clamp(2.0 - 2.0 * width, 0.0, 1.0)


@wp.func
def clouds(values: slot_values, surface: Surface) -> wp.vec3:
    """Return the mixture of two colours by octaves of Perlin noise, each with twice the frequency, half the height."""
    place = place_of(values, surface)
    widths = widths_of(values, surface)
    width = wp.max(widths[0], widths[1])
    total = float(0.0)
    weight = float(1.0)
    for octave in range(int(values[OCTAVES][0])):
        if shown(width) > 0.0:
            total += weight * shown(width) * perlin(place)
        # Shifted, or the zeros of all octaves would meet in the lattice.
        place = place * 2.0 + wp.vec3(0.37, 0.61, 0.23)
        width = width * 2.0
        weight = weight * 0.5
    return wp.lerp(values[SECOND], values[FIRST], wp.clamp(0.5 + 0.5 * total, 0.0, 1.0))


@wp.func
def cells(values: slot_values, surface: Surface) -> wp.vec3:
    """Return the mixture of two colours by Worley's distance, from the first at a point to the second at 1."""
    widths = widths_of(values, surface)
    rest = shown(wp.max(widths[0], widths[1]))
    distance = float(MEAN_DISTANCE)
    if rest > 0.0:
        distance = wp.lerp(distance, wp.min(worley(place_of(values, surface), values[SOLID][0] > 0.0), 1.0), rest)
    return wp.lerp(values[FIRST], values[SECOND], distance)


PERLIN = Procedure(clouds, slots=5)
WORLEY = Procedure(cells, slots=4)
