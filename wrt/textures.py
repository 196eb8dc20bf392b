"""Values that vary over a surface."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.values import ColorLike, boolean, image, number

CHANNELS = ("r", "g", "b")
"""Names of an image's channels."""


@dataclass(frozen=True, eq=False)
class ImageTexture:
    """An image laid over a mesh by its texture coordinates, bilinearly filtered and repeated.

    Where a material wants a number it takes the red channel, unless another is named. Images that hold numbers, not
    colours, are read by `load_image(path, linear=True)`.

    Attributes:
        pixels: (H, W, 3) float32, linear Rec. 709; row 0 is the top, at v = 1.
        name: where the pixels came from, for messages.
        channel: "r", "g" or "b": this one alone, standing for all three. glTF keeps roughness in green and
            metalness in blue of one image.
    """

    pixels: NDArray[np.float32] = field(repr=False)
    name: str = "image"
    channel: str | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "pixels", image(self.pixels, f"texture {self.name}"))
        if self.channel is not None and self.channel not in CHANNELS:
            raise InputError(f"texture {self.name}: channel must be 'r', 'g' or 'b', not {self.channel!r}")


@dataclass(frozen=True)
class VertexColor:
    """The mesh's own colours, interpolated over each triangle (white where it has none)."""


@dataclass(frozen=True, eq=False)
class NormalMap:
    """Shading normals in tangent space, as in glTF 2.0 (section 3.9.3): n = 2c − 1 of a colour c.

    x runs along growing u, y along growing v, z along the mesh's own normal; blue is at least 1/2. The pixels are
    data, not colours: read them by `load_image(path, linear=True)`.

    Seen from far away, a bumpy map is finer than a pixel. Many samples find its mean by themselves; with `filter`,
    what a pixel covers is averaged beforehand (LEAN mapping, Olano and Baker 2010): the mean normal remains, and the
    variance around it goes into the roughness. Highlights then are free of noise, but right to second order in the
    slopes only. It acts on what the camera sees directly, and on materials with a roughness.

    Attributes:
        pixels: (H, W, 3) float32, 0 to 1; row 0 is the top, at v = 1. Also an ImageTexture.
        scale: multiplies x and y.
        filter: whether highlights are filtered.
        name: where the pixels came from, for messages.
    """

    pixels: NDArray[np.float32] | ImageTexture = field(repr=False)
    scale: float = 1.0
    filter: bool = False
    name: str = "normal map"

    def __post_init__(self) -> None:
        given = self.pixels.pixels if isinstance(self.pixels, ImageTexture) else self.pixels
        pixels = image(given, f"normal map {self.name}")
        if pixels.max() > 1.0:
            raise InputError(f"normal map {self.name}: pixels must be 0 to 1, not {pixels.max():g}")
        object.__setattr__(self, "pixels", pixels)
        object.__setattr__(self, "scale", number(self.scale, "normal map scale"))
        boolean(self.filter, "normal map filter")


ColorSource: TypeAlias = ColorLike | ImageTexture | VertexColor
"""A constant colour, an image, or the mesh's vertex colours."""
