"""Develop radiance to 8 bits."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrt.develop.exposure import peak, stops
from wrt.develop.ocio import encode, find_view
from wrt.develop.quantize import quantize
from wrt.develop.settings import DEFAULT_TONE, Exposure, check_exposure, check_tone
from wrt.develop.tones import CURVES
from wrt.errors import InputError
from wrt.scene.srgb import srgb_from_linear
from wrt.values import FLOAT32_MAX, refuse_codes

NOTICEABLE = 0.05
"""Share of pixels that may clip to white before a warning: lamps, windows and their reflections are supposed to, and
take up to a twentieth of a picture of a room."""

_WHITE = 254.5 / 255.0


@dataclass(frozen=True)
class Developed:
    """A picture for a display.

    Attributes:
        codes: (H, W, 3) uint8, sRGB or in the encoding of the OpenColorIO display.
        stops: the exposure.
        tone: the tone curve.
        clipped: share of pixels, 0 to 1, that are brighter than white and have a channel at the brightest code.
        black: whether all but a thousandth of the pixels have no radiance.
    """

    codes: NDArray[np.uint8] = field(repr=False)  # notebooks show what a cell returns
    stops: float
    tone: str
    clipped: float
    black: bool = False

    @property
    def warning(self) -> str | None:
        """A warning about a black picture or lost highlights, or None if they are hardly noticeable."""
        if self.black:
            return "the picture is black: no light reaches what its camera sees"
        if self.clipped <= NOTICEABLE:
            return None
        what = f"{100.0 * self.clipped:.0f} % of the pixels are too bright and clipped"
        return f"{what}; darken it by --exposure {self.stops - 1.0:.3g} or auto, or choose another --tone"


def develop_image(image: ArrayLike, *, tone: str = DEFAULT_TONE, exposure: Exposure = None) -> NDArray[np.uint8]:
    """Return linear radiance as 8-bit codes for a display, as PNG files hold them.

    Args:
        image: (H, W, 3) linear Rec. 709 radiance, row 0 at the top, as `Renderer.image` and `load_image` return it. NaN
            becomes black.
        tone: name of the tone curve: "soft", "none", "neutral", "agx", "aces", "ocio" or
            "ocio:CONFIG,DISPLAY,VIEW" (see docs/tone.md).
        exposure: stops (factors of two) by which the picture is brightened first, or "auto". By default 0, unless the
            picture would be mostly white; see `wrt.develop.exposure.stops`. `Renderer.save` brightens dark renders too.

    Returns:
        (H, W, 3) uint8, dithered: row 0 at the top.

    Raises:
        InputError: if an argument cannot be used.
    """
    return develop(image, tone=tone, exposure=exposure).codes


def require_tone(tone: str) -> None:
    """Raise InputError before rendering if a tone does not exist, such as a missing OpenColorIO view."""
    if check_tone(tone) not in CURVES:
        find_view(tone)


def develop(image: ArrayLike, *, tone: str = DEFAULT_TONE, exposure: Exposure = None) -> Developed:
    """Develop linear radiance for a display; see `develop_image`."""
    tone, exposure = check_tone(tone), check_exposure(exposure)
    refuse_codes(image, "an image")
    with np.errstate(over="ignore"):
        pixels = np.ascontiguousarray(image, np.float32)
    if pixels.ndim != 3 or pixels.shape[2] != 3 or pixels.size == 0:
        raise InputError(f"an image must be (H, W, 3), not {pixels.shape}")
    chosen = stops(pixels, exposure, brighten=False)
    # 2.0**100 is finite in float32, so only the product can overflow.
    gain = np.float32(2.0**chosen)
    with np.errstate(over="ignore", invalid="ignore"):
        bright = (pixels > 1.0 / gain).any(axis=2)
    brightest = peak(pixels)
    if tone in CURVES:
        curve = CURVES[tone]
        highest = brightest * float(gain)

        def encoded(rows: slice) -> NDArray[Any]:
            return srgb_from_linear(curve(_usable(pixels[rows], gain), highest))

    else:
        on_display = encode(_usable(pixels, gain).astype(np.float32), find_view(tone))

        def encoded(rows: slice) -> NDArray[Any]:
            return on_display[rows].astype(np.float64)

    codes, white = quantize(pixels.shape[:2], encoded, _WHITE)
    return Developed(codes, chosen, tone, float((white & bright).mean()), brightest == 0.0)


def _usable(pixels: NDArray[np.float32], gain: np.float32) -> NDArray[np.float64]:
    """Return exposed pixels, finite and not negative."""
    exposed = np.nan_to_num(pixels.astype(np.float64) * float(gain), nan=0.0, posinf=FLOAT32_MAX, neginf=0.0)
    return exposed.clip(0.0, FLOAT32_MAX)
