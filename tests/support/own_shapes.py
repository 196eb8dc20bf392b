"""Shapes by distance functions for tests: a ball, a rounded box and a fractal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import warp as wp

import wrt
from wrt.kernels.geometry.distances import DISTANCES
from wrt.scene.description import NotNegative, Positive, Vector
from wrt.scene.exact.distances import SHAPES


@wp.func
def ball(point: wp.vec3, radius: float) -> float:
    return wp.length(point) - radius


@dataclass(frozen=True)
class Ball(wrt.DistanceShape):
    """A sphere around the origin, `radius` in metres."""

    radius: Positive = 1.0

    type_name: ClassVar[str] = "test-ball"

    def bounds(self) -> tuple[Any, Any]:
        return (-1.01 * self.radius,) * 3, (1.01 * self.radius,) * 3


@wp.func
def rounded_box(point: wp.vec3, x: float, y: float, z: float, radius: float) -> float:
    out = wp.vec3(wp.abs(point[0]) - x + radius, wp.abs(point[1]) - y + radius, wp.abs(point[2]) - z + radius)
    beyond = wp.vec3(wp.max(out[0], 0.0), wp.max(out[1], 0.0), wp.max(out[2], 0.0))
    return wp.length(beyond) + wp.min(wp.max(out), 0.0) - radius


@dataclass(frozen=True)
class RoundedBox(wrt.DistanceShape):
    """A box around the origin: half its size, and the radius of its edges, metres."""

    half: Vector = (0.8, 0.5, 0.6)
    radius: NotNegative = 0.2

    type_name: ClassVar[str] = "test-rounded-box"

    def bounds(self) -> tuple[Any, Any]:
        return [-1.02 * h for h in self.half], [1.02 * h for h in self.half]


@wp.func
def mandelbulb(point: wp.vec3, power: float, thickness: float) -> float:
    """Estimate of Hart, Sandin and Kauffman (1989) for z → z^p + c in spherical coordinates (White and Nylander)."""
    z = point
    slope = float(1.0)
    r = wp.length(z)
    steps = int(0)
    while r < 4.0 and steps < 12:
        theta = wp.acos(wp.clamp(z[2] / wp.max(r, 1.0e-12), -1.0, 1.0)) * power
        phi = wp.atan2(z[1], z[0]) * power
        slope = wp.pow(r, power - 1.0) * power * slope + 1.0
        grown = wp.pow(r, power)
        z = wp.vec3(wp.sin(theta) * wp.cos(phi), wp.sin(theta) * wp.sin(phi), wp.cos(theta)) * grown + point
        r = wp.length(z)
        steps += 1
    distance = float(0.0)
    if r > 1.0:
        distance = 0.5 * wp.log(r) * r / slope
    return distance - thickness


@dataclass(frozen=True)
class Mandelbulb(wrt.DistanceShape):
    """A fractal, and all within `thickness` of it, metres."""

    power: Positive = 8.0
    thickness: Positive = 0.002

    type_name: ClassVar[str] = "test-mandelbulb"

    def bounds(self) -> tuple[Any, Any]:
        return (-1.25,) * 3, (1.25,) * 3


FUNCTIONS = ((Ball, ball), (RoundedBox, rounded_box), (Mandelbulb, mandelbulb))


def register() -> None:
    """Register them."""
    for cls, function in FUNCTIONS:
        wrt.register_shape(cls, function)


def forget() -> None:
    """Leave the register as it was."""
    for cls, _ in FUNCTIONS:
        del SHAPES[cls.type_name]
        DISTANCES.forget(cls.type_name.replace("-", "_"))
