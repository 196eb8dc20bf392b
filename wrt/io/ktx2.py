"""KTX2 images of Basis Universal (ETC1S and UASTC, with Zstandard too), decoded by the package opengl_basisu.

Format: Khronos Group 2020, "KTX File Format Specification", version 2, section 3.
"""

from __future__ import annotations

import importlib.util
import struct
from typing import TYPE_CHECKING

from wrt.errors import InputError
from wrt.io.safe_read import first_line

if TYPE_CHECKING:
    from PIL.Image import Image

IDENTIFIER = b"\xabKTX 20\xbb\r\n\x1a\n"  # the first bytes of a file
HINT = "pip install 'wrt[ktx2]'"  # how to get the decoder
_HEADER = 48  # bytes before the index of levels
_EXTENT = struct.Struct("<5I")  # width, height, depth, layers and faces, at byte 20


def has_decoder() -> bool:
    """Return whether the decoder is installed."""
    return importlib.util.find_spec("opengl_basisu") is not None


def open_ktx2(data: bytes) -> Image:
    """Decode the largest level of a flat image, as Pillow image with or without alpha.

    Raises:
        InputError: without the decoder, on damaged data, on pixels that are not Basis Universal's, and on large images.
    """
    from PIL import Image

    from wrt.io.images import require_pixels

    if len(data) < _HEADER:
        raise InputError("the KTX2 file is truncated")
    width, height, depth, _, faces = _EXTENT.unpack_from(data, 20)
    if width == 0 or height == 0 or depth > 1 or faces != 1:
        raise InputError("the KTX2 file is no flat image")
    require_pixels(width, height)
    try:
        import opengl_basisu
    except ImportError:
        raise InputError(f"a KTX2 image needs a decoder: {HINT}") from None
    try:
        texture = opengl_basisu.open(data)
        image = texture.transcode("rgba8")
    except ValueError as error:  # what the package raises on damaged and on unknown data
        raise InputError(first_line(error)) from None
    decoded = Image.fromarray(image.data)
    return decoded if texture.has_alpha else decoded.convert("RGB")
