"""Sums whose last digits do not depend on the processor."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray


def weighted_sum(colors: NDArray[Any], weights: Sequence[float] | NDArray[np.float64]) -> NDArray[Any]:
    """Return the sums of channels (..., n) times n weights, such as luminance, in the type of the colors.

    A product of matrices has other last digits on other processors, since libraries of linear algebra choose their code
    by the processor. These sums are the same on all.
    """
    kind = colors.dtype.type
    total = colors[..., 0] * kind(weights[0])
    for channel in range(1, len(weights)):
        total = total + colors[..., channel] * kind(weights[channel])
    return np.asarray(total)
