"""Convert motions to the kernels' structs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from wrt.backend import current_backend
from wrt.scene.motion import Motion


def motion_records(motions: Sequence[Motion]) -> tuple[Any, Any]:
    """Return the keys and the records of motions, as NumPy arrays of the kernels' structs."""
    structs = current_backend().kernels("wrt.kernels.core.motion")
    records = np.zeros(len(motions), structs.MotionRecord.numpy_dtype())
    counts = np.array([len(motion.times) for motion in motions], np.int64)
    keys = np.zeros(int(counts.sum()), structs.MotionKey.numpy_dtype())
    records["first_key"] = np.cumsum(counts) - counts
    records["keys"] = counts
    for record, motion in zip(records, motions, strict=True):
        own = keys[record["first_key"] :][: record["keys"]]
        own["time"], own["half_angle"] = motion.times, motion.half_angles
        parts = motion.parts
        own["rotation"], own["stretch"], own["position"] = parts.rotations, parts.stretches, parts.positions
        record["center"] = motion.center
    return keys, records
