"""No tone curve: radiance from 0 to 1 is shown as it is, and everything brighter is cut off."""

from __future__ import annotations

from wrt.develop.curves.curve import Colors, Curve


def _apply(colors: Colors, peak: float) -> Colors:
    return colors.clip(0.0, 1.0)


NONE = Curve("none", "clip at 1, exact below", _apply)
