"""Map layers to colours for 8-bit pictures; OpenEXR files hold the numbers themselves."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.scene.srgb import linear_from_srgb


def layer_colors(name: str, values: NDArray[Any]) -> NDArray[np.float32]:
    """Return a layer as (H, W, 3) float32 linear colours, for an 8-bit picture.

    Albedo and coverage are unchanged. Normals map -1 to 1 to 0 to 255. Depth is white at the nearest point and black at
    the farthest. Each coordinate of positions runs from black at its lowest to full at its highest value. Texture
    coordinates repeat every 1, in red and green. Zero motion is grey, and the longest reaches the limits. Each object
    and material has its own colour.
    """
    if name == "albedo":
        shown = np.asarray(values, np.float64)
    elif name == "alpha":
        shown = np.repeat(np.asarray(values, np.float64)[..., None], 3, axis=2)
    elif name in ("object", "material"):
        shown = _colors(values)
    else:
        shown = linear_from_srgb(np.clip(_codes(name, np.asarray(values, np.float64)), 0.0, 1.0))
    return shown.astype(np.float32)


def _codes(name: str, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return sRGB values 0 to 1, so that equal differences of a layer are equal differences of 8-bit codes."""
    if name in ("normal", "geometric_normal"):
        return 0.5 + 0.5 * values
    if name == "depth":
        finite = np.isfinite(values)
        low, high = (values[finite].min(), values[finite].max()) if finite.any() else (0.0, 0.0)
        near = np.where(finite, (high - np.where(finite, values, high)) / max(high - low, 1e-30), 0.0)
        # Keep the farthest point distinct from the background.
        return np.repeat((near * 0.95 + 0.05 * finite)[..., None], 3, axis=2)
    if name == "position":
        low, high = values.min(axis=(0, 1)), values.max(axis=(0, 1))
        scaled: NDArray[np.float64] = (values - low) / np.maximum(high - low, 1e-30)
        return scaled
    red_green = values % 1.0 if name == "uv" else 0.5 + 0.5 * values / max(float(np.abs(values).max()), 1e-30)
    blue = np.full(values.shape[:2], 0.0 if name == "uv" else 0.5)
    return np.concatenate([red_green, blue[..., None]], axis=2)


def _colors(numbers: NDArray[Any]) -> NDArray[np.float64]:
    """Return colours that differ strongly between low numbers; 0 is black."""
    hue = (np.asarray(numbers, np.float64) * 0.6180339887498949) % 1.0
    wave = np.abs((hue[..., None] + np.array([0.0, 2.0 / 3.0, 1.0 / 3.0])) % 1.0 * 6.0 - 3.0) - 1.0
    colors: NDArray[np.float64] = (0.08 + 0.8 * np.clip(wave, 0.0, 1.0)) * (np.asarray(numbers) > 0)[..., None]
    return colors
