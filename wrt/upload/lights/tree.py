"""Build the light tree, which groups finite lights by position and direction.

A binary tree is split level by level, all open nodes at once, with a binned cost (Conty Estevez and Kulla, "Importance
Sampling of Many Lights with Adaptive Tree Splitting", 2018). It is then collapsed to nodes of eight children, which
`kernels/lights/choice.py` evaluates together.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wrt.upload.lights.bounds import LightBounds

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

WIDTH = 8
ROWS = 16
"""Rows of eight numbers in a node: centre x y z, half the box's sides x y z, radius (negative if two-sided), axis
x y z, cosines of spread and falloff, sine of spread, extent from the centre along the axis, power, and the child: the
number of a node, or −1 minus the number of a light."""

_BINS = 16
_FEW_BINS = 8
_FEW_LIGHTS = 64
"""A level whose nodes have fewer lights than this on average uses _FEW_BINS, because it has many nodes."""

_ROUNDING = 2e-4
"""Error of cosines in the kernel, whose square roots may have 14 bits."""

_FLAT = 1e-3
"""Lights whose normals differ by less than this angle count as facing one way; the kernel allows for it."""


@dataclass(frozen=True)
class LightTree:
    """The tree as arrays; node 0 is the root.

    Attributes:
        nodes: (M, ROWS, WIDTH) float32; the last row is int32 in the same bits.
        parents: (M,) int32 position of each node in its parent: WIDTH times the parent's number plus the slot;
            −1 for the root.
        places: (N,) int32 position of each light, likewise; −1 for lights that are never selected.
        scale: irradiance, in the unit of the powers per square metre, of an importance of 1 among the root's children.
    """

    nodes: NDArray[np.float32]
    parents: NDArray[np.int32]
    places: NDArray[np.int32]
    scale: float


def build_light_tree(lights: LightBounds) -> LightTree:
    """Return the tree over finite lights; it has no nodes if all their powers are 0."""
    shining = np.flatnonzero((lights.power > 0.0) & ~lights.is_far)
    chosen = dataclasses.replace(lights, power=lights.facing_power).take(shining)
    if len(shining) == 0:
        return LightTree(
            np.zeros((0, ROWS, WIDTH), np.float32), np.zeros(0, np.int32), np.full(len(lights), -1, np.int32), 0.0
        )
    order, begin, end, left_child = _split(chosen)
    nodes, parents, places, most = _collapse(chosen.take(order), begin, end, left_child)
    result = np.full(len(lights), -1, np.int32)
    result[shining[order]] = places
    children = nodes[:, -1].view(np.int32)
    is_light = (children < 0) & (nodes[:, -2] > 0.0)
    children[is_light] = -1 - shining[order[-1 - children[is_light]]]
    return LightTree(nodes, parents, result, most / np.pi)


# --- The binary tree -------------------------------------------------------------------------------


def _split(lights: LightBounds) -> tuple[Indices, Indices, Indices, Indices]:
    """Return the lights in the tree's order, and the begin, end and left child (−1 for none) of each node.

    The right child follows the left. Nodes of up to WIDTH lights are not split and become nodes of the wide tree.
    """
    n = len(lights)
    order = np.arange(n)
    # Two-sided lights emit along both axes. Flip them to one side, whichever way they are wound.
    axis = np.where(lights.cos_spread[:, None] > -1.0, lights.axis, 0.0)
    leading = np.take_along_axis(axis, np.argmax(np.abs(axis), axis=1)[:, None], axis=1)
    axis = np.where(lights.two_sided[:, None] & (leading < 0.0), -axis, axis)
    scale = 1.0 / lights.power.max()
    power = lights.power * scale
    # A light's values in a column: rows of one value are faster to gather and to sum than rows of a light.
    columns = np.concatenate([lights.center.T, lights.half.T, axis.T * power, power[None]])
    begins, ends, lefts = [np.array([0])], [np.array([n])], []
    total = 1
    while True:
        begin, end = begins[-1], ends[-1]
        is_open = end - begin > WIDTH
        left_child = np.full(len(begin), -1)
        left_child[is_open] = total + 2 * np.arange(is_open.sum())
        lefts.append(left_child)
        if not is_open.any():
            break
        begin, end = begin[is_open], end[is_open]
        positions, starts, node = _ranges(begin, end)
        some = order[positions]
        to_right = _sides(columns.take(some, axis=1), starts, node, end - begin)
        # A stable partition of all nodes at once.
        lefts_before: Indices = np.cumsum(~to_right) - ~to_right
        lefts_before = lefts_before - lefts_before[starts][node]
        left_count = np.bincount(node, ~to_right).astype(np.int64)
        place = np.arange(len(node)) - starts[node]
        target = np.where(to_right, left_count[node] + place - lefts_before, lefts_before)
        order[begin[node] + target] = some
        middle = begin + left_count
        begins.append(np.stack([begin, middle], axis=1).ravel())
        ends.append(np.stack([middle, end], axis=1).ravel())
        total += 2 * len(begin)
    return order, np.concatenate(begins), np.concatenate(ends), np.concatenate(lefts)


def _ranges(begin: Indices, end: Indices) -> tuple[Indices, Indices, Indices]:
    """Concatenate ranges [begin, end); return the numbers, the start of each range, and the range of each number."""
    counts = end - begin
    starts = np.cumsum(counts) - counts
    run = np.repeat(np.arange(len(begin)), counts)
    return np.arange(len(run)) - starts[run] + begin[run], starts, run


def _sides(columns: Array, starts: Indices, node: Indices, counts: Indices) -> NDArray[np.bool_]:
    """Return whether each light of a node goes to the right of its best split."""
    centers = columns[:3]
    nodes = len(starts)
    bins = _BINS if len(node) > _FEW_LIGHTS * nodes else _FEW_BINS
    low = [np.minimum.reduceat(c, starts) for c in centers]
    extent = [np.maximum.reduceat(c, starts) - lo for c, lo in zip(centers, low, strict=True)]
    longest = np.maximum(np.maximum(extent[0], extent[1]), extent[2])
    best = np.full(nodes, np.inf)
    best_axis = np.full(nodes, -1)
    best_bin = np.zeros(nodes, np.int64)
    places = []
    for axis in range(3):
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            scale = np.where(extent[axis] > 0.0, bins / extent[axis], 0.0)
        scale[~np.isfinite(scale)] = 0.0
        place = np.minimum(((centers[axis] - low[axis][node]) * scale[node]).astype(np.int64), bins - 1)
        places.append(place)
        cost = _split_costs(columns, node * bins + place, nodes, bins)
        # Penalise thin slices (Conty Estevez and Kulla 2018, k_r).
        with np.errstate(divide="ignore", invalid="ignore"):
            cost *= np.where(extent[axis] > 0.0, longest / extent[axis], np.inf)[:, None]
        cost[np.isnan(cost)] = np.inf
        split = np.argmin(cost, axis=1)
        least = cost[np.arange(nodes), split]
        better = least < best
        best[better], best_axis[better], best_bin[better] = least[better], axis, split[better]
    # If all lights fall into one bin, split by order.
    to_right = np.arange(len(node)) - starts[node] >= counts[node] // 2
    for axis in range(3):
        of_axis = best_axis[node] == axis
        to_right[of_axis] = (places[axis] > best_bin[node])[of_axis]
    return to_right


def _split_costs(columns: Array, key: Indices, nodes: int, bins: int) -> Array:
    """Return (nodes, bins − 1) costs of splits after each bin, infinite if a side is empty.

    This is the surface area orientation heuristic: power times area times solid angle, summed over both sides. The
    area belongs to the sphere around the box, as in the importance. The solid angle belongs to the cone of normals with
    a hemisphere about each (Conty Estevez and Kulla 2018, M_Ω). For normals uniform in a cone it is π (4 − 3 R⁴) within
    7 %, where R is the length of their mean, which can be summed over bins, unlike cones.
    """
    size, (centers, halves, axes) = nodes * bins, np.split(columns[:9], 3)

    def summed(values: Array | None) -> Array:
        return np.bincount(key, values, size).reshape(nodes, bins).astype(np.float64)

    def of_sides(values: Array, accumulate: np.ufunc) -> tuple[Array, Array]:
        """Accumulate bins from the left and from the right."""
        from_right = accumulate.accumulate(values[:, ::-1], axis=1)[:, ::-1]
        return accumulate.accumulate(values, axis=1)[:, :-1], from_right[:, 1:]

    count = of_sides(summed(None), np.add)
    power = of_sides(summed(columns[9]), np.add)
    length2, diagonal2 = ([np.zeros((nodes, bins - 1)) for _ in range(2)] for _ in range(2))
    for center, half, axis in zip(centers, halves, axes, strict=True):
        axis_sums = of_sides(summed(axis), np.add)
        low, high = np.full(size, np.inf), np.full(size, -np.inf)
        np.minimum.at(low, key, center - half)
        np.maximum.at(high, key, center + half)
        lows = of_sides(low.reshape(nodes, bins), np.minimum)
        highs = of_sides(high.reshape(nodes, bins), np.maximum)
        for side in range(2):
            length2[side] += axis_sums[side] ** 2
            with np.errstate(invalid="ignore", over="ignore"):
                diagonal2[side] += (highs[side] - lows[side]) ** 2
    cost = np.zeros((nodes, bins - 1))
    for side in range(2):
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            solid_angle = 4.0 - 3.0 * np.minimum(length2[side] / power[side] ** 2, 1.0) ** 2
            cost += power[side] * diagonal2[side] * solid_angle
    cost[(count[0] == 0.0) | (count[1] == 0.0)] = np.inf
    return cost


# --- The wide tree ---------------------------------------------------------------------------------


def _collapse(
    lights: LightBounds, begin: Indices, end: Indices, left_child: Indices
) -> tuple[NDArray[np.float32], NDArray[np.int32], NDArray[np.int32], float]:
    """Return the arrays of LightTree, with lights in tree order, and the largest power of the root's children."""
    power = np.concatenate([[0.0], np.cumsum(lights.power)])
    node_power = power[end] - power[begin]
    levels, parent_levels = [], []
    places = np.zeros(len(lights), np.int32)
    frontier, parents = np.array([0]), np.array([-1])
    first, most = 0, 0.0
    while len(frontier):
        slots = _children(frontier, begin, end, left_child, node_power)
        is_light = slots < -1
        used = slots != -1
        # Ranges of lights below each used slot.
        low = np.where(is_light, -2 - slots, begin[np.maximum(slots, 0)])[used]
        high = np.where(is_light, -1 - slots, end[np.maximum(slots, 0)])[used]
        rows = np.zeros((len(frontier), ROWS, WIDTH), np.float32)
        where, slot = np.nonzero(used)
        bounds = _bounds_of_ranges(lights, low, high)
        rows[where, :14, slot] = bounds[:, :14]
        powers = np.zeros(slots.shape)
        powers[used] = bounds[:, 14]
        # Within a node only ratios count. The lower bound keeps every power positive.
        if first == 0:
            most = float(powers.max())
        relative = np.maximum(powers / powers.max(axis=1, keepdims=True), 1e-30)
        rows[:, 14] = np.where(used, relative, 0.0)
        inner = used & ~is_light
        child = np.zeros(slots.shape, np.int32)
        following = first + len(frontier)
        child[inner] = following + np.arange(inner.sum())
        child[is_light] = 1 + slots[is_light]  # −1 minus the light's number
        rows[:, 15] = child.view(np.float32)
        place = (WIDTH * (first + np.arange(len(frontier)))[:, None] + np.arange(WIDTH)).astype(np.int32)
        places[-2 - slots[is_light]] = place[is_light]
        levels.append(rows)
        parent_levels.append(parents)
        first, frontier, parents = following, slots[inner], place[inner]
    return np.concatenate(levels), np.concatenate(parent_levels).astype(np.int32), places, most


def _children(frontier: Indices, begin: Indices, end: Indices, left_child: Indices, power: Array) -> Indices:
    """Return (nodes, WIDTH) binary nodes that become the children of wide ones.

    −1 marks an unused slot, −2 − i light i. The child with the most power is opened until all slots are used.
    """
    slots = np.full((len(frontier), WIDTH), -1)
    is_group = left_child[frontier] < 0
    group = frontier[is_group]
    lights = begin[group][:, None] + np.arange(WIDTH)
    slots[is_group] = np.where(lights < end[group][:, None], -2 - lights, -1)
    rows = np.flatnonzero(~is_group)
    slots[rows, 0] = left_child[frontier[rows]]
    slots[rows, 1] = slots[rows, 0] + 1
    for used in range(2, WIDTH):
        nodes = slots[rows, :used]
        openable = np.where(left_child[nodes] >= 0, power[nodes], 0.0)
        widest = np.argmax(openable, axis=1)
        is_open = openable[np.arange(len(rows)), widest] > 0.0
        rows, widest = rows[is_open], widest[is_open]
        child = left_child[slots[rows, widest]]
        slots[rows, widest] = child
        slots[rows, used] = child + 1
    node = np.maximum(slots, 0)
    single = (slots >= 0) & (end[node] - begin[node] == 1)
    slots[single] = -2 - begin[slots[single]]
    return slots


def _bounds_of_ranges(lights: LightBounds, begin: Indices, end: Indices) -> Array:
    """Return (ranges, 15) bounds of the lights in each range, in the order of a node's rows."""
    positions, starts, run = _ranges(begin, end)
    below = lights.take(positions)
    low = np.minimum.reduceat(below.center - below.half, starts, axis=0)
    high = np.maximum.reduceat(below.center + below.half, starts, axis=0)
    # The sphere is centred at the float32 centre of the device; the slack covers rounding there.
    center = (0.5 * low + 0.5 * high).astype(np.float32).astype(np.float64)
    offset = below.center - center[run]
    radius = np.maximum.reduceat(np.sqrt((offset**2).sum(axis=1)) + below.radius, starts)
    slack = np.abs(center).max(axis=1) * 2.0**-20
    half = np.maximum(high - center, center - low) * (1.0 + 1e-6) + slack[:, None]
    # Flip two-sided lights towards the axis of the first light.
    against = (below.axis * below.axis[starts][run]).sum(axis=1) < 0.0
    sign = np.where(below.two_sided & against, -1.0, 1.0)
    mean = np.add.reduceat(below.axis * sign[:, None], starts, axis=0)
    length = np.sqrt((mean**2).sum(axis=1))
    axis = np.where(length[:, None] > 1e-6, mean / np.maximum(length, 1e-6)[:, None], [0.0, 0.0, 1.0])
    axis = axis.astype(np.float32).astype(np.float64)
    cosine = np.clip((below.axis * axis[run]).sum(axis=1) * sign, -1.0, 1.0)
    sine = np.sqrt(1.0 - cosine**2)
    along = np.minimum(np.abs(cosine) * below.depth + sine * below.radius, below.radius)
    depth = np.maximum.reduceat(np.abs((offset * axis[run]).sum(axis=1)) + along, starts)
    # A beam of more than 90 degrees to each side also lights what is behind its plane, as if it faced everywhere.
    cos_own = np.where(below.cos_falloff < 0.0, -1.0, below.cos_spread)
    angle = np.arccos(cosine) + np.arccos(np.clip(cos_own, -1.0, 1.0))
    spread = np.maximum.reduceat(angle, starts)
    cos_spread = np.where(spread < np.pi, np.maximum(np.cos(np.minimum(spread, np.pi)) - 1e-7, -1.0), -1.0)
    two_sided = np.maximum.reduceat(below.two_sided, starts)
    return np.concatenate(
        [
            center,
            half,
            ((radius * (1.0 + 1e-6) + slack) * np.where(two_sided, -1.0, 1.0))[:, None],
            axis,
            cos_spread[:, None],
            np.minimum.reduceat(below.cos_falloff, starts)[:, None] - _ROUNDING,
            np.sqrt(1.0 - cos_spread**2)[:, None],
            # If normals differ, a point beyond the extent may still be in front of some lights.
            np.where(spread < _FLAT, depth * (1.0 + 1e-6) + slack, np.inf)[:, None],
            np.add.reduceat(below.power, starts)[:, None],
        ],
        axis=1,
    )
