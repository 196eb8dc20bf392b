"""The tone curves by name."""

from __future__ import annotations

from wrt.develop.curves.aces import ACES
from wrt.develop.curves.agx import AGX
from wrt.develop.curves.curve import Curve
from wrt.develop.curves.neutral import NEUTRAL
from wrt.develop.curves.none import NONE
from wrt.develop.curves.soft import SOFT

CURVES: dict[str, Curve] = {curve.name: curve for curve in (SOFT, NONE, NEUTRAL, AGX, ACES)}
"""The curves that `wrt.developing.TONES` names."""
