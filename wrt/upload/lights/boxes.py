"""Build the tree of boxes around the lights that rays can hit and that have no mesh."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrt.backend import current_backend
from wrt.upload.arrays import packed

Array = NDArray[np.float64]

_PADDING = 2.0**-18
"""Boxes are larger by this share of their greatest coordinate: more than rounding moves a hit."""

_EVERYWHERE = 1e30
"""Half the side of the box around a light without bounds, metres."""


def light_boxes(hulls: Sequence[ArrayLike | None]) -> NDArray[Any]:
    """Return the LightBoxes around lights in depth-first order (`kernels/native/light_boxes.h`).

    Each subtree has up to four parts, split at medians. There is no box around all.

    Args:
        hulls: for each light, in the order of its shape, (K, 3) points whose hull contains it, or None.
    """
    everywhere = [[-_EVERYWHERE] * 3, [_EVERYWHERE] * 3]
    points = [np.asarray(everywhere if hull is None else hull, np.float64) for hull in hulls]
    low = np.array([p.min(axis=0) for p in points]).reshape(-1, 3)
    high = np.array([p.max(axis=0) for p in points]).reshape(-1, 3)
    slack = _PADDING * np.maximum(np.abs(low), np.abs(high)).max(axis=1, keepdims=True)
    low, high = low - slack, high + slack
    rows: list[dict[str, Any]] = []

    def add(lights: NDArray[np.int64]) -> None:
        least, most = low[lights].min(axis=0), high[lights].max(axis=0)
        middle = (0.5 * least + 0.5 * most).astype(np.float32)
        half = np.maximum(most - middle, middle - least) * (1.0 + 2.0**-22)
        row = {"middle": middle, "half": half, "shape": lights[0] if len(lights) == 1 else -1}
        rows.append(row)
        if len(lights) > 1:
            for part in parts(lights):
                add(part)
        row["behind"] = len(rows)

    def parts(lights: NDArray[np.int64]) -> Iterator[NDArray[np.int64]]:
        for half in halves(lights):
            yield from halves(half)

    def halves(lights: NDArray[np.int64]) -> list[NDArray[np.int64]]:
        if len(lights) < 2:
            return [lights]
        middles = low[lights] + high[lights]
        order = np.argsort(middles[:, np.ptp(middles, axis=0).argmax()], kind="stable")
        return np.array_split(lights[order], 2)

    if len(hulls):
        for part in parts(np.arange(len(hulls))):
            add(part)
    return packed(rows, current_backend().kernels("wrt.kernels.core.scene_data").LightBox)
