"""Alias tables: draw an index in proportion to its weight in constant time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray


class AliasTable(NamedTuple):
    """Slot i keeps index i with probability thresholds[i] and gives aliases[i] otherwise.

    Attributes:
        thresholds: (N,) float32.
        aliases: (N,) int32.
        probabilities: (N,) float64 of each index, summing to 1.
    """

    thresholds: NDArray[np.float32]
    aliases: NDArray[np.int32]
    probabilities: NDArray[np.float64]


def make_alias_table(weights: ArrayLike) -> AliasTable:
    """Return the table for non-negative weights with a positive sum.

    This is the sweep of Hübschle-Schneider and Sanders (2019), with prefix sums in place of its sequential state:
    heavy slots, in order, fill up light slots until they become light and are filled by the next heavy one.
    """
    w = np.asarray(weights, dtype=np.float64)
    probabilities = w / w.sum()
    scaled = probabilities * len(w)
    thresholds = np.minimum(scaled, 1.0)
    aliases = np.arange(len(w), dtype=np.int32)
    light = np.flatnonzero(scaled < 1.0)
    heavy = np.flatnonzero(scaled >= 1.0)
    if len(light) and len(heavy):
        missing = np.cumsum(1.0 - scaled[light])
        spare = np.cumsum(scaled[heavy] - 1.0)
        before = np.concatenate([[0.0], missing[:-1]])
        donor = np.minimum(np.searchsorted(spare, before, side="right"), len(heavy) - 1)
        aliases[light] = heavy[donor]
        # A heavy slot is exhausted when the light ones have taken more than all heavy ones so far can spare.
        given = np.concatenate([[0.0], missing])
        last = np.searchsorted(given, spare, side="left")
        kept = 1.0 + spare - given[np.minimum(last, len(light))]
        exhausted = (last <= len(light)) & (np.arange(len(heavy)) < len(heavy) - 1)
        thresholds[heavy] = np.where(exhausted, np.clip(kept, 0.0, 1.0), 1.0)
        aliases[heavy[:-1]] = heavy[1:]
    return AliasTable(thresholds.astype(np.float32), aliases, probabilities)
