"""Patterns of straight edges: checkerboard and bricks, averaged over the footprint of a ray."""

import warp as wp

from wrt.kernels.core.bsdf import slot_values
from wrt.kernels.geometry.surface import Surface
from wrt.kernels.textures.procedures import Procedure

FIRST = wp.constant(0)
SECOND = wp.constant(1)
SCALE = wp.constant(2)
SOLID = wp.constant(3)
MORTAR = wp.constant(4)

_LEAST_WIDTH = wp.constant(1.0e-3)  # of a filter, in cells; rounding of its quotient would show below


@wp.func
def place_of(values: slot_values, surface: Surface) -> wp.vec3:
    """Return a point in cells: by its position if the pattern is solid, else by its texture coordinates."""
    if values[SOLID][0] > 0.0:
        return wp.cw_mul(surface.position, values[SCALE])
    return wp.vec3(surface.uv[0] * values[SCALE][0], surface.uv[1] * values[SCALE][1], 0.0)


@wp.func
def widths_of(values: slot_values, surface: Surface) -> wp.vec2:
    """Return how wide a ray's footprint is along u and along v through its middle, in cells; 0 for solid patterns.

    These are chords of the ellipse, so that a pattern is never blurred beyond it.
    """
    if values[SOLID][0] > 0.0:
        return wp.vec2(0.0)
    area = surface.footprint[3]
    u = area / wp.sqrt(wp.max(surface.footprint[1], 1.0e-30))
    v = area / wp.sqrt(wp.max(surface.footprint[0], 1.0e-30))
    return wp.vec2(u * wp.abs(values[SCALE][0]), v * wp.abs(values[SCALE][1]))


@wp.func
def _up_to(x: float, gap: float) -> float:
    """Return the integral from 0 to x of a function of period 1: 0 up to gap/2, 1 from there, 0 from 1 − gap/2."""
    cell = wp.floor(x)
    return cell * (1.0 - gap) + wp.clamp(x - cell - 0.5 * gap, 0.0, 1.0 - gap)


@wp.func
def pulse(x: float, gap: float, width: float) -> float:
    """Return the mean over a width of the function whose integral `_up_to` is."""
    t = x - wp.floor(x)
    if width < _LEAST_WIDTH:
        return wp.where(t >= 0.5 * gap and t < 1.0 - 0.5 * gap, 1.0, 0.0)
    half = 0.5 * width
    return (_up_to(t + half, gap) - _up_to(t - half, gap)) / width


@wp.func
def _alternating(x: float, width: float) -> float:
    """Return the mean over a width of +1 in even cells and −1 in odd ones."""
    return 2.0 * pulse(0.5 * x + 0.25, 0.5, 0.5 * width) - 1.0


@wp.func
def checkers(values: slot_values, surface: Surface) -> wp.vec3:
    """Return the mean of two colours that alternate from cell to cell."""
    place = place_of(values, surface)
    width = widths_of(values, surface)
    sign = _alternating(place[0], width[0]) * _alternating(place[1], width[1])
    if values[SOLID][0] > 0.0:
        sign = sign * _alternating(place[2], 0.0)
    return wp.lerp(values[SECOND], values[FIRST], 0.5 + 0.5 * sign)


@wp.func
def wall(values: slot_values, surface: Surface) -> wp.vec3:
    """Return the mean of bricks and of the mortar between them; every other course is shifted by half a brick.

    MORTAR are its shares of a brick's length and of its height.
    """
    place = place_of(values, surface)
    width = widths_of(values, surface)
    course = wp.floor(place[1])
    shift = 0.5 * (course - 2.0 * wp.floor(0.5 * course))
    is_brick = pulse(place[0] + shift, values[MORTAR][0], width[0]) * pulse(place[1], values[MORTAR][1], width[1])
    return wp.lerp(values[SECOND], values[FIRST], is_brick)


CHECKERBOARD = Procedure(checkers, slots=4)
BRICKS = Procedure(wall, slots=5)
