"""Build the binary tree below the wide BVH on the CPU: the host side of `split.py`, `top.py` and `reinsert.py`.

GPUs make the same splits without waiting for the host: `gpu_tree.py`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.backend import current_backend
from wrt.backend.device import Device

SUBTREE = 16384
"""One thread builds subtrees of up to this many triangles, whose boxes fit in a core's cache."""

CHUNK = 32768
"""Triangles of a larger node that one thread processes."""

ROUNDS = 6
"""Rounds of reinsertion; in one round, moves that touch the same nodes exclude one another."""

LARGEST = 4096
"""Nodes that are reinserted in a round, those with the largest area."""

NEAR_ROOT = 8 * LARGEST
"""These nodes are searched for in the top levels that hold this many: areas shrink further down."""

ANY_VISITS = 2**31 - 1
"""Nodes that a search may visit: all."""

LEAST = 32
"""Smaller trees are not worth optimising."""


def split_boxes(boxes: Any, device: Device, sah_depth: int, *, reinserts: bool) -> tuple[Any, Any, int]:
    """Return the binary tree, the costs for collapsing it, and a bound on inner nodes; reorder the boxes to match.

    Args:
        boxes: array of vec8, as in `kernels/accel/build/boxes.py`.
        device: the device of the boxes.
        sah_depth: depth down to which splits minimise the surface area heuristic; deeper nodes are halved.
        reinserts: whether to reinsert nodes where they cost less, which may make the tree deeper.
    """
    backend = current_backend()
    collapse = backend.kernels("wrt.kernels.accel.build.collapse")
    split = backend.kernels("wrt.kernels.accel.build.split")
    top = backend.kernels("wrt.kernels.accel.build.top")

    name, count = device.name, len(boxes)
    nodes = backend.empty(2 * count, split.BinaryNode, name)
    centers = backend.empty(2 * count, "vec8", name)
    # Costs reuse the memory of the centres, which are no longer needed by then.
    costs = backend.view(centers, float, 2 * count * collapse.COST_SLOTS)
    root = np.zeros(1, split.BinaryNode.numpy_dtype())
    root["count"] = count
    backend.copy(nodes, backend.array(root, split.BinaryNode, name), count=1)

    # Split the top level by level with many threads a node, down to subtrees that one thread builds whole.
    of_chunks = backend.empty(-(-count // CHUNK), "vec8", name)
    device.launch(top.find_centers, len(of_chunks), [CHUNK, boxes, of_chunks])
    backend.copy(centers, backend.array(of_chunks.numpy().min(axis=0), "vec8", name), count=1)
    roots, root_counts = [], []
    numbers, firsts, counts = np.zeros(1, np.int32), np.zeros(1, np.int64), np.array([count])
    while len(numbers):
        large = counts > SUBTREE
        roots.append(numbers[~large])
        root_counts.append(counts[~large])
        numbers, firsts, counts = numbers[large], firsts[large], counts[large]
        if not len(numbers):
            break
        n, level, chunks = len(numbers), *_level_of(numbers, counts, name)
        chunk_count = len(chunks.left)
        device.launch(top.fill_chunk_bins, chunk_count, [level, chunks, nodes, boxes, centers])
        device.launch(top.join_chunk_bins, n * top.AXIS_BINS, [level, chunks])
        device.launch(top.split_nodes, n, [level, nodes, centers, sah_depth])
        device.launch(top.count_left, chunk_count, [level, chunks, nodes])
        device.launch(top.part_chunks, chunk_count, [level, chunks, nodes, boxes, centers])
        device.launch(top.join_centers, n, [level, chunks, nodes, centers])
        left = level.splits.numpy()["left"]
        swaps = _swaps(firsts, counts, firsts + left, chunks.left.numpy())
        on_both_sides = [backend.array(places, int, name) for places in swaps]
        device.launch(top.swap_boxes, len(swaps[0]), [*on_both_sides, boxes])
        numbers = np.stack([numbers + 1, numbers + 2 * left], axis=1).ravel().astype(np.int32)
        firsts = np.stack([firsts, firsts + left], axis=1).ravel()
        counts = np.stack([left, counts - left], axis=1).ravel()
    order = np.argsort(-np.concatenate(root_counts), kind="stable")
    subtrees = backend.array(np.concatenate(roots)[order], int, name)
    inputs = [subtrees, nodes, boxes, centers, *empty_bins(len(subtrees), name), sah_depth]
    device.launch(split.build_subtrees, len(subtrees), inputs)
    if reinserts:
        _reinsert(nodes, device)
    levels = levels_of(nodes)
    for numbers in reversed(levels):
        device.launch(collapse.price_nodes, len(numbers), [backend.array(numbers, int, name), nodes, costs])
    return nodes, costs, sum(map(len, levels)) // 2


def _level_of(numbers: np.ndarray, counts: np.ndarray, name: str) -> tuple[Any, Any]:
    """Return the Level of nodes over `counts` boxes, and its Chunks."""
    backend = current_backend()
    split = backend.kernels("wrt.kernels.accel.build.split")
    top = backend.kernels("wrt.kernels.accel.build.top")

    n, pieces = len(numbers), -(-counts // CHUNK)
    chunk_count = int(pieces.sum())
    level, chunks = top.Level(), top.Chunks()
    level.chunk = CHUNK
    level.counts = backend.array(np.array([n << 32 | chunk_count]), "int64", name)
    level.node, level.start = (backend.array(rows, int, name) for rows in (numbers, np.cumsum(pieces) - pieces))
    level.splits = backend.empty(n, split.Split, name)
    level.bin_boxes, level.bin_counts = empty_bins(n, name)
    chunks.place, chunks.left = (backend.empty(chunk_count, int, name) for _ in range(2))
    chunks.bin_boxes, chunks.bin_counts = empty_bins(chunk_count, name)
    chunks.centers = backend.empty(2 * chunk_count, "vec8", name)
    return level, chunks


def _swaps(
    firsts: np.ndarray, counts: np.ndarray, middles: np.ndarray, left: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the ranges to swap to partition nodes whose chunks are partitioned: both starts, and the length, of each.

    Args:
        firsts: first box of each node.
        counts: number of its boxes.
        middles: start of its right side.
        left: for each chunk of each node, the number of boxes on the left.
    """
    pieces = -(-counts // CHUNK)
    node = np.repeat(np.arange(len(counts)), pieces)
    first = firsts[node] + (np.arange(len(node)) - (np.cumsum(pieces) - pieces)[node]) * CHUNK
    end = np.minimum(first + CHUNK, (firsts + counts)[node])
    middle, middle_of_chunk = middles[node], first + left
    # In each node, as many boxes are misplaced before its middle as behind it, so both can be numbered together.
    right_ends = np.cumsum(np.maximum(np.minimum(end, middle) - middle_of_chunk, 0))
    left_begins = np.maximum(first, middle)
    left_ends = np.cumsum(np.maximum(middle_of_chunk - left_begins, 0))
    ends = np.union1d(np.union1d(right_ends, left_ends), np.arange(0, right_ends[-1], CHUNK))
    begins, ends = ends[:-1], ends[1:]

    def places(starts: np.ndarray, stops: np.ndarray) -> np.ndarray:
        chunk = np.searchsorted(stops, begins, side="right")
        return np.asarray(starts[chunk] + begins - np.concatenate([[0], stops])[chunk])

    return places(middle_of_chunk, right_ends), places(left_begins, left_ends), ends - begins


def empty_bins(count: int, name: str) -> list[Any]:
    """Allocate the boxes and the counts of `count` sets of bins."""
    backend = current_backend()
    bins = backend.kernels("wrt.kernels.native.constants").BINS
    return [backend.empty(count * 3 * bins, dtype, name) for dtype in ("vec8", int)]


def levels_of(nodes: Any) -> list[NDArray[np.int32]]:
    """Return the node numbers of a binary tree, an array of BinaryNode that begins with the root, by depth."""
    all_nodes = nodes.numpy()
    levels = [np.zeros(1, np.int32)]
    while len(levels[-1]):
        right = all_nodes["right"][levels[-1]]
        inner = levels[-1][right != 0]
        levels.append(np.concatenate([all_nodes["left"][inner], right[right != 0]]))
    return levels[:-1]


def _reinsert(nodes: Any, device: Device) -> None:
    """Reinsert the largest nodes of a binary tree where they reduce the total surface area.

    Args:
        nodes: array of BinaryNode, changed in place.
        device: its device.
    """
    backend = current_backend()
    kernels = backend.kernels("wrt.kernels.accel.build.reinsert")

    levels = levels_of(nodes)
    upper_levels = 1 + int(np.searchsorted(np.cumsum([len(level) for level in levels]), NEAR_ROOT))
    numbers = np.concatenate(levels[:upper_levels])
    if len(numbers) < LEAST:
        return
    parents = backend.array(np.full(len(nodes), -1, np.int32), int, device.name)
    every_node = np.concatenate(levels)
    inner = every_node[nodes.numpy()["right"][every_node] != 0]
    device.launch(kernels.write_parents, len(inner), [backend.array(inner, int, device.name), nodes, parents])
    touched = backend.empty(len(nodes), int, device.name)
    for _ in range(ROUNDS):
        moving = _largest(nodes, numbers)
        on_device = backend.array(moving, int, device.name)
        places = backend.empty(len(moving), int, device.name)
        gains = backend.empty(len(moving), float, device.name)
        device.launch(kernels.find_places, len(moving), [on_device, nodes, parents, ANY_VISITS, places, gains])
        found, saved = places.numpy(), gains.numpy()
        order = np.argsort(-saved, kind="stable")
        order = order[found[order] >= 0]
        if not len(order):
            return
        touched.zero_()
        chosen = [backend.array(numbers[order], int, device.name) for numbers in (moving, found)]
        device.launch(kernels.move_nodes, 1, [*chosen, nodes, parents, touched])


def _largest(nodes: Any, numbers: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return those of some node numbers whose nodes have the largest area."""
    some = nodes.numpy()[numbers]
    with np.errstate(over="ignore", invalid="ignore"):
        size = some["upper"] - some["lower"]
        areas = size[:, 0] * size[:, 1] + size[:, 1] * size[:, 2] + size[:, 2] * size[:, 0]
    return numbers[np.argsort(-areas, kind="stable")[:LARGEST]]
