"""ACES 1.x: Stephen Hill's fit of the reference rendering transform and the output transform for sRGB displays.

The constants are published in ACES.hlsl of BakingLab (Matt Pettineo and Stephen Hill, 2016), without the exposure of
1.8 or 1/0.6 that some programs put before it. ACES 2.0 itself is there through `--tone ocio`.
"""

from __future__ import annotations

import numpy as np

from wrt.develop.curves.curve import Colors, Curve
from wrt.linalg import product

_TO_RRT = np.array([[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]])
_TO_SRGB = np.array([[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]])


def _apply(colors: Colors, peak: float) -> Colors:
    v = product(colors, _TO_RRT.T)
    fitted = (v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.4329510) + 0.238081)
    shown: Colors = product(fitted, _TO_SRGB.T).clip(0.0, 1.0)
    return shown


ACES = Curve("aces", "ACES 1.x, fitted by Stephen Hill: high contrast, darker in the middle", _apply)
