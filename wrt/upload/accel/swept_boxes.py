"""Bound moving instances by one box for each time slice of the exposure."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wrt.linalg import singular_values
from wrt.scene.motion import FloatArray, Motion, segments
from wrt.upload.accel.instances import world_boxes

STEPS_PER_SLICE = 4
"""Steps of a slice, each with a box; the excess size falls with the square of their number."""

_ROUNDINGS = 64.0
"""Most roundings of the largest number when a device interpolates a transform."""


def swept_boxes(
    motion: Motion, times: FloatArray, boxes: FloatArray, radius: float, shutter: tuple[float, float], slices: int
) -> NDArray[np.float32]:
    """Return (S, 2, 3) boxes that bound a moving mesh throughout each of S equal time slices.

    No key lies within a step from t0 to t1, so a point x of the mesh is at p = q + R y with y = S (x − c), where q and
    S are linear in time, and R rotates about one axis at the rate w. Since (R y)'' = R'' y + 2 R' y', it deviates from
    the straight line between p(t0) and p(t1) in each coordinate by at most (t1 − t0)² / 8 · (w² |y| + 2 w |y'|), the
    error of linear interpolation. The boxes at both times, padded by that much, bound the path of every point of the
    mesh's own box. If that box changes, linearly between `times`, the union of both ends of the step bounds it.

    The mesh also lies in a sphere around the centre of its box. The path of the centre is bounded in the same way, and
    the largest singular value of S, a convex function of time, bounds the growth of the sphere. This makes the boxes of
    round meshes that rotate tight.

    Args:
        motion: the motion of mesh space.
        times: (K,) times of `boxes`.
        boxes: (K, 2, 3) boxes in mesh space.
        radius: radius of a sphere around the centre of each box that also bounds the mesh.
        shutter: first and last time.
        slices: number of slices S.
    """
    begin, end = shutter
    edges = np.linspace(begin, end, slices + 1)
    # Rounding to float32 may move a time across an edge by this much.
    late = 4.0 * np.finfo(np.float32).eps * max(abs(begin), abs(end))
    grid = np.linspace(begin, end, slices * STEPS_PER_SLICE + 1)
    keys = np.concatenate([motion.times, times])
    grid = np.unique(np.concatenate([grid, edges - late, edges + late, keys[(keys > begin) & (keys < end)]]))
    matrices = motion.at(grid)
    rate, growth = _rates(motion, grid)
    first, share = segments(times, grid)
    f = share[:, None, None]
    box = (1.0 - f) * boxes[first] + f * boxes[np.minimum(first + 1, len(times) - 1)]

    def path_bounds(box: FloatArray) -> FloatArray:
        """Return (steps, 2, 3) bounds of the path of a box, given at the times of the grid."""
        box = np.stack([np.minimum(box[:-1, 0], box[1:, 0]), np.maximum(box[:-1, 1], box[1:, 1])], axis=1)
        picks = np.array([[i >> 0 & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)])
        corners = box[:, picks, np.arange(3)] - np.array(motion.center)  # (steps, 8, 3)
        sizes = [
            np.linalg.norm(np.einsum("kij,knj->kni", m, corners), axis=2).max(axis=1)
            for m in (matrices[:-1, :3, :3], matrices[1:, :3, :3], growth)
        ]
        step = np.diff(grid)
        margin = step * step / 8.0 * (rate * rate * np.maximum(sizes[0], sizes[1]) + 2.0 * rate * sizes[2])
        ends = [world_boxes(box, m, _ROUNDINGS).astype(np.float64) for m in (matrices[:-1], matrices[1:])]
        low, high = np.minimum(ends[0][:, 0], ends[1][:, 0]), np.maximum(ends[0][:, 1], ends[1][:, 1])
        return np.stack([low - margin[:, None], high + margin[:, None]], axis=1)

    around_box, around_center = path_bounds(box), path_bounds(np.repeat(box.mean(axis=1, keepdims=True), 2, axis=1))
    stretch = singular_values(matrices[:, :3, :3])[:, 0]
    reach = (1.0 + 1e-5) * radius * np.maximum(stretch[:-1], stretch[1:])[:, None]
    low = np.maximum(around_box[:, 0], around_center[:, 0] - reach)
    high = np.minimum(around_box[:, 1], around_center[:, 1] + reach)
    result = np.empty((slices, 2, 3))
    for k in range(slices):
        a, b = np.searchsorted(grid, (edges[k] - late, edges[k + 1] + late))
        result[k] = low[a:b].min(axis=0), high[a:b].max(axis=0)
    return np.nextafter(result.astype(np.float32), np.array([[-np.inf], [np.inf]], np.float32))


def _rates(motion: Motion, grid: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the angular velocity in radians per second, and S', between times that include the keys of a motion."""
    segment, _ = segments(motion.times, 0.5 * (grid[:-1] + grid[1:]))
    length = np.diff(motion.times, append=motion.times[-1] + 1.0)[segment]
    moves = (grid[1:] > motion.times[0]) & (grid[:-1] < motion.times[-1])
    rate = np.where(moves, 2.0 * motion.half_angles[segment] / length, 0.0)
    stretches = motion.parts.stretches
    next_segment = np.minimum(segment + 1, len(motion.times) - 1)
    return rate, (stretches[next_segment] - stretches[segment]) / length[:, None, None]
