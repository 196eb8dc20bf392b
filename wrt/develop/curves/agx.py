"""AgX by Troy Sobotka: a log curve for each of three primaries that lie inside Rec. 2020, as in Blender.

Bright colours lose saturation as on film, so a blue lamp becomes white and not cyan. The primaries are those of
Blender's configuration (Eary Chow, "AgX_LUT_Gen", AgXBaseRec2020.py, 2023), as Filament and three.js have them. The
curve is Sobotka's formula (AgX, "AgX_Default_Contrast"), for which those two use a polynomial that is off by up to
1.5/255.
"""

from __future__ import annotations

import numpy as np

from wrt.develop.curves.curve import Colors, Curve
from wrt.linalg import product

_REC2020 = np.array([[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0113], [0.0164, 0.0880, 0.8956]])
_REC709 = np.array([[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]])
_INSET = np.array(
    [
        [0.856627153315983, 0.0951212405381588, 0.0482516061458583],
        [0.137318972929847, 0.761241990602591, 0.101439036467562],
        [0.11189821299995, 0.0767994186031903, 0.811302368396859],
    ]
)
_OUTSET = np.array(
    [
        [1.1271005818144368, -0.11060664309660323, -0.016493938717834573],
        [-0.1413297634984383, 1.157823702216272, -0.016493938717834257],
        [-0.14132976349843826, -0.11060664309660294, 1.2519364065950405],
    ]
)

_STOPS_BELOW, _STOPS_ABOVE = 10.0, 6.5
"""Stops from middle grey to the black and to the white of the curve."""

_MIDDLE_GREY = 0.18
_LEAST = 1e-10
_PIVOT = _STOPS_BELOW / (_STOPS_BELOW + _STOPS_ABOVE), 0.5
_SLOPE = 2.0
_TOE, _SHOULDER = 3.0, 3.25


def _scale(width: float, height: float, power: float) -> float:
    """Return the scale at which a half of the sigmoid ends in the corner of a rectangle."""
    rise = _SLOPE * width
    return float((rise**-power * ((rise / height) ** power - 1.0)) ** (-1.0 / power))


def sigmoid(x: Colors) -> Colors:
    """Return the contrast curve of AgX for log-encoded values from 0 to 1."""
    at, level = _PIVOT
    toe, shoulder = _scale(at, level, _TOE), _scale(1.0 - at, 1.0 - level, _SHOULDER)

    def half(distance: Colors, scale: float, power: float) -> Colors:
        t = _SLOPE * np.maximum(distance, 0.0) / scale
        return scale * t / (1.0 + t**power) ** (1.0 / power)

    return level + half(x - at, shoulder, _SHOULDER) - half(at - x, toe, _TOE)


def _apply(colors: Colors, peak: float) -> Colors:
    inset = product(colors, product(_INSET, _REC2020).T)
    stops = np.log2(np.maximum(inset, _LEAST) / _MIDDLE_GREY)
    encoded = sigmoid(((stops + _STOPS_BELOW) / (_STOPS_BELOW + _STOPS_ABOVE)).clip(0.0, 1.0))
    linear = np.maximum(product(encoded, _OUTSET.T), 0.0) ** 2.2
    shown: Colors = product(linear, _REC709.T).clip(0.0, 1.0)
    return shown


AGX = Curve("agx", "AgX (Troy Sobotka), as in Blender: film-like, low contrast, bright colours go to white", _apply)
