"""What a tone curve is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

from numpy.typing import NDArray

Colors: TypeAlias = NDArray[Any]
"""(..., 3) float64."""


@dataclass(frozen=True)
class Curve:
    """A tone curve: from the radiance of a scene to the light of a display.

    Attributes:
        name: its name in options and scene files.
        summary: what it does, in one line.
        apply: maps (..., 3) linear Rec. 709 radiance, finite and not negative, to the linear light of an sRGB display,
            0 to 1. The second argument is the radiance of the picture's brightest parts (`wrt.develop.exposure.peak`).
    """

    name: str
    summary: str
    apply: Callable[[Colors, float], Colors]
