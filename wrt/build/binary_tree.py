"""The binary tree that the ray tree is made from: the host's side of `kernels/bvh_split.py` and `bvh_top.py`."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from wrt.build.reinsertion import levels_of, reinsert
from wrt.device import Device


class BuildSizes(NamedTuple):
    """How many triangles one thread has.

    Attributes:
        subtree: most triangles below which one thread builds the whole subtree.
        chunk: triangles of a larger node that one thread looks at.
    """

    subtree: int
    chunk: int


CPU_SIZES = BuildSizes(subtree=16384, chunk=32768)
"""A subtree's boxes stay in a core's cache."""

CUDA_SIZES = BuildSizes(subtree=128, chunk=256)
"""Enough threads for a GPU; not measured on one."""


def split_boxes(boxes: Any, device: Device, sah_depth: int, *, reinserts: bool) -> tuple[Any, float]:
    """Return the binary tree, with its collapse priced, and that price; the boxes are put in its order.

    Args:
        boxes: wp.array of vec8, as in `kernels/bvh_boxes.py`.
        device: where they are.
        sah_depth: down to which splits are by surface area, and not by halves.
        reinserts: whether nodes are then moved to where they cost less, which may make the tree deeper.
    """
    import warp as wp

    from wrt.kernels import bvh_collapse, bvh_split, bvh_top
    from wrt.kernels.simd import vec8

    name, count = device.name, len(boxes)
    nodes = wp.empty(2 * count, dtype=bvh_split.BinaryNode, device=name)
    centers = wp.empty(2 * count, dtype=vec8, device=name)
    # A node's centres are done with when its collapse is priced.
    costs = wp.array(ptr=centers.ptr, shape=2 * count * bvh_collapse.COST_SLOTS, dtype=float, device=name)
    root = np.zeros(1, bvh_split.BinaryNode.numpy_dtype())
    root["count"] = count
    wp.copy(nodes, wp.array(root, dtype=bvh_split.BinaryNode, device=name), count=1)

    # Top: level by level, each node by many threads, down to subtrees that one thread builds whole.
    sizes = CPU_SIZES if device.is_cpu else CUDA_SIZES
    first_chunks = _chunks(np.zeros(1, np.int64), np.array([count]), sizes.chunk, name)
    device.launch(bvh_top.find_centers, len(first_chunks.first), [first_chunks, boxes])
    root_centers = wp.array(first_chunks.centers.numpy().min(axis=0), dtype=vec8, device=name)
    wp.copy(centers, root_centers, count=1)
    roots, root_counts = [], []
    level, firsts, counts = np.zeros(1, np.int32), np.zeros(1, np.int64), np.array([count])
    while len(level):
        large = counts > sizes.subtree
        roots.append(level[~large])
        root_counts.append(counts[~large])
        level, firsts, counts = level[large], firsts[large], counts[large]
        if not len(level):
            break
        chunks = _chunks(firsts, counts, sizes.chunk, name)
        on_device, n, chunk_count = wp.array(level, dtype=int, device=name), len(level), len(chunks.first)
        splits = wp.empty(n, dtype=bvh_split.Split, device=name)
        device.launch(bvh_top.fill_chunk_bins, chunk_count, [on_device, chunks, boxes, centers])
        device.launch(bvh_top.split_level, n, [on_device, chunks, nodes, centers, sah_depth, splits])
        device.launch(bvh_top.part_chunks, chunk_count, [on_device, chunks, splits, centers, boxes])
        device.launch(bvh_top.join_centers, n, [on_device, chunks, nodes, centers])
        left = splits.numpy()["left"]
        swaps = _swaps(chunks, firsts + left, sizes.chunk)
        on_both_sides = [wp.array(numbers, dtype=int, device=name) for numbers in swaps]
        device.launch(bvh_top.swap_boxes, len(swaps[0]), [*on_both_sides, boxes])
        level = np.stack([level + 1, level + 2 * left], axis=1).ravel().astype(np.int32)
        firsts = np.stack([firsts, firsts + left], axis=1).ravel()
        counts = np.stack([left, counts - left], axis=1).ravel()
    order = np.argsort(-np.concatenate(root_counts), kind="stable")
    subtrees = wp.array(np.concatenate(roots)[order], dtype=int, device=name)
    inputs = [subtrees, nodes, boxes, centers, *_bins(len(subtrees), name), sah_depth]
    device.launch(bvh_split.build_subtrees, len(subtrees), inputs)
    if reinserts:
        reinsert(nodes, device)
    for numbers in reversed(levels_of(nodes)):
        on_device = wp.array(numbers, dtype=int, device=name)
        device.launch(bvh_collapse.price_nodes, len(numbers), [on_device, nodes, costs])
    return nodes, float(costs[:2].numpy()[1])


def _swaps(chunks: Any, middles: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return what is on the wrong sides of nodes whose chunks are parted: starts of ranges to swap, and lengths.

    Args:
        chunks: of the nodes.
        middles: where the right side of each node begins.
        size: the longest range.
    """
    middle, first = middles[chunks.node.numpy()], chunks.first.numpy()
    middle_of_chunk, end = first + chunks.left.numpy(), first + chunks.count.numpy()
    # In each node as many go right before its middle as go left behind it, so both are numbered through.
    right, right_ends = middle_of_chunk, np.cumsum(np.maximum(np.minimum(end, middle) - middle_of_chunk, 0))
    left, left_ends = np.maximum(first, middle), np.cumsum(np.maximum(middle_of_chunk - np.maximum(first, middle), 0))
    ends = np.union1d(np.union1d(right_ends, left_ends), np.arange(0, right_ends[-1], size))
    begins, ends = ends[:-1], ends[1:]

    def places(starts: np.ndarray, stops: np.ndarray) -> np.ndarray:
        chunk = np.searchsorted(stops, begins, side="right")
        return np.asarray(starts[chunk] + begins - np.concatenate([[0], stops])[chunk])

    return places(right, right_ends), places(left, left_ends), ends - begins


def _bins(count: int, name: str) -> list[Any]:
    """Return memory for the boxes and the numbers of `count` sets of bins."""
    import warp as wp

    from wrt.kernels.bvh_ranges import BINS
    from wrt.kernels.simd import vec8

    return [
        wp.empty(count * 3 * BINS, dtype=vec8, device=name),
        wp.empty(count * 3 * BINS, dtype=int, device=name),
    ]


def _chunks(firsts: np.ndarray, counts: np.ndarray, size: int, name: str) -> Any:
    """Return the Chunks of nodes over `counts` boxes from `firsts`."""
    import warp as wp

    from wrt.kernels.bvh_top import Chunks
    from wrt.kernels.simd import vec8

    pieces = -(-counts // size)
    start = np.concatenate([[0], np.cumsum(pieces)])
    node = np.repeat(np.arange(len(counts)), pieces)
    begin = (np.arange(start[-1]) - start[node]) * size
    chunks = Chunks()
    chunks.node = wp.array(node, dtype=int, device=name)
    chunks.start = wp.array(start, dtype=int, device=name)
    chunks.first = wp.array(firsts[node] + begin, dtype=int, device=name)
    chunks.count = wp.array(np.minimum(counts[node] - begin, size), dtype=int, device=name)
    chunks.bin_boxes, chunks.bin_counts = _bins(len(node), name)
    chunks.centers = wp.empty(2 * len(node), dtype=vec8, device=name)
    chunks.left = wp.empty(len(node), dtype=int, device=name)
    return chunks
