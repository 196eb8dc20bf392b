"""Decode the images that a mesh file embeds or names, for textures.

A missing or damaged image is left out with one warning; the rest of the file is used.
"""

from __future__ import annotations

import importlib.util
import io
import math
import struct
from collections.abc import Callable, Hashable
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, warn
from wrt.io.images import FLOAT_SUFFIXES, open_image, pixels_of, read_float, require_pixels
from wrt.io.safe_read import first_line, read_file
from wrt.values import sealed

if TYPE_CHECKING:
    from PIL.Image import Image

Source: TypeAlias = "Image | bytes | Path"  # an image: decoded by another library, encoded bytes, or a file

KINDS = ("color", "data", "alpha")
"""What to read: colours, sRGB if they have 8 bits; linear data; or the alpha channel, repeated three times."""


class TextureImages:
    """The images of one file: each is opened once, and decoded once per kind of use."""

    def __init__(self, path: str | Path) -> None:
        """Start without images; `path` is the file, for messages."""
        self._path = path
        self._opened: dict[Hashable, Image | Path | None] = {}
        self._pixels: dict[tuple[Hashable, str, float, float], NDArray[np.float32] | None] = {}

    def pixels(
        self,
        key: Hashable,
        kind: str,
        label: str,
        source: Callable[[], Source],
        *,
        least: float = 0.0,
        most: float = 1.0,
    ) -> NDArray[np.float32] | None:
        """Return (H, W, 3) linear values, read-only and within bounds, or None if the image is left out.

        Args:
            key: identifies the image in later calls.
            kind: one of KINDS. Without an alpha channel, the colour channels are read as data in its place.
            label: name of the image in warnings, such as "image 3".
            source: called once for the image; may raise InputError, as when the file is missing.
            least: values below are set to this.
            most: values above are set to this.
        """
        place = key, kind, least, most
        if place not in self._pixels:
            opened = self._image(key, label, source)
            try:
                found = None if opened is None else sealed(_within(_decoded(opened, kind), least, most))
                self._pixels[place] = found
            except Exception as error:  # noqa: BLE001 - decoders raise undocumented exceptions on damaged images
                self._leave_out(key, label, error)
                self._pixels[place] = None
        return self._pixels[place]

    def has_alpha(self, key: Hashable, label: str, source: Callable[[], Source]) -> bool:
        """Return whether an image has an alpha channel that is not opaque everywhere."""
        image = self._image(key, label, source)
        if image is None or isinstance(image, Path) or not _with_alpha(image):
            return False
        pixels = self.pixels(key, "alpha", label, source)
        return pixels is not None and bool(pixels.min() < 1.0)

    def _image(self, key: Hashable, label: str, source: Callable[[], Source]) -> Image | Path | None:
        """Return an open image, the path of a floating-point image, or None if it was left out."""
        if key not in self._opened:
            self._opened[key] = None
            try:
                found = source()
            except InputError as error:
                warn(f"{error}; it is left out")
                return None
            try:
                if isinstance(found, Path) and found.suffix.lower() not in FLOAT_SUFFIXES:
                    found = read_file(found)
                if isinstance(found, bytes):
                    found = _opened(found)
                self._opened[key] = found
            except Exception as error:  # noqa: BLE001 - decoders raise undocumented exceptions on damaged images
                self._leave_out(key, label, error)
        return self._opened[key]

    def _leave_out(self, key: Hashable, label: str, error: Exception) -> None:
        self._opened[key] = None
        warn(f"{self._path}: {label} left out: it cannot be decoded: {first_line(error)}")


def _opened(data: bytes) -> Image:
    if data.startswith(KTX2_IDENTIFIER):
        return open_ktx2(data)
    image = open_image(io.BytesIO(data))
    image.load()
    return image


def _decoded(image: Image | Path, kind: str) -> NDArray[np.float32]:
    if isinstance(image, Path):
        return read_float(image, alpha=kind == "alpha")
    if kind == "alpha" and _with_alpha(image):
        image = image.convert("RGBA").getchannel("A")
    return pixels_of(image, linear=kind != "color")


def _with_alpha(image: Image) -> bool:
    return "A" in image.getbands() or "transparency" in image.info


def _within(pixels: NDArray[np.float32], least: float, most: float) -> NDArray[np.float32]:
    low, high = float(pixels.min()), float(pixels.max())
    if not (math.isfinite(low) and math.isfinite(high)):
        raise InputError("it has infinite or NaN values")
    # Most images are within the bounds and need no copy.
    return pixels if least <= low and high <= most else np.clip(pixels, least, most)


# --- KTX2 ------------------------------------------------------------------------------------------
# Images of Basis Universal (ETC1S and UASTC, with Zstandard too), decoded by the package opengl_basisu.
# Format: Khronos Group 2020, "KTX File Format Specification", version 2, section 3.

KTX2_IDENTIFIER = b"\xabKTX 20\xbb\r\n\x1a\n"  # the first bytes of a file
KTX2_HINT = "pip install 'wrt[ktx2]'"  # how to get the decoder
_HEADER = 48  # bytes before the index of levels
_EXTENT = struct.Struct("<5I")  # width, height, depth, layers and faces, at byte 20


def has_ktx2_decoder() -> bool:
    """Return whether the decoder is installed."""
    return importlib.util.find_spec("opengl_basisu") is not None


def open_ktx2(data: bytes) -> Image:
    """Decode the largest level of a flat image, as Pillow image with or without alpha.

    Raises:
        InputError: without the decoder, on damaged data, on pixels that are not Basis Universal's, and on large images.
    """
    from PIL import Image

    if len(data) < _HEADER:
        raise InputError("the KTX2 file is truncated")
    width, height, depth, _, faces = _EXTENT.unpack_from(data, 20)
    if width == 0 or height == 0 or depth > 1 or faces != 1:
        raise InputError("the KTX2 file is no flat image")
    require_pixels(width, height)
    try:
        import opengl_basisu
    except ImportError:
        raise InputError(f"a KTX2 image needs a decoder: {KTX2_HINT}") from None
    try:
        texture = opengl_basisu.open(data)
        image = texture.transcode("rgba8")
    except ValueError as error:  # what the package raises on damaged and on unknown data
        raise InputError(first_line(error)) from None
    decoded = Image.fromarray(image.data)
    return decoded if texture.has_alpha else decoded.convert("RGB")
