"""Tone curves: from the radiance of a scene to the light of a display.

- soft, the default: exact in pictures that fit a display; soft highlights in brighter ones.
- none: radiance from 0 to 1 as it is; everything brighter is clipped.
- neutral: Khronos PBR Neutral (Khronos Group, 2024). Keeps base colors, minus the 4 % of gloss.
- agx: AgX by Troy Sobotka, as in Blender: film-like, low contrast, bright colors go to white.
- aces: ACES 1.x as fitted by Stephen Hill: high contrast, darker in the middle.

AgX applies a log curve to three primaries inside Rec. 2020, so a blue lamp becomes white and not cyan. The primaries
are Blender's (Eary Chow, "AgX_LUT_Gen", AgXBaseRec2020.py, 2023), as in Filament and three.js. The curve is Sobotka's
formula (AgX, "AgX_Default_Contrast"); those two use a polynomial that is off by up to 1.5/255.

The constants of ACES, a fit of the reference rendering transform and the output transform for sRGB displays, come from
ACES.hlsl of BakingLab (Matt Pettineo and Stephen Hill, 2016), without the exposure of 1.8 or 1/0.6 that some programs
apply first. ACES 2.0 itself is available as `--tone ocio`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from wrt.linalg import product

Colors: TypeAlias = NDArray[Any]  # (..., 3) float64
DESATURATION = 0.15  # how fast compressed colors go to white
LOWEST_START = 0.8  # colors up to this are exact in every picture. Khronos chose the same value for PBR Neutral
FULL_PEAK = 2.0  # peak of a picture from which on soft compression starts at LOWEST_START

FRESNEL = 0.04
"""Reflectance of a dielectric at normal incidence, which makes photographs of matte things paler than the things."""


def compress_highlights(colors: Colors, start: float) -> Colors:
    """Compress colors whose largest channel exceeds `start`, so that it stays below 1, and blend them with white.

    Below `start` colors do not change. Value and slope of the largest channel p are continuous there:
    p' = 1 − d² / (p + d − start), with d = 1 − start. Ratios of channels, and so the hue, are kept; then the color
    goes to white as the compression takes more away (Khronos Group, "PBR Neutral Tone Mapper", 2024).

    Args:
        colors: (..., 3) linear values.
        start: the largest channel from which on colors are compressed, 0 to 1.
    """
    is_bright = colors.max(axis=-1) > start
    result = colors.copy()
    bright = colors[is_bright]
    peak = bright.max(axis=-1, keepdims=True)
    room = 1.0 - start
    compressed = 1.0 - room * room / (peak + room - start)
    white = 1.0 - 1.0 / (DESATURATION * (peak - compressed) + 1.0)
    bright = bright * (compressed / peak)
    result[is_bright] = bright + (compressed - bright) * white
    return result


def _soft(colors: Colors, peak: float) -> Colors:
    # The start falls from 1 while the peak rises from 1, so that a small change of a picture never makes a large one.
    share = min(max(math.log2(max(peak, 1.0)) / math.log2(FULL_PEAK), 0.0), 1.0)
    start = 1.0 - (1.0 - LOWEST_START) * share
    return compress_highlights(colors, start) if start < 1.0 else colors.clip(0.0, 1.0)


def _none(colors: Colors, peak: float) -> Colors:
    return colors.clip(0.0, 1.0)


def _neutral(colors: Colors, peak: float) -> Colors:
    low = colors.min(axis=-1, keepdims=True)
    offset = np.where(low < 2.0 * FRESNEL, low - low * low / (4.0 * FRESNEL), FRESNEL)
    return compress_highlights(colors - offset, 0.8 - FRESNEL)


# --- AgX -------------------------------------------------------------------------------------------

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

_STOPS_BELOW, _STOPS_ABOVE = 10.0, 6.5  # stops from middle grey to the black and to the white of the curve
_MIDDLE_GREY = 0.18
_LEAST = 1e-10
_PIVOT = _STOPS_BELOW / (_STOPS_BELOW + _STOPS_ABOVE), 0.5
_SLOPE = 2.0
_TOE, _SHOULDER = 3.0, 3.25


def agx_contrast(x: Colors) -> Colors:
    """Return the contrast curve of AgX, a sigmoid, for log-encoded values from 0 to 1."""
    pivot, level = _PIVOT

    def half(distance: Colors, width: float, height: float, power: float) -> Colors:
        """Return a half of the sigmoid that ends in the corner of a rectangle."""
        rise = _SLOPE * width
        scale = float((rise**-power * ((rise / height) ** power - 1.0)) ** (-1.0 / power))
        t = _SLOPE * np.maximum(distance, 0.0) / scale
        return scale * t / (1.0 + t**power) ** (1.0 / power)

    return level + half(x - pivot, 1.0 - pivot, 1.0 - level, _SHOULDER) - half(pivot - x, pivot, level, _TOE)


def _agx(colors: Colors, peak: float) -> Colors:
    inset = product(colors, product(_INSET, _REC2020).T)
    stops = np.log2(np.maximum(inset, _LEAST) / _MIDDLE_GREY)
    encoded = agx_contrast(((stops + _STOPS_BELOW) / (_STOPS_BELOW + _STOPS_ABOVE)).clip(0.0, 1.0))
    linear = np.maximum(product(encoded, _OUTSET.T), 0.0) ** 2.2
    return np.asarray(product(linear, _REC709.T).clip(0.0, 1.0))


# --- ACES ------------------------------------------------------------------------------------------

_TO_RRT = np.array([[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]])
_TO_SRGB = np.array([[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]])


def _aces(colors: Colors, peak: float) -> Colors:
    v = product(colors, _TO_RRT.T)
    fitted = (v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.4329510) + 0.238081)
    return np.asarray(product(fitted, _TO_SRGB.T).clip(0.0, 1.0))


CURVES: dict[str, Callable[[Colors, float], Colors]] = {
    "soft": _soft,
    "none": _none,
    "neutral": _neutral,
    "agx": _agx,
    "aces": _aces,
}
"""The curves that `wrt.scene.developing.TONES` names.

Each maps (..., 3) linear Rec. 709 radiance, finite and not negative, to the linear light of an sRGB display, 0 to 1.
The second argument is the radiance of the picture's brightest parts (`wrt.develop.exposure.peak`)."""
