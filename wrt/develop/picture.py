"""Develop radiance to 8 bits: exposure, tone curve, dither."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrt.develop.exposure import peak, stops
from wrt.develop.ocio import encode, find_view
from wrt.develop.tones import CURVES
from wrt.errors import InputError
from wrt.scene.developing import DEFAULT_TONE, Exposure, check_exposure, check_tone
from wrt.scene.srgb import of_codes, srgb_from_linear
from wrt.slices import Threads, available_threads
from wrt.values import FLOAT32_MAX, array, refuse_codes

NOTICEABLE = 0.05
"""Share of pixels that may clip to white before a warning: lamps, windows and their reflections are supposed to, and
take up to a twentieth of a picture of a room."""

_WHITE = 254.5 / 255.0  # smallest value that counts as white
_ROWS_AT_ONCE = 16  # rows that are converted in one step: few enough to stay in a core's cache


@dataclass(frozen=True)
class Developed:
    """A picture for a display.

    Attributes:
        codes: (H, W, 3) uint8, or (H, W, 4) with alpha; sRGB or in the encoding of the OpenColorIO display.
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
    """Return linear radiance as 8-bit sRGB codes.

    Args:
        image: linear Rec. 709 radiance, row 0 at the top: (H, W, 3); with associated alpha, (H, W, 4); of one
            channel or a mask, (H, W); or a stack, (N, H, W, C). NaN becomes black.
        tone: name of the tone curve: "soft", "none", "neutral", "agx", "aces", "ocio" or
            "ocio:CONFIG,DISPLAY,VIEW" (see docs/tone.md).
        exposure: stops (factors of two) by which the picture is brightened first, or "auto". By default 0, unless the
            picture would be mostly white; `Renderer.save` brightens dark renders too.

    Returns:
        (H, W, 3) uint8, dithered: row 0 at the top; with alpha (H, W, 4), not associated; (N, H, W, C) of a stack.

    Raises:
        InputError: if an argument cannot be used.
    """
    if (stack := np.asarray(image)).ndim == 4:
        return np.stack([develop_image(each, tone=tone, exposure=exposure) for each in stack])
    return develop(image, tone=tone, exposure=exposure).codes


class Composed(np.ndarray[Any, np.dtype[np.float32]]):
    """(H, W, 3) or (H, W, 4) float32 radiance with a background or lines, which `develop` shows exactly.

    Tone curves compress highlights, so they would make a white background grey. An array that is computed from this
    one, or has been written to, is developed as a whole.
    """

    _parts: dict[str, Any] | None

    @classmethod
    def of(
        cls,
        image: NDArray[np.float32],
        *,
        alpha: NDArray[np.float32] | None = None,
        background: ArrayLike | None = None,
        lines: NDArray[np.float32] | None = None,
        line_color: ArrayLike = (0.0, 0.0, 0.0),
    ) -> Composed:
        """Return (H, W, 3) colours with what `develop` describes; alpha stays where there is no background."""
        made: NDArray[Any] = image
        if lines is not None:
            share = share_of_lines(lines, alpha)[..., None]
            drawn = share if alpha is None else share * alpha[..., None]
            made = made * (1.0 - share) + drawn * np.asarray(line_color, np.float32)
        if alpha is not None and background is not None:
            made = made + (1.0 - alpha[..., None]) * np.asarray(background, np.float32)
        elif alpha is not None:
            made = np.dstack([made, alpha])
        picture = np.asarray(made, np.float32).view(cls)
        kept = {"alpha": alpha, "background": background, "lines": lines, "line_color": line_color}
        picture._parts = {"image": image, **kept}
        return picture

    def __array_finalize__(self, source: object) -> None:
        """Begin as a picture without parts."""
        self._parts = None

    def parts(self) -> dict[str, Any] | None:
        """Return the arguments of `of`; None if this is another picture by now."""
        return self._parts if self._parts and np.array_equal(self, Composed.of(**self._parts), True) else None


def colors_and_alpha(image: ArrayLike | None, name: str) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """Return the (H, W, 3) colours and the (H, W) alpha, if there is any, of an image as `develop_image` takes it.

    Raises:
        InputError: if it is of another shape, holds codes, or has no finite value; the message names it by `name`.
    """
    refuse_codes(image, name)
    with np.errstate(over="ignore"):
        pixels = array(image, name, np.float32)
    if pixels.ndim == 2:
        pixels = pixels[:, :, None]
    if pixels.ndim != 3 or pixels.shape[2] not in (1, 3, 4) or pixels.size == 0:
        raise InputError(f"{name} must be (H, W, 3), (H, W, 4) with alpha, or (H, W), not {np.asarray(image).shape}")
    if not np.isfinite(pixels).any():
        raise InputError(f"{name} has no finite value in it")
    colors = np.repeat(pixels, 3, axis=2) if pixels.shape[2] == 1 else pixels[:, :, :3]
    return np.ascontiguousarray(colors), pixels[:, :, 3] if pixels.shape[2] == 4 else None


def unassociated(colors: NDArray[np.float32], alpha: NDArray[np.float32] | None) -> NDArray[np.float32]:
    """Return colours without the factor alpha; black where nothing is visible."""
    if alpha is None:
        return colors
    share = alpha[:, :, None]
    return np.divide(colors, share, out=np.zeros_like(colors), where=share > 0.0)


def covered(colors: NDArray[np.float32], alpha: NDArray[np.float32] | None) -> NDArray[np.float32]:
    """Return the colours that decide the exposure, without the factor alpha: those of pixels that show something."""
    if alpha is None or not (alpha > 0.0).any():
        return colors
    return colors[alpha > 0.0][None] / alpha[alpha > 0.0, None]


def with_alpha(codes: NDArray[np.uint8], alpha: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return (H, W, 4) codes: a picture's, and of its alpha."""
    return np.dstack([codes, np.rint(255.0 * np.clip(np.nan_to_num(alpha), 0.0, 1.0)).astype(np.uint8)])


def over(codes: NDArray[np.uint8], alpha: NDArray[np.float32], background: ArrayLike) -> NDArray[np.uint8]:
    """Return sRGB codes blended with a linear colour behind them, in linear light."""
    share = np.clip(np.nan_to_num(alpha), 0.0, 1.0)[:, :, None]
    linear = share * of_codes(linear=False)[codes] + (1.0 - share) * np.asarray(background, np.float32)
    return np.rint(255.0 * srgb_from_linear(linear)).astype(np.uint8)


def share_of_lines(lines: NDArray[np.float32], alpha: NDArray[np.float32] | None) -> NDArray[np.float32]:
    """Return (H, W), the share of what is seen in a pixel that lines cover, which lie on surfaces."""
    if alpha is None:
        return np.clip(np.nan_to_num(lines), 0.0, 1.0)
    return np.divide(lines, alpha, out=np.zeros_like(lines), where=alpha > 0.0).clip(0.0, 1.0)


def require_tone(tone: str) -> None:
    """Raise InputError before rendering if a tone does not exist, such as a missing OpenColorIO view."""
    if check_tone(tone) not in CURVES:
        find_view(tone)


def develop(
    image: ArrayLike,
    *,
    tone: str = DEFAULT_TONE,
    exposure: Exposure = None,
    alpha: NDArray[np.float32] | None = None,
    background: ArrayLike | None = None,
    lines: NDArray[np.float32] | None = None,
    line_color: ArrayLike = (0.0, 0.0, 0.0),
) -> Developed:
    """Develop linear radiance for a display; see `develop_image`.

    Args:
        image: as for `develop_image`, no stack.
        tone: as for `develop_image`.
        exposure: as for `develop_image`.
        alpha: (H, W) coverage, if `image` does not have it.
        background: linear colour behind what has alpha.
        lines: (H, W) share of each pixel that lines cover.
        line_color: linear colour of these.
    """
    tone, exposure = check_tone(tone), check_exposure(exposure)
    if alpha is None and isinstance(image, Composed) and (parts := image.parts()):
        image, alpha, background, lines, line_color = parts.values()
    pixels, coverage = colors_and_alpha(image, "an image")
    alpha = coverage if alpha is None else alpha
    chosen = stops(covered(pixels, alpha), exposure, brighten=False)
    developed = _develop(unassociated(pixels, alpha), tone, chosen)
    codes, is_black = developed.codes, developed.black and lines is None
    if lines is not None:
        codes = over(codes, 1.0 - share_of_lines(lines, alpha), line_color)
    if alpha is not None:
        codes = with_alpha(codes, alpha) if background is None else over(codes, alpha, background)
    return dataclasses.replace(developed, codes=codes, black=is_black)


def _develop(pixels: NDArray[np.float32], tone: str, chosen: float) -> Developed:
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

    codes, white = _quantized(pixels.shape[:2], encoded)
    return Developed(codes, chosen, tone, float((white & bright).mean()), brightest == 0.0)


def _usable(pixels: NDArray[np.float32], gain: np.float32) -> NDArray[np.float64]:
    """Return exposed pixels, finite and not negative."""
    exposed = np.nan_to_num(pixels.astype(np.float64) * float(gain), nan=0.0, posinf=FLOAT32_MAX, neginf=0.0)
    return exposed.clip(0.0, FLOAT32_MAX)


def _quantized(
    size: tuple[int, ...], encoded: Callable[[slice], NDArray[Any]]
) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """Return the (H, W, 3) 8-bit codes of a picture, and (H, W) whether a channel of a pixel is white.

    Dithering avoids bands in dark gradients: the code is floor(255 v + u), where u in (0, 1) is a fixed hash of
    column, row and channel. A value that equals a code, such as 0 or 1, is not dithered. `encoded` returns
    (rows, W, 3) float64 values of some rows, encoded for a display, 0 to 1.
    """
    height, width = size
    codes = np.empty((height, width, 3), np.uint8)
    whites = np.empty((height, width), np.bool_)
    x = np.arange(width, dtype=np.uint32)[:, None]
    c = np.arange(3, dtype=np.uint32)
    columns = _hash(x ^ _hash(c + np.uint32(0x9E3779B9)))

    def fill(rows: slice) -> None:
        values = encoded(rows)
        noise = _hash(columns + _hash(np.arange(height, dtype=np.uint32)[rows, None, None]))
        # 256 levels from 1/512 to 511/512, so that rounding errors cannot change a value that equals a code.
        u = ((noise >> np.uint32(24)).astype(np.float64) + 0.5) / 256.0
        codes[rows] = np.floor(255.0 * values + u).clip(0.0, 255.0).astype(np.uint8)
        whites[rows] = (values >= _WHITE).any(axis=2)

    # A few rows at a time: a whole picture in float64 would take several times its memory.
    pool = Threads(available_threads(), "wrt-dither")
    try:
        for each in [pool.submit(fill, slice(y, y + _ROWS_AT_ONCE)) for y in range(0, height, _ROWS_AT_ONCE)]:
            each.result()
    finally:
        pool.end()
    return codes, whites


def _hash(x: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Mix 32 bits (Wellons 2018, the "lowbias32" function)."""
    x = x ^ (x >> np.uint32(16))
    with np.errstate(over="ignore"):
        x = x * np.uint32(0x7FEB352D)
        x = x ^ (x >> np.uint32(15))
        x = x * np.uint32(0x846CA68B)
    return x ^ (x >> np.uint32(16))
