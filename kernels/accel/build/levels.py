"""The top of the binary tree on a GPU: what `top.py` does on the CPU, with all counters on the device.

The host does not wait to learn how many nodes a level has: it launches threads for the most that it can have, and
threads without work end. Bins and bounds of chunks are joined by atomic minima and sums, which give the same result in
any order, so a tree is the same each time.
"""

import warp as wp

from wrt.kernels.accel.build.boxes import centers_of_range, low_of, vec8
from wrt.kernels.accel.build.split import LARGE, BinaryNode, bin_scale, build_subtree
from wrt.kernels.accel.build.top import (
    AXIS_BINS,
    Chunks,
    Level,
    chunks_in,
    chunks_of,
    nodes_in,
    nodes_of,
    range_of_chunk,
)
from wrt.kernels.native.constants import BINS

# Unrolled loops take Warp many times as long to compile and run no faster.
wp.set_module_options({"max_unroll": 1})

SUBTREE = 128
"""One thread builds subtrees of up to this many boxes; not measured on a GPU."""

CHUNK = 256
"""Boxes of a larger node that one thread sorts into bins; not measured on a GPU."""

_NODE = wp.constant(wp.int64(1 << 32))


@wp.func
def enlist(
    index: int,
    count: int,
    level: Level,
    depth: int,
    roots: wp.array(dtype=int),
    root_count: wp.array(dtype=int),
):
    """Add a node to a level, or to the roots of subtrees that one thread builds."""
    if count > wp.static(SUBTREE):
        pieces = wp.int64((count + level.chunk - 1) // level.chunk)
        before = wp.atomic_add(level.counts, depth, _NODE + pieces)
        place = nodes_in(before)
        level.node[place] = index
        level.start[place] = chunks_in(before)
    else:
        roots[wp.atomic_add(root_count, 0, 1)] = index


@wp.kernel(enable_backward=False)
def begin_tree(
    first: int,
    count: int,
    nodes: wp.array(dtype=BinaryNode),
    centers_out: wp.array(dtype=vec8),
    level: Level,
    roots: wp.array(dtype=int),
    root_count: wp.array(dtype=int),
):
    """Make the root of a tree over `count` boxes, in one thread."""
    nodes[0].count = count
    centers_out[0] = vec8(LARGE)
    enlist(0, count, level, 0, roots, root_count)


@wp.kernel(enable_backward=False)
def bound_centers(first: int, chunk: int, boxes: wp.array(dtype=vec8), centers: wp.array(dtype=vec8)):
    """Bound the centres of all boxes, a chunk a thread."""
    begin = (first + wp.tid()) * chunk
    bounds = centers_of_range(boxes, begin, wp.min(chunk, boxes.shape[0] - begin))
    wp.atomic_min(centers, 0, bounds)


@wp.kernel(enable_backward=False)
def clear_bins(first: int, level: Level):
    """Empty the bins of a level's nodes, a bin a thread."""
    k = first + wp.tid()
    if k < nodes_of(level) * wp.static(AXIS_BINS):
        level.bin_boxes[k] = vec8(LARGE)
        level.bin_counts[k] = 0


@wp.kernel(enable_backward=False)
def join_bins(first: int, level: Level, chunks: Chunks):
    """Add the bins of chunks to those of their nodes, a bin a thread."""
    k = first + wp.tid()
    c = k // wp.static(AXIS_BINS)
    if c >= chunks_of(level):
        return
    count = chunks.bin_counts[k]
    if count > 0:
        of = chunks.place[c] * wp.static(AXIS_BINS) + k - c * wp.static(AXIS_BINS)
        wp.atomic_add(level.bin_counts, of, count)
        wp.atomic_min(level.bin_boxes, of, chunks.bin_boxes[k])


@wp.kernel(enable_backward=False)
def part_boxes(
    first: int,
    level: Level,
    chunks: Chunks,
    nodes: wp.array(dtype=BinaryNode),
    boxes: wp.array(dtype=vec8),
    centers: wp.array(dtype=vec8),
    boxes_out: wp.array(dtype=vec8),
):
    """Move the boxes of each chunk to the left or the right side of their node, in the same order."""
    c = first + wp.tid()
    if c >= chunks_of(level):
        return
    place = chunks.place[c]
    index = level.node[place]
    split = level.splits[place]
    part = range_of_chunk(level, nodes, place, c)
    bounds = centers[index]
    low = low_of(bounds)
    scale = bin_scale(bounds, wp.static(BINS))
    before = chunks.left_before[c] - chunks.left_before[level.start[place]]
    left = nodes[index].first + before
    right = nodes[index].first + split.left + (part[0] - nodes[index].first) - before
    last_left = left + chunks.left[c]
    left_bounds = vec8(LARGE)
    right_bounds = vec8(LARGE)
    for k in range(part[0], part[0] + part[1]):
        box = boxes[k]
        goes_left = left < last_left
        if split.axis >= 0:
            axis = split.axis
            center = centers_of_range(boxes, k, 1)
            bin = wp.min(int((center[axis] - low[axis]) * scale[axis]), wp.static(BINS - 1))
            goes_left = bin <= split.last_left_bin
            if goes_left:
                left_bounds = wp.min(left_bounds, center)
            else:
                right_bounds = wp.min(right_bounds, center)
        if goes_left:
            boxes_out[left] = box
            left += 1
        else:
            boxes_out[right] = box
            right += 1
    if split.axis >= 0:
        wp.atomic_min(centers, nodes[index].left, left_bounds)
        wp.atomic_min(centers, nodes[index].right, right_bounds)


@wp.kernel(enable_backward=False)
def copy_boxes(
    first: int,
    level: Level,
    chunks: Chunks,
    nodes: wp.array(dtype=BinaryNode),
    boxes: wp.array(dtype=vec8),
    boxes_out: wp.array(dtype=vec8),
):
    """Copy the boxes of a level's nodes, a chunk a thread."""
    c = first + wp.tid()
    if c >= chunks_of(level):
        return
    part = range_of_chunk(level, nodes, chunks.place[c], c)
    for k in range(part[0], part[0] + part[1]):
        boxes_out[k] = boxes[k]


@wp.kernel(enable_backward=False)
def list_level(
    first: int,
    level: Level,
    next_level: Level,
    nodes: wp.array(dtype=BinaryNode),
    roots: wp.array(dtype=int),
    root_count: wp.array(dtype=int),
):
    """Add the children of a level's nodes to the next level, or to the roots of subtrees."""
    i = first + wp.tid()
    if i >= nodes_of(level):
        return
    index = level.node[i]
    left = nodes[index].left
    right = nodes[index].right
    enlist(left, nodes[left].count, next_level, next_level.depth, roots, root_count)
    enlist(right, nodes[right].count, next_level, next_level.depth, roots, root_count)


@wp.kernel(enable_backward=False)
def build_listed(
    first: int,
    threads: int,
    roots: wp.array(dtype=int),
    root_count: wp.array(dtype=int),
    nodes: wp.array(dtype=BinaryNode),
    boxes: wp.array(dtype=vec8),
    centers: wp.array(dtype=vec8),
    bin_boxes: wp.array(dtype=vec8),
    bin_counts: wp.array(dtype=int),
    max_sah_depth: int,
):
    """Build the subtrees below the listed nodes, one after the other in each of the threads."""
    i = first + wp.tid()
    scratch = i * wp.static(AXIS_BINS)
    for k in range(i, root_count[0], threads):
        build_subtree(roots[k], nodes, boxes, centers, bin_boxes, bin_counts, scratch, max_sah_depth)
