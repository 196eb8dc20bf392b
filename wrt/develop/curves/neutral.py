"""Khronos PBR Neutral: colours of materials as they are, and compressed highlights."""

from __future__ import annotations

import numpy as np

from wrt.develop.curves.curve import Colors, Curve
from wrt.develop.curves.roll_off import roll_off

_FRESNEL = 0.04
"""Reflectance of a dielectric seen along its normal, which makes photographs of matt things paler than these are."""


def _apply(colors: Colors, peak: float) -> Colors:
    low = colors.min(axis=-1, keepdims=True)
    offset = np.where(low < 2.0 * _FRESNEL, low - low * low / (4.0 * _FRESNEL), _FRESNEL)
    return roll_off(colors - offset, 0.8 - _FRESNEL)


NEUTRAL = Curve(
    "neutral", "Khronos PBR Neutral (Khronos Group 2024): base colours stay, minus the 4 % of gloss", _apply
)
