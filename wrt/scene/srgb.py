"""The sRGB transfer function, between linear light and 8-bit images."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import ArrayLike, NDArray


def srgb_from_linear(values: ArrayLike) -> NDArray[np.float64]:
    """Encode linear values in [0, 1] as sRGB (IEC 61966-2-1, section 5.2), without clipping; negatives stay linear."""
    x = np.asarray(values, np.float64)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 0.0031308) ** (1.0 / 2.4) - 0.055)


def linear_from_srgb(values: ArrayLike) -> NDArray[np.float64]:
    """Decode sRGB values in [0, 1] to linear light (IEC 61966-2-1, section 5.3)."""
    x = np.asarray(values, np.float64)
    return np.where(x <= 0.04045, x / 12.92, ((np.maximum(x, 0.04045) + 0.055) / 1.055) ** 2.4)


@functools.cache
def of_codes(*, linear: bool) -> NDArray[np.float32]:
    """Return the (256,) linear values of the codes of 8-bit images, which are linear or sRGB."""
    values = np.arange(256) / 255.0
    return (values if linear else linear_from_srgb(values)).astype(np.float32)
