"""Building the ray tree on a device: the host's side of `kernels/bvh_build.py`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from wrt.device import Device
from wrt.errors import InputError

SUBTREE_SIZE = 16384
"""Triangles below which one thread builds a whole subtree: its boxes then stay in the cache."""

SAH_DEPTHS = (48, 8)
"""Depths of the binary tree down to which it is split by surface area, tried in this order. At the
last one the tree is at most 8 + 23 levels deep, for 2^26 triangles eight a leaf: rays can follow."""


@dataclass(frozen=True)
class BuiltBvh:
    """A tree on a device.

    Attributes:
        data: the Bvh struct that kernels take.
        depth: levels of wide nodes.
        nodes: number of wide nodes.
        leaves: number of leaves.
        bytes: memory that nodes and leaves take.
        bounds: (2, 3) float64 lowest and highest corner of all triangles.
    """

    data: Any
    depth: int
    nodes: int
    leaves: int
    bytes: int
    bounds: np.ndarray


def build_bvh(points: Any, indices: Any, device: Device) -> BuiltBvh:
    """Build the tree over triangles.

    Args:
        points: wp.array of vec3 on the device.
        indices: wp.array of int on the device, three a triangle, at least one triangle.
        device: where to build.

    Raises:
        InputError: where there are too many triangles for 32-bit offsets.
    """
    count = len(indices) // 3
    if count >= 2**26:
        raise InputError(f"{count} triangles are more than the {2**26 - 1} that one ray tree can hold")
    from wrt.kernels.bvh import MAX_DEPTH

    for sah_depth in SAH_DEPTHS:
        nodes, boxes = _split(points, indices, device, sah_depth)
        levels = _levels(nodes, device, MAX_DEPTH)
        if len(levels) <= MAX_DEPTH:
            break
    return _write(levels, nodes, boxes, points, indices, device)


def _split(points: Any, indices: Any, device: Device, sah_depth: int) -> tuple[Any, Any]:
    """Return the binary tree, with its collapse priced, and the triangles' boxes in its order."""
    import warp as wp

    from wrt.kernels import bvh_build as k
    from wrt.kernels.simd import vec8

    name, count = device.name, len(indices) // 3
    boxes = wp.empty(count, dtype=vec8, device=name)
    device.launch(k.make_boxes, count, [points, indices, boxes])
    nodes = wp.zeros(2 * count, dtype=k.BinaryNode, device=name)
    costs = wp.empty(2 * count * k.COST_SLOTS, dtype=float, device=name)
    root = np.zeros(1, k.BinaryNode.numpy_dtype())
    root["count"] = count
    wp.copy(nodes, wp.array(root, dtype=k.BinaryNode, device=name), count=1)

    # Top: one node a thread, level after level, down to subtrees that one thread builds whole.
    levels: list[np.ndarray] = []
    tasks: list[np.ndarray] = []
    task_counts: list[np.ndarray] = []
    level, counts = np.zeros(1, np.int32), np.array([count])
    while len(level):
        large = counts > SUBTREE_SIZE
        tasks.append(level[~large])
        task_counts.append(counts[~large])
        level, counts = level[large], counts[large]
        if not len(level):
            break
        levels.append(level)
        scratch = _scratch(len(level), name)
        device.launch(
            k.split_nodes, len(level), [wp.array(level, dtype=int, device=name), nodes, boxes, *scratch, sah_depth]
        )
        right = _field(nodes, "right", level)
        level = np.stack([level + 1, right], axis=1).ravel().astype(np.int32)
        counts = _field(nodes, "count", level)
    order = np.argsort(-np.concatenate(task_counts), kind="stable")
    roots = np.concatenate(tasks)[order]
    scratch = _scratch(len(roots), name)
    subtree_roots = wp.array(roots, dtype=int, device=name)
    device.launch(k.build_subtrees, len(roots), [subtree_roots, nodes, boxes, *scratch, sah_depth, costs])
    for level in reversed(levels):
        device.launch(k.price_nodes, len(level), [wp.array(level, dtype=int, device=name), nodes, costs])
    return nodes, boxes


def _scratch(tasks: int, name: str) -> list[Any]:
    import warp as wp

    from wrt.kernels import bvh_build as k
    from wrt.kernels.simd import vec8

    return [
        wp.empty(tasks * 3 * k.BINS, dtype=vec8, device=name),
        wp.empty(tasks * 3 * k.BINS, dtype=int, device=name),
    ]


def _field(nodes: Any, field: str, index: np.ndarray) -> np.ndarray:
    """Read one field of a few nodes."""
    import warp as wp

    picked = wp.indexedarray(nodes, [wp.array(index, dtype=int, device=nodes.device)])
    values: np.ndarray = picked.numpy()[field]
    return values


class _Level(NamedTuple):
    """Wide nodes of one depth: their binary nodes, and where their children and leaves are to be."""

    roots: Any
    inner_start: Any
    leaf_start: Any
    inner_total: int
    leaf_total: int


def _levels(nodes: Any, device: Device, max_depth: int) -> list[_Level]:
    """Return the wide tree level by level, down to no more than one level too many."""
    import warp as wp

    from wrt.kernels import bvh_build as k

    levels: list[_Level] = []
    roots = wp.zeros(1, dtype=int, device=device.name)
    while len(roots) and len(levels) <= max_depth:
        n = len(roots)
        inner = wp.empty(n, dtype=int, device=device.name)
        leaves = wp.empty(n, dtype=int, device=device.name)
        device.launch(k.count_children, n, [roots, nodes, inner, leaves])
        level = _Level(roots, *_scan(inner, leaves))
        levels.append(level)
        roots = wp.empty(level.inner_total, dtype=int, device=device.name)
        if level.inner_total:
            device.launch(k.list_children, n, [level.roots, nodes, level.inner_start, roots])
    return levels


def _write(levels: list[_Level], nodes: Any, boxes: Any, points: Any, indices: Any, device: Device) -> BuiltBvh:

    from wrt.kernels import bvh_build as k
    from wrt.kernels.bvh import LEAF_FLOATS, NODE_FLOATS, Bvh

    node_count = sum(len(level.roots) for level in levels)
    leaf_count = sum(level.leaf_total for level in levels)
    data = Bvh()
    data.nodes = device.empty_large(node_count * NODE_FLOATS)
    data.leaves = device.empty_large(leaf_count * LEAF_FLOATS)
    out = [data.nodes, _as_int(data.nodes), data.leaves, _as_int(data.leaves)]
    first_node = first_leaf = 0
    for level in levels:
        first_child = first_node + len(level.roots)
        places = [level.inner_start, level.leaf_start, first_node, first_child, first_leaf]
        device.launch(k.write_level, len(level.roots), [level.roots, nodes, boxes, points, indices, *places, *out])
        first_node = first_child
        first_leaf += level.leaf_total
    size = 4 * (len(data.nodes) + len(data.leaves))
    root = nodes[:1].numpy()
    bounds = np.concatenate([root["lower"], root["upper"]]).astype(np.float64)
    return BuiltBvh(data, len(levels), node_count, leaf_count, size, bounds)


def _as_int(array: Any) -> Any:
    """Return the same memory seen as integers."""
    import warp as wp

    return wp.array(ptr=array.ptr, shape=array.shape, dtype=int, device=array.device)


def _scan(inner: Any, leaves: Any) -> tuple[Any, Any, int, int]:
    """Return for both counts the sums before each one, and the sums of all."""
    import warp as wp

    starts, totals = [], []
    for counts in (inner, leaves):
        start = wp.empty_like(counts)
        wp.utils.array_scan(counts, start, inclusive=False)
        starts.append(start)
        totals.append(int(start[-1:].numpy()[0] + counts[-1:].numpy()[0]))
    return starts[0], starts[1], totals[0], totals[1]
