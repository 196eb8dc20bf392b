"""Building the ray tree on a device: the host's side of `kernels/bvh_build.py`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from wrt.device import Device
from wrt.errors import InputError

SUBTREE_SIZE = 16384
"""Triangles below which one thread builds a whole subtree: its boxes then stay in the cache."""


@dataclass(frozen=True)
class BuiltBvh:
    """A tree on a device.

    Attributes:
        data: the Bvh struct that kernels take.
        depth: levels of wide nodes.
        nodes: number of wide nodes.
        leaves: number of leaves.
        bytes: memory that nodes and leaves take.
    """

    data: Any
    depth: int
    nodes: int
    leaves: int
    bytes: int


def build_bvh(points: Any, indices: Any, device: Device) -> BuiltBvh:
    """Build the tree over triangles.

    Args:
        points: wp.array of vec3 on the device.
        indices: wp.array of int on the device, three a triangle, at least one triangle.
        device: where to build.

    Raises:
        InputError: where there are too many triangles for 32-bit offsets.
    """
    import warp as wp

    from wrt.kernels import bvh_build as k
    from wrt.kernels.simd import vec8

    name = device.name
    count = len(indices) // 3
    if count >= 2**26:
        raise InputError(f"{count} triangles are more than the {2**26 - 1} that one ray tree can hold")
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
        device.launch(k.split_nodes, len(level), [wp.array(level, dtype=int, device=name), nodes, boxes, *scratch])
        right = _field(nodes, "right", level)
        level = np.stack([level + 1, right], axis=1).ravel().astype(np.int32)
        counts = _field(nodes, "count", level)
    order = np.argsort(-np.concatenate(task_counts), kind="stable")
    roots = np.concatenate(tasks)[order]
    scratch = _scratch(len(roots), name)
    subtree_roots = wp.array(roots, dtype=int, device=name)
    device.launch(k.build_subtrees, len(roots), [subtree_roots, nodes, boxes, *scratch, costs])
    for level in reversed(levels):
        device.launch(k.price_nodes, len(level), [wp.array(level, dtype=int, device=name), nodes, costs])
    del costs
    return _collapse(nodes, boxes, points, indices, device)


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


def _collapse(nodes: Any, boxes: Any, points: Any, indices: Any, device: Device) -> BuiltBvh:
    import warp as wp

    from wrt.kernels import bvh_build as k
    from wrt.kernels.bvh import LEAF_FLOATS, MAX_DEPTH, NODE_FLOATS, Bvh

    name = device.name
    # First how many nodes and leaves there are, level by level, then the writing.
    levels = []
    level = wp.zeros(1, dtype=int, device=name)
    node_count = leaf_count = 0
    while len(level):
        n = len(level)
        inner = wp.empty(n, dtype=int, device=name)
        leaves = wp.empty(n, dtype=int, device=name)
        device.launch(k.count_children, n, [level, nodes, inner, leaves])
        inner_start, inner_total = _scan(inner)
        leaf_start, leaf_total = _scan(leaves)
        levels.append((level, inner_start, leaf_start, node_count, leaf_count))
        node_count += n
        leaf_count += leaf_total
        next_level = wp.empty(inner_total, dtype=int, device=name)
        if inner_total:
            device.launch(k.list_children, n, [level, nodes, inner_start, next_level])
        level = next_level
    if len(levels) > MAX_DEPTH:
        raise InputError(f"the ray tree is {len(levels)} levels deep, more than the {MAX_DEPTH} that rays can follow")

    data = Bvh()
    data.nodes = wp.empty(node_count * NODE_FLOATS, dtype=float, device=name)
    data.leaves = wp.empty(leaf_count * LEAF_FLOATS, dtype=float, device=name)
    children, leaf_ids = _as_int(data.nodes), _as_int(data.leaves)
    for level, inner_start, leaf_start, first_node, first_leaf in levels:
        first_child = first_node + len(level)
        device.launch(
            k.write_level,
            len(level),
            [level, nodes, boxes, points, indices, inner_start, leaf_start, first_node, first_child, first_leaf]
            + [data.nodes, children, data.leaves, leaf_ids],
        )
    size = 4 * (len(data.nodes) + len(data.leaves))
    return BuiltBvh(data, len(levels), node_count, leaf_count, size)


def _as_int(array: Any) -> Any:
    """Return the same memory seen as integers."""
    import warp as wp

    return wp.array(ptr=array.ptr, shape=array.shape, dtype=int, device=array.device)


def _scan(counts: Any) -> tuple[Any, int]:
    """Return the sums of the counts before each one, and of all."""
    import warp as wp

    start = wp.empty_like(counts)
    wp.utils.array_scan(counts, start, inclusive=False)
    return start, int(start[-1:].numpy()[0] + counts[-1:].numpy()[0])
