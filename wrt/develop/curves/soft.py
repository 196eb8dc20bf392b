"""The default: exact in pictures that fit a display, and soft highlights in those that do not."""

from __future__ import annotations

import math

from wrt.develop.curves.curve import Colors, Curve
from wrt.develop.curves.roll_off import roll_off

LOWEST_START = 0.8
"""Colours up to this are exact in every picture. Khronos chose the same value for PBR Neutral."""

FULL_PEAK = 2.0
"""Peak of a picture from which on the compression starts at LOWEST_START."""


def _apply(colors: Colors, peak: float) -> Colors:
    # The start falls from 1 while the peak rises from 1, so that a small change of a picture never makes a large one.
    share = min(max(math.log2(max(peak, 1.0)) / math.log2(FULL_PEAK), 0.0), 1.0)
    start = 1.0 - (1.0 - LOWEST_START) * share
    return roll_off(colors, start) if start < 1.0 else colors.clip(0.0, 1.0)


SOFT = Curve("soft", "exact up to 0.8, and up to 1 if nothing is brighter; highlights go to white", _apply)
