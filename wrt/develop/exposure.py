"""Exposure: how many stops brighten a picture so that it shows well."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.linalg import weighted_sum
from wrt.scene.developing import AUTO, LIMIT, Exposure

BRIGHT, BRIGHT_PERCENTILE = 0.7, 90.0
"""A tenth of a well exposed picture is brighter than this share of white: lamps, windows, sun and gloss."""

LEAST_MEAN = 0.05
"""Lower bound on the geometric mean of a picture, for rooms whose windows fill more than a tenth of it."""

_BLOCK = 4  # side of the blocks of pixels that are averaged first, so that noise and fireflies count little

_BACKGROUND, _SUBJECT_PERCENTILE = 1e-4, 97.0
"""Blocks darker than the first, relative to this percentile, are background. Lamps usually exceed the percentile."""

_TOO_BRIGHT = 0.15, 0.35
"""By default a picture is exposed at 0 stops if less than the first share of it would be white, not counting a black
background, and automatically above the second share; in between the two are blended. Lamps and windows alone change
nothing."""

_TOO_DARK = 1.5, 2.5  # the same limits for dark pictures, in stops of automatic exposure
_WHITE_STOPS = 0.5  # a block counts as white at this many stops above 1, and partly between 1 and there
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def stops(image: NDArray[Any], exposure: Exposure = None, *, brighten: bool = True) -> float:
    """Return the exposure of a picture in stops (factors of two).

    - A number is returned unchanged.
    - "auto" makes a tenth of the picture brighter than 0.7 of white, or more if its geometric mean were below 0.05. The
      picture is measured in blocks of 4x4 pixels; black or nearly black blocks count as background and are ignored.
    - None means 0 for every picture that shows well at 0 stops, so that radiance keeps its meaning: a surface of
      radiance 0.5 has the sRGB code of 0.5. A picture is exposed automatically if a third of it would be white, not
      counting a black background, or if it needs more than 2.5 stops; the exposure blends in continuously from a sixth,
      or from 1.5 stops.

    The result depends on the picture alone.

    Args:
        image: (H, W, 3) linear radiance.
        exposure: stops, "auto" or None.
        brighten: whether None may brighten dark pictures: right for renders, wrong for textures and other data.
    """
    if exposure is not None and not isinstance(exposure, str):
        return float(exposure)
    luminance = _without_background(_in_blocks(image))
    automatic = _automatic(luminance)
    if exposure == AUTO:
        return automatic
    if automatic < 0.0:
        white = np.minimum(np.log2(np.maximum(luminance, 1.0)) / _WHITE_STOPS, 1.0)
        (begin, end), measured = _TOO_BRIGHT, float(white.mean())
    elif not brighten:
        return 0.0
    else:
        (begin, end), measured = _TOO_DARK, automatic
    share = min(max((measured - begin) / (end - begin), 0.0), 1.0)
    return share * automatic if share else 0.0


def peak(image: NDArray[Any]) -> float:
    """Return the radiance of the brightest parts of a picture: all but a thousandth of its pixels are darker."""
    largest = np.nan_to_num(image.max(axis=-1), nan=0.0, posinf=np.inf, neginf=0.0)
    return float(np.partition(largest, rank := int(0.999 * (largest.size - 1)), axis=None)[rank])


def _automatic(luminance: NDArray[Any]) -> float:
    if luminance.size == 0:
        return 0.0
    bright = math.log2(BRIGHT / float(np.percentile(luminance, BRIGHT_PERCENTILE)))
    mean = math.log2(LEAST_MEAN) - float(np.log2(luminance).mean())
    return min(max(bright, mean, -LIMIT), LIMIT)


def _without_background(luminance: NDArray[Any]) -> NDArray[Any]:
    """Return the blocks that are finite and not black, or nearly black compared with the others."""
    lit: NDArray[Any] = luminance[np.isfinite(luminance) & (luminance > 0.0)]
    if lit.size:
        lit = lit[lit > _BACKGROUND * np.percentile(lit, _SUBJECT_PERCENTILE)]
    return lit


def _in_blocks(image: NDArray[Any]) -> NDArray[Any]:
    """Return the mean luminance of each whole block, or of each pixel in small pictures."""
    side = _BLOCK if min(image.shape[:2]) >= 8 * _BLOCK else 1
    height, width = (size // side * side for size in image.shape[:2])
    with np.errstate(invalid="ignore", over="ignore"):
        luminance = weighted_sum(image[:height, :width], _LUMINANCE)
        blocks = luminance.reshape(height // side, side, width // side, side)
        return np.asarray(blocks.mean(axis=(1, 3), dtype=np.float64).reshape(-1))
