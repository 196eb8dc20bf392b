"""The binary tree, built by binned surface-area splits; the wide tree is made from it.

Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies" (2007). Nodes over many triangles are split level
by level, each by many threads (`kernels/accel/build/top.py`); below that a thread builds whole subtrees, whose boxes
stay in its cache. A subtree over n triangles has at most 2n − 1 nodes and owns as many places in the array, so the
number of threads does not change the tree. On a GPU `levels.py` splits the large nodes.
"""

import warp as wp

from wrt.kernels.accel.build.boxes import (
    bounds_of_range,
    box_around,
    corners_of,
    fill_bins,
    half_area,
    high_of,
    low_of,
    part_range,
    vec8,
)
from wrt.kernels.native.constants import BINS, LEAF_SIZE

# Unrolled loops take Warp many times as long to compile and run no faster.
wp.set_module_options({"max_unroll": 1})

FEW_BINS = 8
"""Bins of nodes over few triangles, where sweeping the bins costs more than filling them."""

LARGE = wp.constant(3.0e38)
_FEW_TRIANGLES = wp.constant(64)
_task_stack = wp.types.vector(length=64, dtype=int)
_bin_costs = wp.types.vector(length=BINS, dtype=float)


@wp.struct
class BinaryNode:
    """A node of the binary tree over `count` boxes from `first`; a leaf if `right` is 0.

    `choices` encodes the collapse: for each number of roots j from 2 to 8, three bits give the left child's share, 0
    for "as with one root fewer".
    """

    lower: wp.vec3
    first: int
    upper: wp.vec3
    count: int
    left: int
    right: int
    choices: int
    depth: int


@wp.struct
class Split:
    """A plane between two bins along an axis, −1 for none, and the box around all bins."""

    axis: int
    last_left_bin: int
    left: int
    bounds: vec8


@wp.kernel(enable_backward=False)
def make_boxes(first: int, points: wp.array(dtype=wp.vec3), indices: wp.array(dtype=int), boxes: wp.array(dtype=vec8)):
    """Write each triangle's box."""
    i = first + wp.tid()
    boxes[i] = box_around(corners_of(points, indices, i), i)


@wp.func
def leaf_blocks(count: int) -> float:
    """Return the number of full leaves that `count` triangles take."""
    return float((count + wp.static(LEAF_SIZE - 1)) // wp.static(LEAF_SIZE))


@wp.func
def bin_scale(centers: vec8, bins: int) -> wp.vec3:
    """Return the factor from the distance to the least centre to a bin; 0 along axes without extent."""
    scale = wp.vec3(0.0)
    for axis in range(3):
        extent = -centers[axis + 4] - centers[axis]
        if extent > 0.0:
            scale[axis] = float(bins) * 0.9999 / extent
    return scale


@wp.func
def choose_split(
    bin_boxes: wp.array(dtype=vec8),
    bin_counts: wp.array(dtype=int),
    scratch: int,
    bins: int,
    count: int,
    scale: wp.vec3,
) -> Split:
    """Return the cheapest plane between bins by surface area."""
    split = Split()
    split.axis = -1
    split.bounds = vec8(LARGE)
    for k in range(bins):
        split.bounds = wp.min(split.bounds, bin_boxes[scratch + k])
    best_cost = float(LARGE)
    for axis in range(3):
        if scale[axis] > 0.0:
            # Costs of the right sides, swept from the end, then of the left sides, from the start.
            base = scratch + axis * wp.static(BINS)
            side = vec8(LARGE)
            n = int(0)
            costs = _bin_costs()
            for j in range(bins - 1):
                k = bins - 1 - j
                side = wp.min(side, bin_boxes[base + k])
                n += bin_counts[base + k]
                costs[k] = wp.where(n > 0, half_area(high_of(side) - low_of(side)) * leaf_blocks(n), LARGE)
            side = vec8(LARGE)
            n = int(0)
            for k in range(bins - 1):
                side = wp.min(side, bin_boxes[base + k])
                n += bin_counts[base + k]
                if n > 0 and n < count:
                    cost = half_area(high_of(side) - low_of(side)) * leaf_blocks(n) + costs[k + 1]
                    if cost < best_cost:
                        best_cost = cost
                        split.axis = axis
                        split.last_left_bin = k
                        split.left = n
    return split


@wp.func
def set_box(nodes: wp.array(dtype=BinaryNode), index: int, bounds: vec8):
    """Set a node's box."""
    nodes[index].lower = low_of(bounds)
    nodes[index].upper = high_of(bounds)


@wp.func
def add_children(nodes: wp.array(dtype=BinaryNode), index: int, left: int, right: int, left_count: int):
    """Give a node two children: the first `left_count` of its boxes, and the rest."""
    first = nodes[index].first
    count = nodes[index].count
    depth = nodes[index].depth + 1
    nodes[index].left = left
    nodes[index].right = right
    nodes[left].first = first
    nodes[left].count = left_count
    nodes[left].depth = depth
    nodes[left].right = 0
    nodes[right].first = first + left_count
    nodes[right].count = count - left_count
    nodes[right].depth = depth
    nodes[right].right = 0


@wp.func
def split_node(
    nodes: wp.array(dtype=BinaryNode),
    index: int,
    children: int,
    boxes: wp.array(dtype=vec8),
    centers: wp.array(dtype=vec8),
    bin_boxes: wp.array(dtype=vec8),
    bin_counts: wp.array(dtype=int),
    scratch: int,
    max_sah_depth: int,
):
    """Set a node's box and, if it exceeds the size of a leaf, split its boxes between `children` and the next node.

    Surface-area splits may be lopsided. From depth `max_sah_depth` on boxes are halved, so no binary tree is deeper
    than that plus log2 of its boxes.
    """
    first = nodes[index].first
    count = nodes[index].count
    if count <= wp.static(LEAF_SIZE):
        set_box(nodes, index, bounds_of_range(boxes, first, count))
        return
    bounds = centers[index]
    low = low_of(bounds)
    bins = wp.where(count <= _FEW_TRIANGLES, wp.static(FEW_BINS), wp.static(BINS))
    scale = bin_scale(bounds, bins)
    fill_bins(boxes, first, count, low, scale, bins, bin_boxes, bin_counts, scratch)
    split = choose_split(bin_boxes, bin_counts, scratch, bins, count, scale)
    set_box(nodes, index, split.bounds)
    if split.axis >= 0 and nodes[index].depth < max_sah_depth:
        part_range(boxes, first, count, low, scale, bins, split.axis, split.last_left_bin, centers, children)
    else:
        split.left = count // 2
        centers[children] = bounds
        centers[children + 1] = bounds
    add_children(nodes, index, children, children + 1, split.left)


@wp.func
def build_subtree(
    root: int,
    nodes: wp.array(dtype=BinaryNode),
    boxes: wp.array(dtype=vec8),
    centers: wp.array(dtype=vec8),
    bin_boxes: wp.array(dtype=vec8),
    bin_counts: wp.array(dtype=int),
    scratch: int,
    max_sah_depth: int,
):
    """Build the subtree below a node."""
    stack = _task_stack()
    stack[0] = root
    top = int(1)
    free = root + 1
    while top > 0:
        top -= 1
        index = stack[top]
        split_node(nodes, index, free, boxes, centers, bin_boxes, bin_counts, scratch, max_sah_depth)
        if nodes[index].right != 0:
            # The larger child waits, so the stack never exceeds log2 of the triangles.
            small = free
            large = free + 1
            if nodes[small].count > nodes[large].count:
                small = free + 1
                large = free
            stack[top] = large
            stack[top + 1] = small
            top += 2
            free += 2


@wp.kernel(enable_backward=False)
def build_subtrees(
    first: int,
    roots: wp.array(dtype=int),
    nodes: wp.array(dtype=BinaryNode),
    boxes: wp.array(dtype=vec8),
    centers: wp.array(dtype=vec8),
    bin_boxes: wp.array(dtype=vec8),
    bin_counts: wp.array(dtype=int),
    max_sah_depth: int,
):
    """Build the subtrees below the listed nodes."""
    i = first + wp.tid()
    build_subtree(roots[i], nodes, boxes, centers, bin_boxes, bin_counts, i * wp.static(3 * BINS), max_sah_depth)
