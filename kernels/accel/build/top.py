"""The top of the binary tree: nodes over many triangles, each split by several threads.

Level by level, each thread sorts a chunk of a node's triangles into bins of its own, and nodes are split by the bins of
all their chunks. The same kernels do this on the CPU and on a GPU. On the CPU each chunk is then partitioned in its
place, and triangles on the wrong side of their node are swapped; what a GPU does is in `levels.py`.
"""

import warp as wp

from wrt.kernels.accel.build.boxes import centers_of_range, fill_bins, low_of, part_range, swap_ranges, vec8
from wrt.kernels.accel.build.split import LARGE, BinaryNode, Split, add_children, bin_scale, choose_split, set_box
from wrt.kernels.native.constants import BINS

# Unrolled loops take Warp many times as long to compile and run no faster.
wp.set_module_options({"max_unroll": 1})

AXIS_BINS = 3 * BINS
"""Bins of a node."""

_CHUNKS = wp.constant(wp.int64((1 << 32) - 1))


@wp.struct
class Level:
    """The nodes of a level that are split, and their chunks of up to `chunk` boxes, node after node.

    `counts` has for each level the number of its nodes times 2^32, plus the number of its chunks: on a GPU one sum
    hands out both, so that `start`, the first chunk of each node, ascends.
    """

    depth: int
    chunk: int
    counts: wp.array(dtype=wp.int64)
    node: wp.array(dtype=int)
    start: wp.array(dtype=int)
    splits: wp.array(dtype=Split)
    bin_boxes: wp.array(dtype=vec8)
    bin_counts: wp.array(dtype=int)


@wp.struct
class Chunks:
    """The chunks of a level: the place of their node in it, their bins, and how many of their boxes go left.

    On the CPU `centers` bounds the centres on the left and on the right; on a GPU `left_before` sums `left`.
    """

    place: wp.array(dtype=int)
    bin_boxes: wp.array(dtype=vec8)
    bin_counts: wp.array(dtype=int)
    left: wp.array(dtype=int)
    left_before: wp.array(dtype=int)
    centers: wp.array(dtype=vec8)


@wp.func
def nodes_in(counts: wp.int64) -> int:
    """Return the number of nodes in an entry of `Level.counts`."""
    return int(counts >> wp.int64(32))


@wp.func
def chunks_in(counts: wp.int64) -> int:
    """Return the number of chunks in an entry of `Level.counts`."""
    return int(counts & _CHUNKS)


@wp.func
def nodes_of(level: Level) -> int:
    """Return the number of a level's nodes."""
    return nodes_in(level.counts[level.depth])


@wp.func
def chunks_of(level: Level) -> int:
    """Return the number of a level's chunks."""
    return chunks_in(level.counts[level.depth])


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
    before = (chunk - level.start[place]) * level.chunk
    return wp.vec2i(nodes[index].first + before, wp.min(level.chunk, nodes[index].count - before))


@wp.kernel(enable_backward=False)
def fill_chunk_bins(
    first: int,
    level: Level,
    chunks: Chunks,
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
def split_nodes(
    first: int,
    level: Level,
    nodes: wp.array(dtype=BinaryNode),
    centers: wp.array(dtype=vec8),
    max_sah_depth: int,
):
    """Split each node of a level by its bins."""
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
    # Chunks bound the centres on both sides of a plane; halves keep the bounds of the whole node.
    start = vec8(LARGE)
    if split.axis < 0:
        split.left = count // 2
        start = bounds
    add_children(nodes, index, index + 1, index + 2 * split.left, split.left)
    centers[nodes[index].left] = start
    centers[nodes[index].right] = start
    level.splits[i] = split


@wp.kernel(enable_backward=False)
def count_left(first: int, level: Level, chunks: Chunks, nodes: wp.array(dtype=BinaryNode)):
    """Count the boxes of each chunk that go left; 0 for threads beyond the last chunk."""
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


# --- On the CPU --------------------------------------------------------------------------------------


@wp.kernel(enable_backward=False)
def find_centers(first: int, chunk: int, boxes: wp.array(dtype=vec8), centers_out: wp.array(dtype=vec8)):
    """Bound the centres of all boxes, a chunk a thread."""
    c = first + wp.tid()
    centers_out[c] = centers_of_range(boxes, c * chunk, wp.min(chunk, boxes.shape[0] - c * chunk))


@wp.func
def end_of_chunks(level: Level, place: int) -> int:
    """Return the chunk after those of a node."""
    if place + 1 < nodes_of(level):
        return level.start[place + 1]
    return chunks_of(level)


@wp.kernel(enable_backward=False)
def join_chunk_bins(first: int, level: Level, chunks: Chunks):
    """Sum up the bins of each node's chunks, a bin a thread."""
    k = first + wp.tid()
    place = k // wp.static(AXIS_BINS)
    box = vec8(LARGE)
    count = int(0)
    for c in range(level.start[place], end_of_chunks(level, place)):
        of = c * wp.static(AXIS_BINS) + k - place * wp.static(AXIS_BINS)
        box = wp.min(box, chunks.bin_boxes[of])
        count += chunks.bin_counts[of]
    level.bin_boxes[k] = box
    level.bin_counts[k] = count


@wp.kernel(enable_backward=False)
def part_chunks(
    first: int,
    level: Level,
    chunks: Chunks,
    nodes: wp.array(dtype=BinaryNode),
    boxes: wp.array(dtype=vec8),
    centers: wp.array(dtype=vec8),
):
    """Partition each chunk of a node that is split by a plane: boxes that go left come first."""
    c = first + wp.tid()
    place = chunks.place[c]
    split = level.splits[place]
    if split.axis >= 0:
        part = range_of_chunk(level, nodes, place, c)
        bounds = centers[level.node[place]]
        scale = bin_scale(bounds, wp.static(BINS))
        low = low_of(bounds)
        bins = wp.static(BINS)
        part_range(boxes, part[0], part[1], low, scale, bins, split.axis, split.last_left_bin, chunks.centers, 2 * c)


@wp.kernel(enable_backward=False)
def join_centers(
    first: int, level: Level, chunks: Chunks, nodes: wp.array(dtype=BinaryNode), centers_out: wp.array(dtype=vec8)
):
    """Bound the centres of both children of each node that is split by a plane."""
    i = first + wp.tid()
    if level.splits[i].axis >= 0:
        left = vec8(LARGE)
        right = vec8(LARGE)
        for c in range(level.start[i], end_of_chunks(level, i)):
            left = wp.min(left, chunks.centers[2 * c])
            right = wp.min(right, chunks.centers[2 * c + 1])
        centers_out[nodes[level.node[i]].left] = left
        centers_out[nodes[level.node[i]].right] = right


@wp.kernel(enable_backward=False)
def swap_boxes(
    first: int,
    one: wp.array(dtype=int),
    two: wp.array(dtype=int),
    count: wp.array(dtype=int),
    boxes: wp.array(dtype=vec8),
):
    """Swap ranges of boxes, `count` from `one` and from `two`."""
    i = first + wp.tid()
    swap_ranges(boxes, one[i], two[i], count[i])
