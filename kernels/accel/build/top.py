"""The top of the binary tree: nodes over so many triangles that several threads share each.

Each thread sorts a chunk of a node's triangles into its own bins, then partitions the chunk by the plane chosen from
the bins of all chunks. Then triangles on the wrong side of the node are swapped.
"""

import warp as wp

from wrt.kernels.accel.build.boxes import low_of, vec8
from wrt.kernels.accel.build.ranges import centers_of_range, fill_bins, part_range, swap_ranges
from wrt.kernels.accel.build.split import LARGE, BinaryNode, Split, add_children, bin_scale, choose_split, set_box
from wrt.kernels.native.constants import BINS

# Unrolled loops take Warp many times as long to compile and run no faster.
wp.set_module_options({"max_unroll": 1})


@wp.struct
class Chunks:
    """Chunks of the boxes of a level's nodes, node after node.

    `node` is a place in the level; `start` (one entry more than nodes) has each node's first chunk; `centers` bounds
    the centres on the left and on the right; `left` counts the boxes on the left.
    """

    node: wp.array(dtype=int)
    first: wp.array(dtype=int)
    count: wp.array(dtype=int)
    start: wp.array(dtype=int)
    bin_boxes: wp.array(dtype=vec8)
    bin_counts: wp.array(dtype=int)
    centers: wp.array(dtype=vec8)
    left: wp.array(dtype=int)


@wp.kernel(enable_backward=False)
def find_centers(first: int, chunks: Chunks, boxes: wp.array(dtype=vec8)):
    """Bound the centres of each chunk."""
    c = first + wp.tid()
    chunks.centers[2 * c] = centers_of_range(boxes, chunks.first[c], chunks.count[c])
    chunks.centers[2 * c + 1] = vec8(LARGE)


@wp.kernel(enable_backward=False)
def fill_chunk_bins(
    first: int,
    level: wp.array(dtype=int),
    chunks: Chunks,
    boxes: wp.array(dtype=vec8),
    centers: wp.array(dtype=vec8),
):
    """Sort the boxes of each chunk into the bins of its node."""
    c = first + wp.tid()
    bounds = centers[level[chunks.node[c]]]
    low = low_of(bounds)
    scale = bin_scale(bounds, wp.static(BINS))
    scratch = c * wp.static(3 * BINS)
    fill_bins(
        boxes,
        chunks.first[c],
        chunks.count[c],
        low,
        scale,
        wp.static(BINS),
        chunks.bin_boxes,
        chunks.bin_counts,
        scratch,
    )


@wp.kernel(enable_backward=False)
def split_level(
    first: int,
    level: wp.array(dtype=int),
    chunks: Chunks,
    nodes: wp.array(dtype=BinaryNode),
    centers: wp.array(dtype=vec8),
    max_sah_depth: int,
    splits_out: wp.array(dtype=Split),
):
    """Split each node of a level, and count the boxes of its chunks that go left."""
    i = first + wp.tid()
    index = level[i]
    count = nodes[index].count
    start = chunks.start[i]
    end = chunks.start[i + 1]
    scale = bin_scale(centers[index], wp.static(BINS))
    # The first chunk's bins collect the sums of all.
    bins = start * wp.static(3 * BINS)
    for c in range(start + 1, end):
        for k in range(wp.static(3 * BINS)):
            of = c * wp.static(3 * BINS) + k
            chunks.bin_boxes[bins + k] = wp.min(chunks.bin_boxes[bins + k], chunks.bin_boxes[of])
            chunks.bin_counts[bins + k] = chunks.bin_counts[bins + k] + chunks.bin_counts[of]
    split = choose_split(chunks.bin_boxes, chunks.bin_counts, bins, wp.static(BINS), count, scale)
    set_box(nodes, index, split.bounds)
    if nodes[index].depth >= max_sah_depth:
        split.axis = -1
    if split.axis < 0:
        split.left = count // 2
    add_children(nodes, index, index + 1, index + 2 * split.left, split.left)
    splits_out[i] = split
    # The first chunk gets what the others leave, since its bins hold the sums.
    rest = split.left
    for c in range(start + 1, end):
        n = int(0)
        if split.axis >= 0:
            base = c * wp.static(3 * BINS) + split.axis * wp.static(BINS)
            for k in range(split.last_left_bin + 1):
                n += chunks.bin_counts[base + k]
        else:
            n = wp.clamp(nodes[index].first + split.left - chunks.first[c], 0, chunks.count[c])
        chunks.left[c] = n
        rest -= n
    chunks.left[start] = rest


@wp.kernel(enable_backward=False)
def part_chunks(
    first: int,
    level: wp.array(dtype=int),
    chunks: Chunks,
    splits: wp.array(dtype=Split),
    centers: wp.array(dtype=vec8),
    boxes: wp.array(dtype=vec8),
):
    """Partition each chunk: boxes that go left come first."""
    c = first + wp.tid()
    split = splits[chunks.node[c]]
    bounds = centers[level[chunks.node[c]]]
    if split.axis >= 0:
        low = low_of(bounds)
        part_range(
            boxes,
            chunks.first[c],
            chunks.count[c],
            low,
            bin_scale(bounds, wp.static(BINS)),
            wp.static(BINS),
            split.axis,
            split.last_left_bin,
            chunks.centers,
            2 * c,
        )
    else:
        chunks.centers[2 * c] = bounds
        chunks.centers[2 * c + 1] = bounds


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


@wp.kernel(enable_backward=False)
def join_centers(
    first: int,
    level: wp.array(dtype=int),
    chunks: Chunks,
    nodes: wp.array(dtype=BinaryNode),
    centers_out: wp.array(dtype=vec8),
):
    """Bound the centres of both children of each node of a level."""
    i = first + wp.tid()
    left = vec8(LARGE)
    right = vec8(LARGE)
    for c in range(chunks.start[i], chunks.start[i + 1]):
        left = wp.min(left, chunks.centers[2 * c])
        right = wp.min(right, chunks.centers[2 * c + 1])
    centers_out[nodes[level[i]].left] = left
    centers_out[nodes[level[i]].right] = right
