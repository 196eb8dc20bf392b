"""Tables of the reconstruction filters that `kernels/camera/samples.py` samples."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

TABLE_SIZE = 1024
"""Intervals in a table; the largest step of the Blackman-Harris table is then 0.033 pixels."""


def _blackman_harris(x: NDArray[np.float64]) -> NDArray[np.float64]:
    # Harris (1978), the 4-term window of minimum side lobes, over a width of 3 pixels.
    t = 2.0 * np.pi * (x / 3.0 + 0.5)
    return 0.35875 - 0.48829 * np.cos(t) + 0.14128 * np.cos(2.0 * t) - 0.01168 * np.cos(3.0 * t)


# Name -> (half width in pixels, profile along one axis); a filter is the product over both axes.
_PROFILES: dict[str, tuple[float, Callable[[NDArray[np.float64]], NDArray[np.float64]]]] = {
    "box": (0.5, np.ones_like),
    "tent": (1.0, lambda x: 1.0 - np.abs(x)),
    "gaussian": (2.0, lambda x: np.exp(-0.5 * (x / 0.5) ** 2) - np.exp(-8.0)),
    "blackman-harris": (1.5, _blackman_harris),
}


@functools.cache
def filter_table(name: str) -> NDArray[np.float32]:
    """Return (TABLE_SIZE + 1,) float32 offsets in pixels: the inverse cumulative distribution. Do not change it."""
    half_width, profile = _PROFILES[name]
    place = np.linspace(0.0, 1.0, TABLE_SIZE + 1)
    at = np.where(place < 0.5, 2.0 * place**2, 1.0 - 2.0 * (1.0 - place) ** 2)
    if name == "box":
        return np.asarray(half_width * (2.0 * at - 1.0), np.float32)
    x = np.linspace(-half_width, half_width, 64 * TABLE_SIZE + 1)
    density = profile(x)
    cumulative = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
    cumulative /= cumulative[-1]
    table: NDArray[np.float32] = np.interp(at, cumulative, x).astype(np.float32)
    return table
