"""Textures as images of 8 bits that decode to the same values, bit for bit."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.scene.srgb import of_codes


def codes_of(pixels: NDArray[np.float32], *, linear: bool) -> NDArray[np.uint8] | None:
    """Return the 8-bit codes whose values are those of an image, or None if there are none.

    Args:
        pixels: (H, W, 3).
        linear: whether codes stand for linear values; otherwise they are sRGB.
    """
    values = of_codes(linear=linear)
    places = np.searchsorted(values, pixels).clip(0, 255)
    if not np.array_equal(values[places], pixels):
        return None
    return places.astype(np.uint8)


def save_codes(handle: Any, codes: NDArray[np.uint8]) -> None:
    """Write (H, W, 3) codes to an open file as a PNG, with one channel where all three are the same."""
    from PIL import Image

    grey = bool((codes == codes[..., :1]).all())
    Image.fromarray(np.ascontiguousarray(codes[..., 0] if grey else codes)).save(handle, format="PNG")
