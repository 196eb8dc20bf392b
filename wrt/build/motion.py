"""Motions as the device has them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.build.instances import world_boxes
from wrt.motion import FloatArray, Motion, segments


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


STEPS_PER_SLICE = 4
"""Pieces of a slice, whose boxes are found one by one: what they are too large by falls with the square."""

_ROUNDINGS = 64.0
"""Times that a device rounds the largest number on the way from keys to a place, at most."""


def swept_boxes(
    motion: Motion, times: FloatArray, boxes: FloatArray, radius: float, shutter: tuple[float, float], slices: int
) -> NDArray[np.float32]:
    """Return (S, 2, 3) boxes, one for each of equal slices of the time, that hold a moving thing throughout the slice.

    Within a step between two times t0 and t1 no key lies, so a point x of the thing is at
    p = q + R y with y = S (x − c), where q and S are linear in the time, and R turns about one axis at the rate w.
    As (R y)'' = R'' y + 2 R' y', it deviates from the straight line between p(t0) and p(t1) in each coordinate by
    at most (t1 − t0)² / 8 · (w² |y| + 2 w |y'|), the error of linear interpolation. So the boxes at both times,
    widened by that much, hold the way of every point of the thing's own box. If that box changes, linearly between
    `times`, the one around it at both ends of the step holds all points meanwhile.

    The thing also lies in a ball around the box's centre. The way of that is held likewise, and the ball is stretched
    at most by the largest singular value of S, which is a convex function of the time. So boxes of round things that
    turn are tight.

    Args:
        motion: of the thing's own space.
        times: (K,) when its own box is one of `boxes`.
        boxes: (K, 2, 3).
        radius: of a ball around each of those boxes' centres that holds the thing as well.
        shutter: first and last time.
        slices: how many, S.
    """
    begin, end = shutter
    edges = np.linspace(begin, end, slices + 1)
    # By how much a time in float32 may be on the wrong side of an edge.
    late = 4.0 * np.finfo(np.float32).eps * max(abs(begin), abs(end))
    grid = np.linspace(begin, end, slices * STEPS_PER_SLICE + 1)
    keys = np.concatenate([motion.times, times])
    grid = np.unique(np.concatenate([grid, edges - late, edges + late, keys[(keys > begin) & (keys < end)]]))
    matrices = motion.at(grid)
    rate, growth = _rates(motion, grid)
    first, share = segments(times, grid)
    f = share[:, None, None]
    own = (1.0 - f) * boxes[first] + f * boxes[np.minimum(first + 1, len(times) - 1)]

    def held(own: FloatArray) -> FloatArray:
        """Return (steps, 2, 3) what holds the way of a box that changes between the times of the grid."""
        own = np.stack([np.minimum(own[:-1, 0], own[1:, 0]), np.maximum(own[:-1, 1], own[1:, 1])], axis=1)
        picks = np.array([[i >> 0 & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)])
        corners = own[:, picks, np.arange(3)] - np.array(motion.center)  # (steps, 8, 3)
        sizes = [
            np.linalg.norm(np.einsum("kij,knj->kni", m, corners), axis=2).max(axis=1)
            for m in (matrices[:-1, :3, :3], matrices[1:, :3, :3], growth)
        ]
        step = np.diff(grid)
        off = step * step / 8.0 * (rate * rate * np.maximum(sizes[0], sizes[1]) + 2.0 * rate * sizes[2])
        ends = [world_boxes(own, m, _ROUNDINGS).astype(np.float64) for m in (matrices[:-1], matrices[1:])]
        low, high = np.minimum(ends[0][:, 0], ends[1][:, 0]), np.maximum(ends[0][:, 1], ends[1][:, 1])
        return np.stack([low - off[:, None], high + off[:, None]], axis=1)

    around_box, around_center = held(own), held(np.repeat(own.mean(axis=1, keepdims=True), 2, axis=1))
    stretch = np.linalg.norm(matrices[:, :3, :3], 2, axis=(1, 2))
    reach = (1.0 + 1e-5) * radius * np.maximum(stretch[:-1], stretch[1:])[:, None]
    low = np.maximum(around_box[:, 0], around_center[:, 0] - reach)
    high = np.minimum(around_box[:, 1], around_center[:, 1] + reach)
    result = np.empty((slices, 2, 3))
    for k in range(slices):
        a, b = np.searchsorted(grid, (edges[k] - late, edges[k + 1] + late))
        result[k] = low[a:b].min(axis=0), high[a:b].max(axis=0)
    return np.stack(
        [
            np.nextafter(result[:, 0].astype(np.float32), np.float32(-np.inf)),
            np.nextafter(result[:, 1].astype(np.float32), np.float32(np.inf)),
        ],
        axis=1,
    )


def _rates(motion: Motion, grid: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how fast a motion turns, radians a second, and stretches, S', between times among which are its keys."""
    segment, _ = segments(motion.times, 0.5 * (grid[:-1] + grid[1:]))
    length = np.diff(motion.times, append=motion.times[-1] + 1.0)[segment]
    moves = (grid[1:] > motion.times[0]) & (grid[:-1] < motion.times[-1])
    rate = np.where(moves, 2.0 * motion.half_angles[segment] / length, 0.0)
    stretches = motion.parts.stretches
    next_segment = np.minimum(segment + 1, len(motion.times) - 1)
    return rate, (stretches[next_segment] - stretches[segment]) / length[:, None, None]
