"""Building the ray tree on a device: the host's side of the kernels in `kernels/bvh_*.py`."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from wrt.device import Device
from wrt.errors import InputError


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

SAH_DEPTHS = (48, 8)
"""Depths of the binary tree down to which it is split by surface area, tried in this order. At the
last one the tree is at most 8 + 23 levels deep, for 2^26 triangles eight a leaf: rays can follow."""

MORE_PIECES = 0.2
"""Boxes that cutting large triangles may add, over the number of triangles; measured in docs/performance.md."""

WORTH_CUTTING = 0.9
"""What a tree over pieces may cost, over the cost of one over whole triangles, to be taken instead."""


@dataclass(frozen=True)
class BuiltBvh:
    """A tree on a device.

    Attributes:
        data: the Bvh struct that kernels take.
        level_starts: number of the first wide node of each level, and of all nodes.
        leaves: number of leaves.
        references: places in leaves that hold a triangle; more than there are triangles where large ones
            were cut and lie in several leaves.
        bytes: memory that nodes and leaves take.
    """

    data: Any
    level_starts: tuple[int, ...]
    leaves: int
    references: int
    bytes: int

    @property
    def bounds(self) -> np.ndarray:
        """(2, 3) float64 lowest and highest corner of all triangles, where they are now."""
        root = self.data.nodes[:48].numpy().reshape(2, 3, 8).astype(np.float64)
        return np.stack([root[0].min(axis=1), root[1].max(axis=1)])

    @property
    def depth(self) -> int:
        """Levels of wide nodes."""
        return len(self.level_starts) - 1

    @property
    def nodes(self) -> int:
        """Number of wide nodes."""
        return self.level_starts[-1]


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
    import warp as wp

    from wrt.kernels.bvh import MAX_DEPTH
    from wrt.kernels.bvh_split import make_boxes
    from wrt.kernels.simd import vec8

    boxes = wp.empty(count, dtype=vec8, device=device.name)
    device.launch(make_boxes, count, [points, indices, boxes])
    tree = _wide_tree(boxes, device, MAX_DEPTH)
    pieces = _cut_triangles(points, indices, tree.nodes, device)
    if pieces is not None:
        other = _wide_tree(pieces, device, MAX_DEPTH)
        if other.price < WORTH_CUTTING * tree.price:
            boxes, tree = pieces, other
    return _write(tree.levels, tree.nodes, boxes, points, indices, device)


def _cut_triangles(points: Any, indices: Any, nodes: Any, device: Device) -> Any:
    """Return the boxes of triangles of which the most wasteful are cut, or None where none stands out."""
    import warp as wp

    from wrt.kernels import bvh_presplit as k
    from wrt.kernels.simd import vec8

    count, root = len(indices) // 3, nodes[:1].numpy()[0]
    low = root["lower"]
    with np.errstate(over="ignore"):
        size = np.maximum(root["upper"] - low, np.float32(1e-30))
    if not np.isfinite(size).all():
        return None
    scene = [wp.vec3(*low.tolist()), wp.vec3(*size.tolist())]
    importance = wp.empty(count, dtype=float, device=device.name)
    device.launch(k.find_importance, count, [points, indices, *scene, importance])
    # So the pieces are at most as many as MORE_PIECES says, and of like triangles none is cut.
    total = float(importance.numpy().sum(dtype=np.float64))
    if not 0.0 < total < np.inf:
        return None
    pieces = wp.empty(count, dtype=int, device=device.name)
    device.launch(k.count_pieces, count, [importance, MORE_PIECES * count / total, pieces])
    start, total_pieces = _sums_before(pieces)
    if total_pieces == count or total_pieces >= 2**26:
        return None
    boxes = wp.empty(total_pieces, dtype=vec8, device=device.name)
    device.launch(k.write_pieces, count, [points, indices, *scene, start, pieces, boxes])
    return boxes


def refit_bvh(built: BuiltBvh, points: Any, indices: Any, device: Device) -> None:
    """Let a tree follow its triangles after their vertices moved; it stays right, and fast while they move little.

    Args:
        built: the tree, changed in place.
        points: wp.array of vec3 on the device, as many as the tree was built over.
        indices: those that the tree was built over.
        device: where the tree is.
    """
    from wrt.kernels import bvh_refit as k

    device.launch(k.refit_leaves, built.leaves, [points, indices, _as_int(built.data.leaves), built.data])
    children = _as_int(built.data.nodes)
    for start, end in reversed(list(itertools.pairwise(built.level_starts))):
        device.launch(k.refit_level, end - start, [start, built.data, children])


def build_upper_tree(lower: np.ndarray, upper: np.ndarray, device: Device) -> Any:
    """Return the nodes of a tree over boxes, as `kernels/instances.py` wants it: a leaf is −1 − (the box's number).

    Args:
        lower: (N, 3) float32 least corners, at least one.
        upper: (N, 3) float32 greatest corners.
        device: where to build.
    """
    import warp as wp

    from wrt.kernels import bvh_collapse as k
    from wrt.kernels.bvh import MAX_DEPTH, NODE_FLOATS
    from wrt.kernels.simd import vec8

    rows = np.zeros((len(lower), 8), np.float32)
    rows[:, :3], rows[:, 4:7] = lower, -upper
    rows[:, 3] = np.arange(len(lower), dtype=np.int32).view(np.float32)
    boxes = wp.array(rows, dtype=vec8, device=device.name)
    # What would be a leaf becomes one more node, with the boxes one by one.
    levels, nodes, _ = _wide_tree(boxes, device, MAX_DEPTH - 1)
    leaf_nodes = _level_starts(levels)[-1]
    out = device.empty_large((leaf_nodes + _leaf_count(levels)) * NODE_FLOATS)
    leaf_roots = _write_nodes(levels, nodes, leaf_nodes, out, device)
    device.launch(k.write_leaf_nodes, len(leaf_roots), [leaf_roots, nodes, boxes, leaf_nodes, out, _as_int(out)])
    return out


class _Tree(NamedTuple):
    """A wide tree by levels, the binary tree below it, and what a ray through its box pays for tests."""

    levels: list[_Level]
    nodes: Any
    price: float


def _wide_tree(boxes: Any, device: Device, max_depth: int) -> _Tree:
    """Return the wide tree over boxes, which are put in its order."""
    for sah_depth in SAH_DEPTHS:
        nodes, price = _split(boxes, device, sah_depth)
        levels = _levels(nodes, device, max_depth)
        if len(levels) <= max_depth:
            break
    return _Tree(levels, nodes, price)


def _split(boxes: Any, device: Device, sah_depth: int) -> tuple[Any, float]:
    """Return the binary tree, with its collapse priced, and that price; the boxes are put in its order."""
    import warp as wp

    from wrt.kernels import bvh_collapse, bvh_split, bvh_top
    from wrt.kernels.simd import vec8

    name, count = device.name, len(boxes)
    spare = wp.empty(count, dtype=vec8, device=name)
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
    levels: list[Any] = []
    roots, root_counts, in_spare = [], [], []
    level, firsts, counts = np.zeros(1, np.int32), np.zeros(1, np.int64), np.array([count])
    source, target = boxes, spare
    while len(level):
        large = counts > sizes.subtree
        roots.append(level[~large])
        root_counts.append(counts[~large])
        in_spare.append(np.full(len(roots[-1]), source is spare))
        level, firsts, counts = level[large], firsts[large], counts[large]
        if not len(level):
            break
        chunks = _chunks(firsts, counts, sizes.chunk, name)
        on_device, n, chunk_count = wp.array(level, dtype=int, device=name), len(level), len(chunks.first)
        splits = wp.empty(n, dtype=bvh_split.Split, device=name)
        device.launch(bvh_top.fill_chunk_bins, chunk_count, [on_device, chunks, source, centers])
        device.launch(bvh_top.split_level, n, [on_device, chunks, nodes, centers, sah_depth, splits])
        device.launch(bvh_top.part_chunks, chunk_count, [on_device, chunks, splits, centers, source, target])
        device.launch(bvh_top.join_centers, n, [on_device, chunks, nodes, centers])
        levels.append(on_device)
        left = splits.numpy()["left"]
        level = np.stack([level + 1, level + 2 * left], axis=1).ravel().astype(np.int32)
        firsts = np.stack([firsts, firsts + left], axis=1).ravel()
        counts = np.stack([left, counts - left], axis=1).ravel()
        source, target = target, source
    order = np.argsort(-np.concatenate(root_counts), kind="stable")
    subtrees = wp.array(np.concatenate(roots)[order], dtype=int, device=name)
    moved = wp.array(np.concatenate(in_spare)[order].astype(np.int32), dtype=int, device=name)
    subtree_sizes = wp.empty(len(subtrees), dtype=int, device=name)
    inputs = [subtrees, moved, nodes, boxes, spare, centers, *_bins(len(subtrees), name), sah_depth, subtree_sizes]
    device.launch(bvh_split.build_subtrees, len(subtrees), inputs)
    device.launch(bvh_collapse.price_subtrees, len(subtrees), [subtrees, subtree_sizes, nodes, costs])
    for on_device in reversed(levels):
        device.launch(bvh_collapse.price_nodes, len(on_device), [on_device, nodes, costs])
    return nodes, float(costs[:2].numpy()[1])


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
    chunks.left_at = wp.empty(len(node), dtype=int, device=name)
    chunks.right_at = wp.empty(len(node), dtype=int, device=name)
    return chunks


class _Level(NamedTuple):
    """Wide nodes of one depth: how many, the binary nodes of their children, and where those are to be."""

    size: int
    children: Any
    inner_start: Any
    leaf_start: Any
    inner_total: int
    leaf_total: int


def _levels(nodes: Any, device: Device, max_depth: int) -> list[_Level]:
    """Return the wide tree level by level, down to no more than one level too many."""
    import warp as wp

    from wrt.kernels import bvh_collapse as k

    levels: list[_Level] = []
    roots = wp.zeros(1, dtype=int, device=device.name)
    while len(roots) and len(levels) <= max_depth:
        n = len(roots)
        children = wp.empty(8 * n, dtype=int, device=device.name)
        inner = wp.empty(n, dtype=int, device=device.name)
        leaves = wp.empty(n, dtype=int, device=device.name)
        device.launch(k.find_children, n, [roots, nodes, children, inner, leaves])
        level = _Level(n, children, *_scan(inner, leaves))
        levels.append(level)
        roots = wp.empty(level.inner_total, dtype=int, device=device.name)
        if level.inner_total:
            device.launch(k.list_inner, n, [children, nodes, level.inner_start, roots])
    return levels


def _level_starts(levels: list[_Level]) -> tuple[int, ...]:
    """Return the number of the first wide node of each level, and of all nodes."""
    return tuple(itertools.accumulate((level.size for level in levels), initial=0))


def _leaf_count(levels: list[_Level]) -> int:
    """Return the number of leaves."""
    return sum(level.leaf_total for level in levels)


def _write_nodes(levels: list[_Level], nodes: Any, leaf_nodes: int, out: Any, device: Device) -> Any:
    """Write the wide nodes and return the binary node of each leaf.

    Args:
        levels: the wide tree.
        nodes: the binary tree.
        leaf_nodes: the number of the first leaf where leaves are nodes as well; otherwise −1.
        out: wp.array of float to write to.
        device: where all this is.
    """
    import warp as wp

    from wrt.kernels.bvh_collapse import write_nodes

    leaf_roots = wp.empty(_leaf_count(levels), dtype=int, device=device.name)
    first_leaf = 0
    for level, (first_node, first_child) in zip(levels, itertools.pairwise(_level_starts(levels)), strict=True):
        places = [level.inner_start, level.leaf_start, first_node, first_child, first_leaf, leaf_nodes]
        device.launch(write_nodes, level.size, [level.children, nodes, *places, out, _as_int(out), leaf_roots])
        first_leaf += level.leaf_total
    return leaf_roots


def _write(levels: list[_Level], nodes: Any, boxes: Any, points: Any, indices: Any, device: Device) -> BuiltBvh:
    """Return the tree as rays follow it."""
    from wrt.kernels import bvh_collapse as k
    from wrt.kernels.bvh import LEAF_FLOATS, NODE_FLOATS, Bvh

    starts, leaf_count = _level_starts(levels), _leaf_count(levels)
    if max(leaf_count * LEAF_FLOATS, starts[-1] * NODE_FLOATS) >= 2**31:
        raise InputError(f"a ray tree of {leaf_count} leaves is larger than 32-bit offsets reach")
    data = Bvh()
    data.nodes = device.empty_large(starts[-1] * NODE_FLOATS)
    data.leaves = device.empty_large(leaf_count * LEAF_FLOATS)
    leaf_roots = _write_nodes(levels, nodes, -1, data.nodes, device)
    inputs = [leaf_roots, nodes, boxes, points, indices, data.leaves, _as_int(data.leaves)]
    device.launch(k.write_leaves, leaf_count, inputs)
    size = 4 * (len(data.nodes) + len(data.leaves))
    return BuiltBvh(data, starts, leaf_count, len(boxes), size)


def _as_int(array: Any) -> Any:
    """Return the same memory seen as integers."""
    import warp as wp

    return wp.array(ptr=array.ptr, shape=array.shape, dtype=int, device=array.device)


def _scan(inner: Any, leaves: Any) -> tuple[Any, Any, int, int]:
    """Return for both counts the sums before each one, and the sums of all."""
    (inner_start, inner_total), (leaf_start, leaf_total) = _sums_before(inner), _sums_before(leaves)
    return inner_start, leaf_start, inner_total, leaf_total


def _sums_before(counts: Any) -> tuple[Any, int]:
    """Return the sum before each number, and the sum of all."""
    import warp as wp

    start = wp.empty_like(counts)
    wp.utils.array_scan(counts, start, inclusive=False)
    return start, int(start[-1:].numpy()[0] + counts[-1:].numpy()[0])
