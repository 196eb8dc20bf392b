"""Build the binary tree below the wide BVH on the CPU: the host side of `split.py` and `top.py`.

GPUs make the same splits without waiting for the host: `gpu_tree.py`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from wrt.backend import current_backend
from wrt.backend.device import Device
from wrt.upload.accel.reinsertion import levels_of, reinsert

SUBTREE = 16384
"""One thread builds subtrees of up to this many triangles, whose boxes fit in a core's cache."""

CHUNK = 32768
"""Triangles of a larger node that one thread processes."""


def split_boxes(boxes: Any, device: Device, sah_depth: int, *, reinserts: bool) -> tuple[Any, float]:
    """Return the binary tree, with costs for collapsing it, and its total cost; reorder the boxes to match.

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
    first_chunks = _chunks(np.zeros(1, np.int64), np.array([count]), CHUNK, name)
    device.launch(top.find_centers, len(first_chunks.first), [first_chunks, boxes])
    root_centers = backend.array(first_chunks.centers.numpy().min(axis=0), "vec8", name)
    backend.copy(centers, root_centers, count=1)
    roots, root_counts = [], []
    level, firsts, counts = np.zeros(1, np.int32), np.zeros(1, np.int64), np.array([count])
    while len(level):
        large = counts > SUBTREE
        roots.append(level[~large])
        root_counts.append(counts[~large])
        level, firsts, counts = level[large], firsts[large], counts[large]
        if not len(level):
            break
        chunks = _chunks(firsts, counts, CHUNK, name)
        on_device, n, chunk_count = backend.array(level, int, name), len(level), len(chunks.first)
        splits = backend.empty(n, split.Split, name)
        device.launch(top.fill_chunk_bins, chunk_count, [on_device, chunks, boxes, centers])
        device.launch(top.split_level, n, [on_device, chunks, nodes, centers, sah_depth, splits])
        device.launch(top.part_chunks, chunk_count, [on_device, chunks, splits, centers, boxes])
        device.launch(top.join_centers, n, [on_device, chunks, nodes, centers])
        left = splits.numpy()["left"]
        swaps = _swaps(chunks, firsts + left, CHUNK)
        on_both_sides = [backend.array(numbers, int, name) for numbers in swaps]
        device.launch(top.swap_boxes, len(swaps[0]), [*on_both_sides, boxes])
        level = np.stack([level + 1, level + 2 * left], axis=1).ravel().astype(np.int32)
        firsts = np.stack([firsts, firsts + left], axis=1).ravel()
        counts = np.stack([left, counts - left], axis=1).ravel()
    order = np.argsort(-np.concatenate(root_counts), kind="stable")
    subtrees = backend.array(np.concatenate(roots)[order], int, name)
    inputs = [subtrees, nodes, boxes, centers, *empty_bins(len(subtrees), name), sah_depth]
    device.launch(split.build_subtrees, len(subtrees), inputs)
    if reinserts:
        reinsert(nodes, device)
    for numbers in reversed(levels_of(nodes)):
        on_device = backend.array(numbers, int, name)
        device.launch(collapse.price_nodes, len(numbers), [on_device, nodes, costs])
    return nodes, float(costs[:2].numpy()[1])


def _swaps(chunks: Any, middles: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the ranges to swap to partition nodes whose chunks are partitioned: both starts, and the length, of each.

    Args:
        chunks: the chunks of the nodes.
        middles: start of the right side of each node.
        size: length of the longest range.
    """
    middle, first = middles[chunks.node.numpy()], chunks.first.numpy()
    middle_of_chunk, end = first + chunks.left.numpy(), first + chunks.count.numpy()
    # In each node, as many boxes are misplaced before its middle as behind it, so both can be numbered together.
    right, right_ends = middle_of_chunk, np.cumsum(np.maximum(np.minimum(end, middle) - middle_of_chunk, 0))
    left, left_ends = np.maximum(first, middle), np.cumsum(np.maximum(middle_of_chunk - np.maximum(first, middle), 0))
    ends = np.union1d(np.union1d(right_ends, left_ends), np.arange(0, right_ends[-1], size))
    begins, ends = ends[:-1], ends[1:]

    def places(starts: np.ndarray, stops: np.ndarray) -> np.ndarray:
        chunk = np.searchsorted(stops, begins, side="right")
        return np.asarray(starts[chunk] + begins - np.concatenate([[0], stops])[chunk])

    return places(right, right_ends), places(left, left_ends), ends - begins


def empty_bins(count: int, name: str) -> list[Any]:
    """Allocate the boxes and the counts of `count` sets of bins."""
    backend = current_backend()
    bins = backend.kernels("wrt.kernels.native.constants").BINS
    return [backend.empty(count * 3 * bins, dtype, name) for dtype in ("vec8", int)]


def _chunks(firsts: np.ndarray, counts: np.ndarray, size: int, name: str) -> Any:
    """Return the Chunks of nodes that hold `counts` boxes from `firsts` on."""
    backend = current_backend()
    top = backend.kernels("wrt.kernels.accel.build.top")

    pieces = -(-counts // size)
    start = np.concatenate([[0], np.cumsum(pieces)])
    node = np.repeat(np.arange(len(counts)), pieces)
    begin = (np.arange(start[-1]) - start[node]) * size
    chunks = top.Chunks()
    chunks.node = backend.array(node, int, name)
    chunks.start = backend.array(start, int, name)
    chunks.first = backend.array(firsts[node] + begin, int, name)
    chunks.count = backend.array(np.minimum(counts[node] - begin, size), int, name)
    chunks.bin_boxes, chunks.bin_counts = empty_bins(len(node), name)
    chunks.centers = backend.empty(2 * len(node), "vec8", name)
    chunks.left = backend.empty(len(node), int, name)
    return chunks
