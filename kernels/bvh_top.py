"""The top of the binary tree: nodes over so many triangles that many threads share each.

A thread has a chunk of a node's triangles: it sorts them into bins of its own, and once the node's plane
is chosen from all chunks' bins, moves them to their sides in a second array.
"""

import warp as wp

from wrt.kernels.bvh_boxes import low_of
from wrt.kernels.bvh_ranges import BINS, centers_of_range, copy_range, fill_bins, part_range
from wrt.kernels.bvh_split import LARGE, BinaryNode, Split, add_children, bin_scale, choose_split, set_box
from wrt.kernels.simd import vec8

# Loops as they are written: unrolled, they take Warp many times as long to compile and run no faster.
wp.set_module_options({"max_unroll": 1})


@wp.struct
class Chunks:
    """Ranges of the triangles of a level's nodes, node after node.

    `node` is a place in the level, `start` (one more than nodes) where each node's chunks begin;
    `centers` has the bounds of the centres on the left and on the right, `left_at` and `right_at`
    where the two sides go.
    """

    node: wp.array(dtype=int)
    first: wp.array(dtype=int)
    count: wp.array(dtype=int)
    start: wp.array(dtype=int)
    bin_boxes: wp.array(dtype=vec8)
    bin_counts: wp.array(dtype=int)
    centers: wp.array(dtype=vec8)
    left_at: wp.array(dtype=int)
    right_at: wp.array(dtype=int)


@wp.kernel(enable_backward=False)
def find_centers(first: int, chunks: Chunks, boxes: wp.array(dtype=vec8)):
    """Bound the centres of each chunk, whatever its sides."""
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
    """Split each node of a level, and tell its chunks where their two sides go."""
    i = first + wp.tid()
    index = level[i]
    count = nodes[index].count
    start = chunks.start[i]
    end = chunks.start[i + 1]
    scale = bin_scale(centers[index], wp.static(BINS))
    # All bins are joined in the first chunk's, whose own counts are kept by its `left_at`.
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
    left_at = nodes[index].first
    right_at = left_at + split.left
    # From the last chunk on, since the first one's bins hold the sums.
    left_end = right_at
    right_end = left_at + count
    for j in range(end - start):
        c = end - 1 - j
        n = int(0)
        if j == end - start - 1:
            n = left_end - left_at
        elif split.axis >= 0:
            base = c * wp.static(3 * BINS) + split.axis * wp.static(BINS)
            for k in range(split.last_left_bin + 1):
                n += chunks.bin_counts[base + k]
        else:
            n = wp.clamp(right_at - chunks.first[c], 0, chunks.count[c])
        left_end -= n
        right_end -= chunks.count[c] - n
        chunks.left_at[c] = left_end
        chunks.right_at[c] = right_end


@wp.kernel(enable_backward=False)
def part_chunks(
    first: int,
    level: wp.array(dtype=int),
    chunks: Chunks,
    splits: wp.array(dtype=Split),
    centers: wp.array(dtype=vec8),
    boxes: wp.array(dtype=vec8),
    boxes_out: wp.array(dtype=vec8),
):
    """Move the boxes of each chunk to the sides that they belong to."""
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
            boxes_out,
            chunks.left_at[c],
            boxes_out,
            chunks.right_at[c],
            chunks.centers,
            2 * c,
        )
    else:
        copy_range(boxes, chunks.first[c], chunks.count[c], boxes_out, chunks.first[c])
        chunks.centers[2 * c] = bounds
        chunks.centers[2 * c + 1] = bounds


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
