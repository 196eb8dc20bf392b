"""Textures: values that vary over a surface."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass, field
from functools import partial
from typing import Annotated, Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.scene.description import Color, Description, Flag, Kind, Number, optional, word_of
from wrt.values import ColorLike, image, integer, number, one_of, pair

CHANNELS = ("r", "g", "b")
"""Names of an image's channels."""

WRAPS = ("repeat", "mirror", "clamp")
"""How an image continues beyond its edges: repeated, mirrored, or with its outermost texels."""

TEXTURE_FILTERS = ("bilinear", "nearest", "trilinear")
"""Texture filters. "trilinear" interpolates between two levels of a mipmap, each half the size of the one before."""


def _one_or_two(value: float | Sequence[float], name: str) -> tuple[float, float]:
    return pair((value, value) if isinstance(value, (int, float)) else value, name)


def _two_wraps(wrap: str | Sequence[str], name: str) -> tuple[str, ...]:
    wraps = (wrap, wrap) if isinstance(wrap, str) else tuple(wrap)
    if len(wraps) != 2:
        raise InputError(f"{name} must be one of {', '.join(WRAPS)}, or two of them for u and v")
    return tuple(one_of(each, WRAPS, name) for each in wraps)


_Cutoff = Annotated[float | None, optional(partial(number, minimum=0.0))]
_Wrap = Annotated[str | Sequence[str], _two_wraps]


@dataclass(frozen=True, eq=False)
class ImageTexture(Description):
    """An image mapped to a mesh by its texture coordinates.

    A parameter that is a number reads the red channel, unless `channel` names another. Load images of numbers, not
    colours, with `load_image(path, linear=True)`.

    Texture coordinates are scaled, then turned counter-clockwise about (0, 0), then shifted; a larger scale makes the
    image smaller. Where a pixel covers many texels, its samples average them. With the filter "trilinear" the first
    samples read coarse mipmap levels and later ones finer levels, which reduces the noise of few samples and converges
    to the same picture.

    Attributes:
        pixels: (H, W, 3) float32, linear Rec. 709; row 0 is the top, at v = 1.
        name: source of the pixels, for messages.
        channel: "r", "g" or "b" to use this channel for all three.
        factor: multiplies the pixels; for emission, the radiance of white, W·sr⁻¹·m⁻².
        scale: scale of the texture coordinates, one number or two for u and v.
        rotation_degrees: rotation of the texture coordinates.
        offset: offset of the texture coordinates, u and v.
        wrap: one of WRAPS, or two for u and v.
        filter: one of TEXTURE_FILTERS.
        cutoff: threshold of a mask: values from it on become 1, others 0.
        vertex_colors: whether the mesh's vertex colours multiply the image.
        vertex_alpha: whether their alpha multiplies the image before the cutoff, for opacity.
        uv_set: which of the mesh's two sets of texture coordinates to use, 0 or 1.
    """

    pixels: Annotated[NDArray[np.float32], image] = field(repr=False)
    name: str = "image"
    channel: Annotated[str | None, optional(word_of(CHANNELS))] = None
    factor: Color = 1.0
    scale: Annotated[float | Sequence[float], _one_or_two] = 1.0
    rotation_degrees: Number = 0.0
    offset: Annotated[Sequence[float], pair] = (0.0, 0.0)
    wrap: _Wrap = "repeat"
    filter: Annotated[str, word_of(TEXTURE_FILTERS)] = "bilinear"
    cutoff: _Cutoff = None
    vertex_colors: Flag = False
    vertex_alpha: Flag = False
    uv_set: Annotated[int, partial(integer, minimum=0, maximum=1)] = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.vertex_colors and self.vertex_alpha:
            raise InputError(f"texture {self.name}: use either vertex_colors or vertex_alpha, not both")

    def _label(self, name: str) -> str:
        return f"texture {self.name}: {name}"

    @property
    def has_levels(self) -> bool:
        """Whether it has mipmap levels. Masks have none, because averaging their pixels gives no mask."""
        return self.filter == "trilinear" and self.cutoff is None

    @property
    def placement(self) -> NDArray[np.float64]:
        """The (2, 3) matrix from texture coordinates (u, v, 1) to image coordinates."""
        return _placement(self.scale, self.rotation_degrees, self.offset)


def _placement(scale: Any, rotation_degrees: float, offset: Sequence[float]) -> NDArray[np.float64]:
    turn = math.radians(rotation_degrees)
    c, s = math.cos(turn), math.sin(turn)
    (su, sv), (ou, ov) = scale, offset
    return np.array([[c * su, -s * sv, ou], [s * su, c * sv, ov]])


@dataclass(frozen=True)
class VertexColor(Description):
    """The mesh's vertex colours, interpolated over each triangle (white if it has none).

    Attributes:
        factor: multiplies the colours.
        alpha: whether to use their alpha instead of red, green and blue (1 if they have none), for opacity.
        cutoff: threshold of a mask: values from it on become 1, others 0.
    """

    factor: Color = 1.0
    alpha: Flag = False
    cutoff: _Cutoff = None

    def _label(self, name: str) -> str:
        return f"vertex colours: {name}"


NORMAL_CONVENTIONS = ("gltf", "mitsuba", "right-handed")
"""Conventions of normal maps, in the order of their numbers in `kernels/textures/normal_maps.py`."""


def _encoded_normals(value: NDArray[np.float32] | ImageTexture, name: str) -> NDArray[np.float32]:
    pixels = image(value.pixels if isinstance(value, ImageTexture) else value, name)
    if pixels.max() > 1.0:
        raise InputError(f"{name} must be 0 to 1, not {pixels.max():g}")
    return pixels


@dataclass(frozen=True, eq=False)
class NormalMap(Description):
    """Shading normals in tangent space, as in glTF 2.0 (section 3.9.3): n = 2c − 1 of a colour c.

    x points along u, y along v, z along the mesh's own normal; blue is at least 1/2. The pixels are data, not colours:
    load them with `load_image(path, linear=True)`.

    From far away, bumps are smaller than a pixel. Many samples average them; with `filter` the pixel's footprint is
    averaged beforehand (LEAN mapping, Olano and Baker 2010): the mean normal is kept, and the variance around it makes
    the surface rougher. Highlights are then free of noise, but accurate only to second order in the slopes;
    docs/notes/filtered-highlights.md has their errors. It acts on surfaces that the camera sees directly and whose
    material has a roughness.

    Attributes:
        pixels: (H, W, 3) float32, 0 to 1; row 0 is the top, at v = 1. Also an ImageTexture.
        scale: multiplies x and y.
        filter: whether to filter highlights.
        name: source of the pixels, for messages.
        wrap: as for an ImageTexture.
        heights: whether the pixels are heights, in red: a bump map; `scale` is in metres then.
        convention: "gltf"; "mitsuba": y points along normal × u, normals that face away from the viewer are mirrored,
            and light from near the horizon is reduced (Estevez, Lecocq and Stellpflug 2019); or "right-handed", with
            the first of these only.
        uv_scale, uv_rotation_degrees, uv_offset: as of an ImageTexture, without the `uv_`; x and y of the normals stay.
        uv_set: which texture coordinates a `coat_normal_map` uses, 0 or 1; x and y follow the first ones.
    """

    pixels: Annotated[NDArray[np.float32] | ImageTexture, _encoded_normals] = field(repr=False)
    scale: Number = 1.0
    filter: Flag = False
    name: str = "normal map"
    wrap: _Wrap = "repeat"
    heights: Flag = False
    convention: Annotated[str, word_of(NORMAL_CONVENTIONS)] = "gltf"
    uv_scale: Annotated[float | Sequence[float], _one_or_two] = 1.0
    uv_rotation_degrees: Number = 0.0
    uv_offset: Annotated[Sequence[float], pair] = (0.0, 0.0)
    uv_set: Annotated[int, partial(integer, minimum=0, maximum=1)] = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.filter and (self.heights or self.convention != "gltf"):
            raise InputError("normal map: filter is for normals by the convention of glTF")
        if self.heights and self.uv_set != 0:
            raise InputError("normal map: heights follow the first texture coordinates")

    def _label(self, name: str) -> str:
        return f"normal map {self.name}: {name}"

    @property
    def placement(self) -> NDArray[np.float64]:
        """The (2, 3) matrix from texture coordinates (u, v, 1) to image coordinates."""
        return _placement(self.uv_scale, self.uv_rotation_degrees, self.uv_offset)


@dataclass(frozen=True)
class Texture(Kind):
    """Base of procedural textures: functions of a point on the surface. Not used by itself.

    They stand wherever an image may, except for emission. `model` names the device function, which reads the
    attributes in `slot_names` in that order, each a number or a colour.

    Attributes:
        factor: multiplies the values.
    """

    _: KW_ONLY
    factor: Color = 1.0

    slot_names: ClassVar[tuple[str, ...]] = ()

    @property
    def slots(self) -> tuple[ColorLike, ...]:
        """The values that the device function reads."""
        return tuple(getattr(self, name) for name in self.slot_names)

    @property
    def bounds(self) -> tuple[ColorLike, ...]:
        """Colours between which its own lie, by which they are checked; none if that is unknown."""
        return ()

    @property
    def needs_uv(self) -> bool:
        """Whether it reads texture coordinates, so that meshes without are warned of."""
        return False


ColorSource: TypeAlias = ColorLike | ImageTexture | VertexColor | Texture
"""A constant colour, an image, the mesh's vertex colours, or a procedural texture."""

Varying: TypeAlias = ImageTexture | VertexColor | Texture
VARYING = (ImageTexture, VertexColor, Texture)
"""What varies over a surface."""


def checked_texture(texture: Varying, check: Callable[[Any], Any]) -> Varying:
    """Return a texture after `check` has accepted all its known values."""
    for color_or_number in texture.bounds if isinstance(texture, Texture) else ():
        check(np.multiply(color_or_number, texture.factor).tolist())
    return texture


def shines(emission: ColorSource) -> bool:
    """Return whether a checked emission is not black everywhere."""
    if isinstance(emission, Texture):
        raise InputError(f"a {emission.type_name} texture cannot emit: lights are chosen by a power that it lacks")
    if isinstance(emission, ImageTexture):
        return any(emission.factor) and bool(emission.pixels.any())  # type: ignore[arg-type]
    return any(emission.factor if isinstance(emission, VertexColor) else emission)  # type: ignore[arg-type]


class FirstAlike:
    """Finds equal images, since textures made from one array may hold a copy each."""

    def __init__(self) -> None:
        """Start without any image."""
        self._alike: dict[tuple[tuple[int, ...], bytes], list[NDArray[np.float32]]] = {}

    def __call__(self, pixels: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the first array passed so far that equals `pixels`."""
        some = pixels.reshape(-1)[:: 1 + pixels.size // 64].tobytes()
        alike = self._alike.setdefault((pixels.shape, some), [])
        found = next((each for each in alike if each is pixels or np.array_equal(each, pixels)), None)
        if found is None:
            alike.append(pixels)
        return pixels if found is None else found
