"""Motions as the device has them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from wrt.motion import Motion


def motion_records(motions: Sequence[Motion]) -> tuple[Any, Any]:
    """Return the keys of all motions and the motions' records, as NumPy arrays of `kernels/motion.py`'s structs."""
    from wrt.kernels.motion import MotionKey, MotionRecord

    records = np.zeros(len(motions), MotionRecord.numpy_dtype())
    counts = np.array([len(motion.times) for motion in motions], np.int64)
    keys = np.zeros(int(counts.sum()), MotionKey.numpy_dtype())
    records["first_key"] = np.cumsum(counts) - counts
    records["keys"] = counts
    for record, motion in zip(records, motions, strict=True):
        own = keys[record["first_key"] :][: record["keys"]]
        own["time"], own["half_angle"] = motion.times, motion.half_angles
        own["rotation"], own["stretch"], own["position"] = (
            motion.parts.rotations,
            motion.parts.stretches,
            motion.parts.positions,
        )
        record["center"] = motion.center
    return keys, records
