"""Values that vary over a surface."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from wrt.values import ColorLike, image


@dataclass(frozen=True, eq=False)
class ImageTexture:
    """An image laid over a mesh by its texture coordinates, bilinearly filtered and repeated.

    Attributes:
        pixels: (H, W, 3) float32, linear Rec. 709; row 0 is the top, at v = 1.
        name: where the pixels came from, for messages.
    """

    pixels: NDArray[np.float32] = field(repr=False)
    name: str = "image"

    def __post_init__(self) -> None:
        object.__setattr__(self, "pixels", image(self.pixels, f"texture {self.name}"))


@dataclass(frozen=True)
class VertexColor:
    """The mesh's own colours, interpolated over each triangle (white where it has none)."""


ColorSource: TypeAlias = ColorLike | ImageTexture | VertexColor
"""A constant colour, an image, or the mesh's vertex colours."""
