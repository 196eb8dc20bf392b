"""Building the ray tree on a device: the host's side of the other kernels in `kernels/bvh_*.py`."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrt.build.binary_tree import split_boxes
from wrt.device import Device
from wrt.errors import InputError

SAH_DEPTHS = (48, 8)
"""Depths of the binary tree down to which it is split by surface area, tried in this order. At the
last one, where no node is moved either, the tree is at most 8 + 23 levels deep, for 2^26 triangles eight a leaf: rays
can follow."""

MORE_PIECES = 0.2
"""Boxes that cutting large triangles may add, over the number of triangles; measured in docs/performance.md."""

WORTH_CUTTING = 0.9
"""What a tree over pieces may cost, over the cost of one over whole triangles, to be taken instead."""

FEW_CUT = 4
"""Where less than one of so many triangles is cut, those alone tell whether a tree over pieces is tried: in a studio
around a scan it would take as long as the first."""


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

    from wrt.kernels import bvh_collapse as k
    from wrt.kernels.bvh import LEAF_FLOATS, MAX_DEPTH, NODE_FLOATS, Bvh

    tree = _wide_tree(_boxes(points, indices, device), device, MAX_DEPTH)
    pieces = _cut_triangles(points, indices, tree, device)
    if pieces is not None:
        other = _wide_tree(pieces, device, MAX_DEPTH)
        if other.price < WORTH_CUTTING * tree.price:
            tree = other
        del pieces, other
    starts, leaf_count, references = _level_starts(tree.levels), _leaf_count(tree.levels), len(tree.boxes)
    if max(leaf_count * LEAF_FLOATS, starts[-1] * NODE_FLOATS) >= 2**31:
        raise InputError(f"a ray tree of {leaf_count} leaves is larger than 32-bit offsets reach")
    data = Bvh()
    data.nodes = device.empty_large(starts[-1] * NODE_FLOATS)
    leaf_ranges = _write_nodes(tree, -1, data.nodes, device)
    numbers = device.empty_large(references, int)
    device.launch(k.list_numbers, references, [tree.boxes, numbers])
    del tree  # as large as the leaves, which take its place
    data.leaves = device.empty_large(leaf_count * LEAF_FLOATS)
    device.launch(
        k.write_leaves, leaf_count, [leaf_ranges, numbers, points, indices, data.leaves, _as_int(data.leaves)]
    )
    return BuiltBvh(data, starts, leaf_count, references, 4 * (len(data.nodes) + len(data.leaves)))


def kernels_of_building() -> list[Any]:
    """Return a kernel of each module that building a tree takes, in the order in which it does."""
    from wrt.kernels import bvh_collapse, bvh_presplit, bvh_reinsert, bvh_split, bvh_top

    return [
        bvh_split.make_boxes,
        bvh_top.find_centers,
        bvh_reinsert.find_places,
        bvh_collapse.price_nodes,
        bvh_presplit.find_importance,
    ]


def _boxes(points: Any, indices: Any, device: Device) -> Any:
    """Return the boxes of triangles."""
    from wrt.kernels.bvh_split import make_boxes
    from wrt.kernels.simd import vec8

    count = len(indices) // 3
    boxes = device.empty_large(count, vec8)
    device.launch(make_boxes, count, [points, indices, boxes])
    return boxes


def _cut_triangles(points: Any, indices: Any, tree: _Tree, device: Device) -> Any:
    """Return the boxes of triangles of which the most wasteful are cut, or None where that is of no use.

    Args:
        points: as for `build_bvh`.
        indices: likewise.
        tree: over whole triangles.
        device: where to build.
    """
    import warp as wp

    from wrt.kernels import bvh_presplit as k

    count, root = len(indices) // 3, tree.nodes[:1].numpy()[0]
    low = root["lower"]
    with np.errstate(over="ignore"):
        size = np.maximum(root["upper"] - low, np.float32(1e-30))
    if not np.isfinite(size).all():
        return None
    scene = [wp.vec3(*low.tolist()), wp.vec3(*size.tolist())]
    importance = device.empty_large(count)
    device.launch(k.find_importance, count, [points, indices, *scene, importance])
    # So the pieces are at most as many as MORE_PIECES says, and of like triangles none is cut.
    total = float(importance.numpy().sum(dtype=np.float64))
    if not 0.0 < total < np.inf:
        return None
    pieces = device.empty_large(count, int)
    device.launch(k.count_pieces, count, [importance, MORE_PIECES * count / total, pieces])
    del importance  # what follows may be large
    cut = np.flatnonzero(pieces.numpy() > 1)
    if not len(cut) or count + int(pieces.numpy()[cut].sum()) - len(cut) >= 2**26:
        return None
    if FEW_CUT * len(cut) < count and not _worth_cutting(points, indices, scene, pieces, cut, device):
        return None
    return _pieces(points, indices, scene, pieces, device)


def _pieces(points: Any, indices: Any, scene: list[Any], pieces: Any, device: Device) -> Any:
    """Return the boxes of triangles that are cut into so many pieces."""
    from wrt.kernels.bvh_presplit import write_pieces
    from wrt.kernels.simd import vec8

    start, total = _sums_before(pieces)
    boxes = device.empty_large(total, vec8)
    device.launch(write_pieces, len(pieces), [points, indices, *scene, start, pieces, boxes])
    return boxes


def _worth_cutting(
    points: Any, indices: Any, scene: list[Any], pieces: Any, cut: NDArray[np.intp], device: Device
) -> bool:
    """Return whether cutting the triangles of these numbers pays among themselves: a guess at what it does for all."""
    import warp as wp

    from wrt.kernels.bvh import MAX_DEPTH
    from wrt.kernels.bvh_presplit import pick_corners

    corners = wp.empty(3 * len(cut), dtype=int, device=device.name)
    device.launch(pick_corners, len(cut), [indices, wp.array(cut, dtype=int, device=device.name), corners])
    some = wp.array(pieces.numpy()[cut], dtype=int, device=device.name)
    whole = _wide_tree(_boxes(points, corners, device), device, MAX_DEPTH)
    parted = _wide_tree(_pieces(points, corners, scene, some, device), device, MAX_DEPTH)
    return parted.price < WORTH_CUTTING * whole.price


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
    tree = _wide_tree(boxes, device, MAX_DEPTH - 1)
    leaf_nodes = _level_starts(tree.levels)[-1]
    out = device.empty_large((leaf_nodes + _leaf_count(tree.levels)) * NODE_FLOATS)
    leaf_ranges = _write_nodes(tree, leaf_nodes, out, device)
    device.launch(k.write_leaf_nodes, len(leaf_ranges), [leaf_ranges, boxes, leaf_nodes, out, _as_int(out)])
    return out


class _Tree(NamedTuple):
    """A wide tree by levels, the binary tree below it, its boxes in order, and what a ray through it pays for tests."""

    levels: list[_Level]
    nodes: Any
    boxes: Any
    price: float


def _wide_tree(boxes: Any, device: Device, max_depth: int) -> _Tree:
    """Return the wide tree over boxes, which are put in its order."""
    for sah_depth in SAH_DEPTHS:
        nodes, price = split_boxes(boxes, device, sah_depth, reinserts=sah_depth == SAH_DEPTHS[0])
        levels = _levels(nodes, device, max_depth)
        if len(levels) <= max_depth:
            break
    return _Tree(levels, nodes, boxes, price)


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


def _write_nodes(tree: _Tree, leaf_nodes: int, out: Any, device: Device) -> Any:
    """Write the wide nodes and return for each leaf its first box and their number, as vec2i.

    Args:
        tree: the tree.
        leaf_nodes: the number of the first leaf where leaves are nodes as well; otherwise −1.
        out: wp.array of float to write to.
        device: where all this is.
    """
    import warp as wp

    from wrt.kernels.bvh_collapse import write_nodes

    levels, nodes = tree.levels, tree.nodes
    leaf_ranges = wp.empty(_leaf_count(levels), dtype=wp.vec2i, device=device.name)
    first_leaf = 0
    for level, (first_node, first_child) in zip(levels, itertools.pairwise(_level_starts(levels)), strict=True):
        places = [level.inner_start, level.leaf_start, first_node, first_child, first_leaf, leaf_nodes]
        device.launch(write_nodes, level.size, [level.children, nodes, *places, out, _as_int(out), leaf_ranges])
        first_leaf += level.leaf_total
    return leaf_ranges


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
