"""The top of the binary tree on a GPU: splits level by level, with all counters on the device.

The splits are those of `kernels/accel/build/top.py`, in the same bins. But the host does not wait to learn how many
nodes a level has: it launches as many threads as there may be, and those without work end. Bins and bounds of chunks
are joined by atomic minima and sums, which give the same result in any order, so a tree is the same each time.
"""

import warp as wp

from wrt.kernels.accel.build.boxes import low_of, vec8
from wrt.kernels.accel.build.ranges import centers_of_range, fill_bins
from wrt.kernels.accel.build.split import (
    LARGE,
    BinaryNode,
    Split,
    add_children,
    bin_scale,
    build_subtree,
    choose_split,
    set_box,
)
from wrt.kernels.native.constants import BINS

# Unrolled loops take Warp many times as long to compile and run no faster.
wp.set_module_options({"max_unroll": 1})

SUBTREE = 128
"""One thread builds subtrees of up to this many boxes; not measured on a GPU."""

CHUNK = 256
"""Boxes of a larger node that one thread sorts into bins; not measured on a GPU."""

AXIS_BINS = 3 * BINS
"""Bins of a node."""

_NODE = wp.constant(wp.int64(1 << 32))
_CHUNKS = wp.constant(wp.int64((1 << 32) - 1))


@wp.struct
class Level:
    """The nodes of a level that are split, and their chunks.

    `counts` has for each level the number of its nodes times 2^32, plus the number of its chunks: one sum hands out
    both, so that `start`, the first chunk of each node, ascends.
    """

    depth: int
    counts: wp.array(dtype=wp.int64)
    node: wp.array(dtype=int)
    start: wp.array(dtype=int)
    splits: wp.array(dtype=Split)
    bin_boxes: wp.array(dtype=vec8)
    bin_counts: wp.array(dtype=int)


@wp.struct
class LevelChunks:
    """The chunks of a level: the place of their node in it, their bins, and how many of their boxes go left."""

    place: wp.array(dtype=int)
    bin_boxes: wp.array(dtype=vec8)
    bin_counts: wp.array(dtype=int)
    left: wp.array(dtype=int)
    left_before: wp.array(dtype=int)


@wp.func
def nodes_of(level: Level) -> int:
    """Return the number of a level's nodes."""
    return int(level.counts[level.depth] >> wp.int64(32))


@wp.func
def chunks_of(level: Level) -> int:
    """Return the number of a level's chunks."""
    return int(level.counts[level.depth] & _CHUNKS)


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
        pieces = wp.int64((count + wp.static(CHUNK - 1)) // wp.static(CHUNK))
        before = wp.atomic_add(level.counts, depth, _NODE + pieces)
        place = int(before >> wp.int64(32))
        level.node[place] = index
        level.start[place] = int(before & _CHUNKS)
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
def bound_centers(first: int, boxes: wp.array(dtype=vec8), centers: wp.array(dtype=vec8)):
    """Bound the centres of all boxes, a chunk a thread."""
    begin = (first + wp.tid()) * wp.static(CHUNK)
    bounds = centers_of_range(boxes, begin, wp.min(wp.static(CHUNK), boxes.shape[0] - begin))
    wp.atomic_min(centers, 0, bounds)


@wp.kernel(enable_backward=False)
def clear_bins(first: int, level: Level):
    """Empty the bins of a level's nodes, a bin a thread."""
    k = first + wp.tid()
    if k < nodes_of(level) * wp.static(AXIS_BINS):
        level.bin_boxes[k] = vec8(LARGE)
        level.bin_counts[k] = 0


@wp.func
def place_of_chunk(level: Level, chunk: int) -> int:
    """Return the place in the level of a chunk's node."""
    low = int(0)
    high = nodes_of(level)
    while high - low > 1:
        middle = (low + high) // 2
        if level.start[middle] <= chunk:
            low = middle
        else:
            high = middle
    return low


@wp.func
def range_of_chunk(level: Level, nodes: wp.array(dtype=BinaryNode), place: int, chunk: int) -> wp.vec2i:
    """Return the first box of a chunk, and the number of its boxes."""
    index = level.node[place]
    before = (chunk - level.start[place]) * wp.static(CHUNK)
    return wp.vec2i(nodes[index].first + before, wp.min(wp.static(CHUNK), nodes[index].count - before))


@wp.kernel(enable_backward=False)
def fill_level_bins(
    first: int,
    level: Level,
    chunks: LevelChunks,
    nodes: wp.array(dtype=BinaryNode),
    boxes: wp.array(dtype=vec8),
    centers: wp.array(dtype=vec8),
):
    """Sort the boxes of each chunk into bins of its own."""
    c = first + wp.tid()
    if c >= chunks_of(level):
        return
    place = place_of_chunk(level, c)
    chunks.place[c] = place
    bounds = centers[level.node[place]]
    low = low_of(bounds)
    scale = bin_scale(bounds, wp.static(BINS))
    part = range_of_chunk(level, nodes, place, c)
    scratch = c * wp.static(AXIS_BINS)
    fill_bins(boxes, part[0], part[1], low, scale, wp.static(BINS), chunks.bin_boxes, chunks.bin_counts, scratch)


@wp.kernel(enable_backward=False)
def join_bins(first: int, level: Level, chunks: LevelChunks):
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
def split_nodes(
    first: int,
    level: Level,
    nodes: wp.array(dtype=BinaryNode),
    centers: wp.array(dtype=vec8),
    max_sah_depth: int,
):
    """Split each node of a level."""
    i = first + wp.tid()
    if i >= nodes_of(level):
        return
    index = level.node[i]
    count = nodes[index].count
    bounds = centers[index]
    bins = i * wp.static(AXIS_BINS)
    scale = bin_scale(bounds, wp.static(BINS))
    split = choose_split(level.bin_boxes, level.bin_counts, bins, wp.static(BINS), count, scale)
    set_box(nodes, index, split.bounds)
    if nodes[index].depth >= max_sah_depth:
        split.axis = -1
    # Chunks join the bounds of those that go left and right; halves have those of all.
    start = vec8(LARGE)
    if split.axis < 0:
        split.left = count // 2
        start = bounds
    add_children(nodes, index, index + 1, index + 2 * split.left, split.left)
    centers[nodes[index].left] = start
    centers[nodes[index].right] = start
    level.splits[i] = split


@wp.kernel(enable_backward=False)
def count_left(first: int, level: Level, chunks: LevelChunks, nodes: wp.array(dtype=BinaryNode)):
    """Count the boxes of each chunk that go left; none for chunks that there are not."""
    c = first + wp.tid()
    n = int(0)
    if c < chunks_of(level):
        place = chunks.place[c]
        split = level.splits[place]
        if split.axis >= 0:
            base = c * wp.static(AXIS_BINS) + split.axis * wp.static(BINS)
            for k in range(split.last_left_bin + 1):
                n += chunks.bin_counts[base + k]
        else:
            part = range_of_chunk(level, nodes, place, c)
            n = wp.clamp(nodes[level.node[place]].first + split.left - part[0], 0, part[1])
    chunks.left[c] = n


@wp.kernel(enable_backward=False)
def part_boxes(
    first: int,
    level: Level,
    chunks: LevelChunks,
    nodes: wp.array(dtype=BinaryNode),
    boxes: wp.array(dtype=vec8),
    centers: wp.array(dtype=vec8),
    boxes_out: wp.array(dtype=vec8),
):
    """Write the boxes of each chunk to the side of their node that they go to, in their order."""
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
    chunks: LevelChunks,
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
