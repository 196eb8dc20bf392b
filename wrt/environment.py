"""Light that arrives from infinitely far away, from every direction."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from wrt.values import ColorLike, color, image, number


@dataclass(frozen=True)
class ConstantEnvironment:
    """The same radiance from every direction.

    Attributes:
        radiance: per channel, W·sr⁻¹·m⁻².
    """

    radiance: ColorLike = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "radiance", color(self.radiance, "radiance"))


@dataclass(frozen=True, eq=False)
class ImageEnvironment:
    """Radiance from an image in latitude-longitude layout, sampled by its brightness.

    Row 0 is straight up (+y). At rotation 0 the middle column is the direction −z and columns
    to its right turn towards +x, as for a person looking along −z.

    Attributes:
        pixels: (H, W, 3) float32, linear radiance, W·sr⁻¹·m⁻².
        scale: multiplies the pixels.
        rotation_degrees: turns the environment about +y, counter-clockwise seen from above.
        name: where the pixels came from, for messages.
    """

    pixels: NDArray[np.float32] = field(repr=False)
    scale: float = 1.0
    rotation_degrees: float = 0.0
    name: str = "environment"

    def __post_init__(self) -> None:
        object.__setattr__(self, "pixels", image(self.pixels, f"environment {self.name}"))
        object.__setattr__(self, "scale", number(self.scale, "scale", minimum=0.0))
        object.__setattr__(self, "rotation_degrees", number(self.rotation_degrees, "rotation_degrees"))
