"""Values that vary over a surface."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.values import ColorLike


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
        pixels = np.ascontiguousarray(self.pixels, dtype=np.float32)
        if pixels.ndim != 3 or pixels.shape[2] != 3 or pixels.size == 0:
            raise InputError(f"texture {self.name}: pixels must be (H, W, 3), not {pixels.shape}")
        if not np.isfinite(pixels).all() or (pixels < 0).any():
            raise InputError(f"texture {self.name}: pixels must be finite and not negative")
        object.__setattr__(self, "pixels", pixels)


@dataclass(frozen=True)
class VertexColor:
    """The mesh's own colours, interpolated over each triangle (white where it has none)."""


ColorSource: TypeAlias = ColorLike | ImageTexture | VertexColor
"""A constant colour, an image, or the mesh's vertex colours."""
