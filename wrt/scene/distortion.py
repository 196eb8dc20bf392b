"""Distortion of lenses as OpenCV has it: Brown's model of perspective cameras, and that of fisheyes.

Source: OpenCV's documentation of `calib3d` and `fisheye`; Brown 1966, "Decentering distortion of lenses"; Kannala and
Brandt 2006, "A generic camera model and calibration method for conventional, wide-angle, and fish-eye lenses". Points
are given with y up, as on wrt's films.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.values import array, number

BROWN = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
"""Coefficients of a perspective camera in OpenCV's order."""

FISHEYE = ("k1", "k2", "k3", "k4")
"""Coefficients of a fisheye."""

_STEPS = 4096
"""Steps to the largest angle at which the radius is tested to grow."""

_MOST_DEGREES = 89.9
"""Largest angle from the axis at which a perspective camera may see."""

FloatArray = NDArray[np.float64]


def coefficients(value: object, name: str, *, names: tuple[str, ...]) -> tuple[float, ...]:
    """Return coefficients of distortion in an order of names, without zeros at the end, or raise InputError."""
    values = array(value, name, np.float64).ravel()
    found = [number(each, f"{name}[{i}]") for i, each in enumerate(values.tolist())]
    while found and found[-1] == 0.0:
        del found[-1]
    if len(found) > len(names):
        raise InputError(f"{name} has coefficients beyond {', '.join(names)}, which wrt does not have: {found}")
    return tuple(found)


class Radial(NamedTuple):
    """A distorted radius r N(r²) / D(r²), where N and D are polynomials whose constant term is 1.

    Attributes:
        numerator: the other coefficients of N, four.
        divisor: the other coefficients of D, three.
    """

    numerator: tuple[float, ...]
    divisor: tuple[float, ...]

    def at(self, radius: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return N / D at radii, the slope of the distorted radius, and D."""
        s = radius * radius
        n, slope_of_n = _value_and_slope(self.numerator, s)
        d, slope_of_d = _value_and_slope(self.divisor, s)
        factor = n / d
        return factor, factor + 2.0 * s * (slope_of_n - factor * slope_of_d) / d, d

    def limit(self, largest: float, *, tangent: bool) -> float:
        """Return the radius up to which the distorted radius grows: beyond, it has no inverse.

        Args:
            largest: the largest radius; if `tangent`, the largest angle, whose tangent is the radius.
            tangent: whether the radius is a tangent.
        """

        def grows(angles: FloatArray) -> NDArray[np.bool_]:
            with np.errstate(all="ignore"):
                _, slope, divisor = self.at(np.tan(angles) if tangent else angles)
            return (slope > 0.0) & (divisor > 0.0)

        low, high = 0.0, largest
        for _ in range(3):
            angles = np.linspace(low, high, _STEPS + 1)
            folds = np.flatnonzero(~grows(angles))
            if not len(folds):
                break
            low, high = float(angles[max(folds[0] - 1, 0)]), float(angles[folds[0]])
        else:
            high = low
        return math.tan(high) if tangent else high


def _value_and_slope(coefficients: tuple[float, ...], s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return 1 + c0 s + c1 s² + … and its derivative."""
    value, slope = np.zeros_like(s), np.zeros_like(s)
    for c in (*reversed(coefficients), 1.0):
        slope = slope * s + value
        value = value * s + c
    return value, slope


def film_of_brown(distortion: tuple[float, ...]) -> dict[str, Any]:
    """Return fields of the kernels' Camera for Brown's model."""
    k1, k2, p1, p2, k3, k4, k5, k6 = (*distortion, *[0.0] * (8 - len(distortion)))
    radial = Radial((k1, k2, k3, 0.0), (k4, k5, k6))
    limit = radial.limit(math.radians(_MOST_DEGREES), tangent=True)
    # OpenCV's y points down: p1 changes its sign.
    return {"radial": radial.numerator, "radial_divisor": radial.divisor, "tangential": (-p1, p2), "limit": limit}


def film_of_fisheye(distortion: tuple[float, ...], limit: float) -> dict[str, Any]:
    """Return fields of the kernels' Camera for a fisheye that sees up to an angle, radians."""
    radial = Radial((*distortion, *[0.0] * (4 - len(distortion))), (0.0, 0.0, 0.0))
    return {"radial": radial.numerator, "limit": radial.limit(limit, tangent=False)}


def brown(points: FloatArray, film: dict[str, Any]) -> FloatArray:
    """Return distorted points (N, 2) of the plane at distance 1; NaN where the model folds over."""
    x, y = points.T
    radius = np.hypot(x, y)
    factor = Radial(film["radial"], film["radial_divisor"]).at(radius)[0]
    factor = np.where(radius <= film["limit"], factor, np.nan)
    (p1, p2), s = film["tangential"], radius * radius
    return np.stack(
        [
            x * factor + 2.0 * p1 * x * y + p2 * (s + 2.0 * x * x),
            y * factor + p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y,
        ],
        axis=1,
    )


def fisheye_radius(angle: FloatArray, film: dict[str, Any]) -> FloatArray:
    """Return the distances from the middle at which a fisheye shows angles from its axis; NaN where it does not."""
    factor = Radial(film["radial"], (0.0, 0.0, 0.0)).at(angle)[0] if "radial" in film else 1.0
    return np.where(angle <= film["limit"], angle * factor, np.nan)
