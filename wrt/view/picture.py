"""From the film to the bytes of a frame of the live view."""

from __future__ import annotations

import functools
import io
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.develop.exposure import peak, stops
from wrt.develop.picture import develop_image
from wrt.develop.tones import CURVES
from wrt.rendering.picture import layer_colors
from wrt.rendering.renderer import Renderer
from wrt.scene.srgb import srgb_from_linear
from wrt.view.controls import Look

CODES = 4096
"""Entries of the table from the square root of radiance to 8-bit codes: neighbours differ by less than one code."""

WHITE = np.float32(1e6)
"""Radiance that is white by every curve; the curves' squares of it are finite in float32."""

MOVING_QUALITY, RESTING_QUALITY = 80, 93
"""JPEG quality of frames while the camera moves and while the picture converges."""


def develop(radiance: NDArray[np.float32], look: Look) -> NDArray[np.uint8]:
    """Return (H, W, 3) linear radiance as 8-bit codes, within one code of those of PNG files.

    They are not dithered: that takes longer than all other steps, and JPEG would spend its bits on it.
    """
    exposure = stops(radiance, look.exposure)
    if look.tone not in CURVES:  # a view of OpenColorIO
        return develop_image(radiance, tone=look.tone, exposure=exposure)
    with np.errstate(invalid="ignore", over="ignore"):
        exposed = np.nan_to_num(radiance * np.float32(2.0**exposure)).clip(0.0, WHITE)
    shown = CURVES[look.tone](exposed, peak(exposed)).clip(0.0, 1.0)
    codes: NDArray[np.uint8] = _table()[(np.sqrt(shown) * (CODES - 1) + 0.5).astype(np.intp)]
    return codes


@functools.cache
def _table() -> NDArray[np.uint8]:
    values = (np.arange(CODES) / (CODES - 1)) ** 2
    return np.floor(255.0 * srgb_from_linear(values) + 0.5).astype(np.uint8)


def shown_image(renderer: Renderer, layer: str) -> tuple[Callable[[], NDArray[np.float32]], bool]:
    """Return a function for the (H, W, 3) linear colours of a layer, and whether they are radiance.

    The function returns the present picture, whenever another thread calls it; radiance is yet to be read by the
    `reading` of the film.

    Args:
        renderer: the renderer, which has the layer.
        layer: the name of a layer; "noise" for the relative standard error of each pixel, where white is 100 %; or ""
            for radiance.
    """
    if layer == "noise":
        noise = noise_colors(renderer.image(), renderer.variance())
        return lambda: noise, False
    if layer:
        colors = layer_colors(layer, renderer.layers()[layer])
        return lambda: colors, False
    return renderer.film.snapshot(), True


def composed(renderer: Renderer) -> dict[str, Any] | None:
    """Return lines and background of a renderer's picture so far, as `develop` takes them; None without both."""
    parts = renderer._parts(None)  # shadow catchers are shown as surfaces
    if parts["lines"] is None and parts["background"] is None:
        return None
    return {**parts, "background": parts["background"] or (0.0, 0.0, 0.0)}


def noise_colors(image: NDArray[np.float32], variance: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return each pixel's standard error over its own radiance plus a tenth of the mean, as grey (H, W, 3)."""
    floor = 0.1 * max(float(image.mean()), 1e-12)
    error = np.sqrt(np.nan_to_num(variance.mean(axis=2))) / (image.mean(axis=2) + floor)
    grey = np.clip(error, 0.0, 1.0).astype(np.float32)
    return np.repeat(grey[..., None], 3, axis=2)


def jpeg(codes: NDArray[np.uint8], quality: int) -> bytes:
    """Return 8-bit codes as a JPEG file, without chroma subsampling at high quality."""
    return _encoded(codes, "JPEG", quality=quality, subsampling=0 if quality >= RESTING_QUALITY else 2)


def png(codes: NDArray[np.uint8]) -> bytes:
    """Return 8-bit codes as a PNG file."""
    return _encoded(codes, "PNG", compress_level=4)


def _encoded(codes: NDArray[np.uint8], kind: str, **options: Any) -> bytes:
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(codes).save(buffer, kind, **options)
    return buffer.getvalue()
