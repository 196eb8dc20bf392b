"""Values that vary over a surface."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.values import ColorLike, boolean, color, image, integer, number, one_of, pair

CHANNELS = ("r", "g", "b")
"""Names of an image's channels."""

WRAPS = ("repeat", "mirror", "clamp")
"""How an image goes on beyond its edges: again, mirrored, or with its outermost texels."""

TEXTURE_FILTERS = ("bilinear", "nearest", "trilinear")
"""What a point of an image is: interpolated between four texels, the nearest one, or interpolated between four texels
each of two of the image's levels, which are it at half its size, a quarter, and so on."""


@dataclass(frozen=True, eq=False)
class ImageTexture:
    """An image laid over a mesh by its texture coordinates.

    Where a material wants a number it takes the red channel, unless another is named. Images that hold numbers, not
    colours, are read by `load_image(path, linear=True)`.

    Texture coordinates are scaled, then turned counter-clockwise about (0, 0), then shifted: larger scales make
    the image smaller. An image far away has many texels in a pixel; the pixel's samples average them. With the filter
    "trilinear" the first of them read means of texels, later ones smaller and smaller pieces: less noise in a picture
    of few samples, the same one of many.

    Attributes:
        pixels: (H, W, 3) float32, linear Rec. 709; row 0 is the top, at v = 1.
        name: where the pixels came from, for messages.
        channel: "r", "g" or "b": this one alone, standing for all three. glTF keeps roughness in green and
            metalness in blue of one image.
        factor: multiplies the pixels: of an image that shines, what white is, W·sr⁻¹·m⁻².
        scale: of the texture coordinates, one number or one for u and one for v.
        rotation_degrees: of the texture coordinates.
        offset: added to the texture coordinates, u and v.
        wrap: one of WRAPS, or two, for u and for v.
        filter: one of TEXTURE_FILTERS.
        cutoff: for masks: what reaches it is 1, all else 0.
        vertex_colors: whether the mesh's own colours multiply the image.
        vertex_alpha: whether the alpha of the mesh's colours does, before the cutoff: for opacity.
        uv_set: which of the mesh's two sets of texture coordinates is meant, 0 or 1.
    """

    pixels: NDArray[np.float32] = field(repr=False)
    name: str = "image"
    channel: str | None = None
    factor: ColorLike = 1.0
    scale: float | Sequence[float] = 1.0
    rotation_degrees: float = 0.0
    offset: Sequence[float] = (0.0, 0.0)
    wrap: str | Sequence[str] = "repeat"
    filter: str = "bilinear"
    cutoff: float | None = None
    vertex_colors: bool = False
    vertex_alpha: bool = False
    uv_set: int = 0

    def __post_init__(self) -> None:
        def put(name: str, value: object) -> None:
            object.__setattr__(self, name, value)

        what = f"texture {self.name}"
        put("pixels", image(self.pixels, what))
        if self.channel is not None:
            one_of(self.channel, CHANNELS, f"{what}: channel")
        put("factor", color(self.factor, f"{what}: factor"))
        scale = self.scale
        put("scale", pair((scale, scale) if isinstance(scale, (int, float)) else scale, f"{what}: scale"))
        put("rotation_degrees", number(self.rotation_degrees, f"{what}: rotation_degrees"))
        put("offset", pair(self.offset, f"{what}: offset"))
        put("wrap", _two_wraps(self.wrap, what))
        one_of(self.filter, TEXTURE_FILTERS, f"{what}: filter")
        if self.cutoff is not None:
            put("cutoff", number(self.cutoff, f"{what}: cutoff", minimum=0.0))
        boolean(self.vertex_colors, f"{what}: vertex_colors")
        boolean(self.vertex_alpha, f"{what}: vertex_alpha")
        if self.vertex_colors and self.vertex_alpha:
            raise InputError(f"{what}: either vertex_colors or vertex_alpha can multiply it, not both")
        put("uv_set", integer(self.uv_set, f"{what}: uv_set", minimum=0, maximum=1))

    @property
    def has_levels(self) -> bool:
        """Whether it is looked at in several sizes. The mean of a mask's pixels is no mask."""
        return self.filter == "trilinear" and self.cutoff is None

    @property
    def placement(self) -> NDArray[np.float64]:
        """(2, 3) the matrix from texture coordinates (u, v, 1) to those in the image."""
        turn = math.radians(self.rotation_degrees)
        c, s = math.cos(turn), math.sin(turn)
        su, sv = self.scale  # type: ignore[misc]
        ou, ov = self.offset
        return np.array([[c * su, -s * sv, ou], [s * su, c * sv, ov]])


@dataclass(frozen=True)
class VertexColor:
    """The mesh's own colours, interpolated over each triangle (white where it has none).

    Attributes:
        factor: multiplies the colours.
        alpha: whether their alpha is meant in place of red, green and blue (1 where they have none): for opacity.
        cutoff: for masks: what reaches it is 1, all else 0.
    """

    factor: ColorLike = 1.0
    alpha: bool = False
    cutoff: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "factor", color(self.factor, "vertex colours: factor"))
        boolean(self.alpha, "vertex colours: alpha")
        if self.cutoff is not None:
            object.__setattr__(self, "cutoff", number(self.cutoff, "vertex colours: cutoff", minimum=0.0))


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
        wrap: as of an ImageTexture.
    """

    pixels: NDArray[np.float32] | ImageTexture = field(repr=False)
    scale: float = 1.0
    filter: bool = False
    name: str = "normal map"
    wrap: str | Sequence[str] = "repeat"

    def __post_init__(self) -> None:
        given = self.pixels.pixels if isinstance(self.pixels, ImageTexture) else self.pixels
        pixels = image(given, f"normal map {self.name}")
        if pixels.max() > 1.0:
            raise InputError(f"normal map {self.name}: pixels must be 0 to 1, not {pixels.max():g}")
        object.__setattr__(self, "pixels", pixels)
        object.__setattr__(self, "scale", number(self.scale, "normal map scale"))
        boolean(self.filter, "normal map filter")
        object.__setattr__(self, "wrap", _two_wraps(self.wrap, f"normal map {self.name}"))


def _two_wraps(wrap: str | Sequence[str], what: str) -> tuple[str, ...]:
    wraps = (wrap, wrap) if isinstance(wrap, str) else tuple(wrap)
    if len(wraps) != 2:
        raise InputError(f"{what}: wrap must be one of {', '.join(WRAPS)}, or two of them for u and v")
    return tuple(one_of(each, WRAPS, f"{what}: wrap") for each in wraps)


ColorSource: TypeAlias = ColorLike | ImageTexture | VertexColor
"""A constant colour, an image, or the mesh's vertex colours."""


def shines(emission: ColorSource) -> bool:
    """Return whether an emission, checked, is anything but black everywhere."""
    if isinstance(emission, ImageTexture):
        return any(emission.factor) and bool(emission.pixels.any())  # type: ignore[arg-type]
    return any(emission.factor if isinstance(emission, VertexColor) else emission)  # type: ignore[arg-type]


class FirstAlike:
    """Finds images that are equal: textures made from one array hold a copy each."""

    def __init__(self) -> None:
        """Start without any image."""
        self._alike: dict[tuple[tuple[int, ...], bytes], list[NDArray[np.float32]]] = {}

    def __call__(self, pixels: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the first array of pixels asked for that equals `pixels`."""
        some = pixels.reshape(-1)[:: 1 + pixels.size // 64].tobytes()
        alike = self._alike.setdefault((pixels.shape, some), [])
        found = next((each for each in alike if each is pixels or np.array_equal(each, pixels)), None)
        if found is None:
            alike.append(pixels)
        return pixels if found is None else found
