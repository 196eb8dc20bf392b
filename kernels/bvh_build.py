"""Building the tree: binned surface-area splits, then the cheapest collapse to eight-wide nodes.

Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies" (2007); Ylitie, Karras and
Laine, "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs" (2017), section 3.

A binary tree comes first. Nodes over many triangles are split level by level, each by many threads: a
thread has a chunk of a node's triangles. Below that a thread builds whole subtrees, whose boxes stay in
its cache. A subtree over n triangles has at most 2n − 1 nodes and as many places in the array, so nodes
find their places without any counter shared between threads, and the tree does not depend on them.
"""

import warp as wp

from wrt.kernels.bvh import LEAF_FLOATS, LEAF_SIZE, NODE_FLOATS
from wrt.kernels.bvh_ranges import BINS, bounds_of_range, centers_of_range, copy_range, fill_bins, part_range
from wrt.kernels.simd import vec8

COST_SLOTS = 8

FEW_BINS = 8
"""Bins for nodes over few triangles, where sweeping the bins costs more than filling them."""

_LARGE = wp.constant(3.0e38)
# Cost of a node's test in units of a leaf's, measured.
_NODE_COST = wp.constant(1.0)
_FEW_TRIANGLES = wp.constant(64)
_task_stack = wp.types.vector(length=64, dtype=int)
_open_nodes = wp.types.vector(length=16, dtype=int)
_bin_costs = wp.types.vector(length=16, dtype=float)


@wp.struct
class BinaryNode:
    """A node of the binary tree over `count` boxes from `first`; a leaf where `right` is 0.

    `choices` holds the collapse: three bits for each number of roots j from 2 to 8, the share of the
    left child, 0 for "as with one root fewer".
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


@wp.struct
class Split:
    """A plane between two bins along an axis, −1 for none, and the box around all bins."""

    axis: int
    last_left_bin: int
    left: int
    bounds: vec8


@wp.kernel(enable_backward=False)
def make_boxes(first: int, points: wp.array(dtype=wp.vec3), indices: wp.array(dtype=int), boxes: wp.array(dtype=vec8)):
    """Write each triangle's box in the layout of `kernels/bvh_ranges.py`."""
    i = first + wp.tid()
    a = points[indices[3 * i]]
    b = points[indices[3 * i + 1]]
    c = points[indices[3 * i + 2]]
    low = wp.min(wp.min(a, b), c)
    high = wp.max(wp.max(a, b), c)
    boxes[i] = vec8(low[0], low[1], low[2], wp.cast(i, wp.float32), -high[0], -high[1], -high[2], 0.0)


@wp.func
def half_area(box: vec8) -> float:
    """Return half the surface of a box."""
    x = -box[4] - box[0]
    y = -box[5] - box[1]
    z = -box[6] - box[2]
    return x * y + y * z + z * x


@wp.func
def leaf_blocks(count: int) -> float:
    """Return the number of full leaves that `count` triangles take."""
    return float((count + wp.static(LEAF_SIZE - 1)) // wp.static(LEAF_SIZE))


@wp.func
def bin_scale(centers: vec8, bins: int) -> wp.vec3:
    """Return what turns a distance from the least centre into a bin; 0 along axes without extent."""
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
    split.bounds = vec8(_LARGE)
    for k in range(bins):
        split.bounds = wp.min(split.bounds, bin_boxes[scratch + k])
    best_cost = float(_LARGE)
    for axis in range(3):
        if scale[axis] > 0.0:
            # Costs of the right sides from the end, then of the left sides from the start.
            base = scratch + axis * wp.static(BINS)
            side = vec8(_LARGE)
            n = int(0)
            costs = _bin_costs()
            for j in range(bins - 1):
                k = bins - 1 - j
                side = wp.min(side, bin_boxes[base + k])
                n += bin_counts[base + k]
                costs[k] = wp.where(n > 0, half_area(side) * leaf_blocks(n), _LARGE)
            side = vec8(_LARGE)
            n = int(0)
            for k in range(bins - 1):
                side = wp.min(side, bin_boxes[base + k])
                n += bin_counts[base + k]
                if n > 0 and n < count:
                    cost = half_area(side) * leaf_blocks(n) + costs[k + 1]
                    if cost < best_cost:
                        best_cost = cost
                        split.axis = axis
                        split.last_left_bin = k
                        split.left = n
    return split


@wp.func
def set_box(nodes: wp.array(dtype=BinaryNode), index: int, bounds: vec8):
    """Set a node's box."""
    nodes[index].lower = wp.vec3(bounds[0], bounds[1], bounds[2])
    nodes[index].upper = wp.vec3(-bounds[4], -bounds[5], -bounds[6])


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


@wp.kernel(enable_backward=False)
def find_centers(first: int, chunks: Chunks, boxes: wp.array(dtype=vec8)):
    """Bound the centres of each chunk, whatever its sides."""
    c = first + wp.tid()
    chunks.centers[2 * c] = centers_of_range(boxes, chunks.first[c], chunks.count[c])
    chunks.centers[2 * c + 1] = vec8(_LARGE)


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
    low = wp.vec3(bounds[0], bounds[1], bounds[2])
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
    split = Split()
    for pass_number in range(2):
        if pass_number == 1:
            split = choose_split(
                chunks.bin_boxes, chunks.bin_counts, start * wp.static(3 * BINS), wp.static(BINS), count, scale
            )
            set_box(nodes, index, split.bounds)
            if nodes[index].depth >= max_sah_depth:
                split.axis = -1
            if split.axis < 0:
                split.left = count // 2
        else:
            for c in range(start + 1, end):
                for k in range(wp.static(3 * BINS)):
                    to = start * wp.static(3 * BINS) + k
                    of = c * wp.static(3 * BINS) + k
                    chunks.bin_boxes[to] = wp.min(chunks.bin_boxes[to], chunks.bin_boxes[of])
                    chunks.bin_counts[to] = chunks.bin_counts[to] + chunks.bin_counts[of]
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
        low = wp.vec3(bounds[0], bounds[1], bounds[2])
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
    left = vec8(_LARGE)
    right = vec8(_LARGE)
    for c in range(chunks.start[i], chunks.start[i + 1]):
        left = wp.min(left, chunks.centers[2 * c])
        right = wp.min(right, chunks.centers[2 * c + 1])
    centers_out[nodes[level[i]].left] = left
    centers_out[nodes[level[i]].right] = right


@wp.func
def collapse_costs(nodes: wp.array(dtype=BinaryNode), index: int, costs: wp.array(dtype=float)):
    """Find the cheapest way to stand for a subtree by at most j = 1 to 7 roots (Ylitie et al., eq. 2)."""
    node = nodes[index]
    size = node.upper - node.lower
    area = size[0] * size[1] + size[1] * size[2] + size[2] * size[0]
    base = index * wp.static(COST_SLOTS)
    if node.right == 0:
        for j in range(1, 8):
            costs[base + j] = area
        return
    left = node.left * wp.static(COST_SLOTS)
    right = node.right * wp.static(COST_SLOTS)
    choices = int(0)
    shared = vec8()
    for j in range(2, 9):
        best = float(_LARGE)
        share = int(1)
        for k in range(1, j):
            cost = costs[left + k] + costs[right + j - k]
            if cost < best:
                best = cost
                share = k
        shared[j - 1] = best
        choices = choices | (share << (3 * (j - 2)))
    cheapest = area * _NODE_COST + shared[7]
    costs[base + 1] = cheapest
    for j in range(2, 8):
        # Of equal costs, as among boxes without area, the one with more roots: it is less deep.
        if shared[j - 1] <= cheapest:
            cheapest = shared[j - 1]
        else:
            choices = choices & ~(7 << (3 * (j - 2)))
        costs[base + j] = cheapest
    nodes[index].choices = choices


@wp.func
def split_node(
    nodes: wp.array(dtype=BinaryNode),
    index: int,
    children: int,
    boxes: wp.array(dtype=vec8),
    spare: wp.array(dtype=vec8),
    centers: wp.array(dtype=vec8),
    bin_boxes: wp.array(dtype=vec8),
    bin_counts: wp.array(dtype=int),
    scratch: int,
    max_sah_depth: int,
):
    """Set a node's box and, where it holds more than a leaf may, split its boxes between `children` and the next.

    Splits by surface area may be lopsided. From `max_sah_depth` on the boxes are halved, so no binary
    tree is deeper than that plus log2 of its boxes.
    """
    first = nodes[index].first
    count = nodes[index].count
    if count <= wp.static(LEAF_SIZE):
        set_box(nodes, index, bounds_of_range(boxes, first, count))
        return
    bounds = centers[index]
    low = wp.vec3(bounds[0], bounds[1], bounds[2])
    bins = wp.where(count <= _FEW_TRIANGLES, wp.static(FEW_BINS), wp.static(BINS))
    scale = bin_scale(bounds, bins)
    fill_bins(boxes, first, count, low, scale, bins, bin_boxes, bin_counts, scratch)
    split = choose_split(bin_boxes, bin_counts, scratch, bins, count, scale)
    set_box(nodes, index, split.bounds)
    if split.axis >= 0 and nodes[index].depth < max_sah_depth:
        part_range(
            boxes,
            first,
            count,
            low,
            scale,
            bins,
            split.axis,
            split.last_left_bin,
            boxes,
            first,
            spare,
            first,
            centers,
            children,
        )
        copy_range(spare, first, count - split.left, boxes, first + split.left)
    else:
        split.left = count // 2
        centers[children] = bounds
        centers[children + 1] = bounds
    add_children(nodes, index, children, children + 1, split.left)


@wp.kernel(enable_backward=False)
def build_subtrees(
    first: int,
    roots: wp.array(dtype=int),
    in_spare: wp.array(dtype=int),
    nodes: wp.array(dtype=BinaryNode),
    boxes: wp.array(dtype=vec8),
    spare: wp.array(dtype=vec8),
    centers: wp.array(dtype=vec8),
    costs: wp.array(dtype=float),
    bin_boxes: wp.array(dtype=vec8),
    bin_counts: wp.array(dtype=int),
    max_sah_depth: int,
):
    """Split everything below each of a list of nodes, and price its collapse."""
    i = first + wp.tid()
    root = roots[i]
    if in_spare[i] != 0:
        copy_range(spare, nodes[root].first, nodes[root].count, boxes, nodes[root].first)
    stack = _task_stack()
    stack[0] = root
    top = int(1)
    free = root + 1
    while top > 0:
        top -= 1
        index = stack[top]
        split_node(
            nodes, index, free, boxes, spare, centers, bin_boxes, bin_counts, i * wp.static(3 * BINS), max_sah_depth
        )
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
    # Children come after their parents, so this order is bottom-up.
    for k in range(free - root):
        collapse_costs(nodes, free - 1 - k, costs)


@wp.kernel(enable_backward=False)
def price_nodes(
    first: int, order: wp.array(dtype=int), nodes: wp.array(dtype=BinaryNode), costs: wp.array(dtype=float)
):
    """Price the collapse of each of a list of nodes of one level, whose children are priced."""
    collapse_costs(nodes, order[first + wp.tid()], costs)


@wp.func
def children_of(nodes: wp.array(dtype=BinaryNode), root: int):
    """Return the binary nodes that become the children of a wide node, and how many they are."""
    children = _open_nodes()
    pending = _open_nodes()
    shares = _open_nodes()
    count = int(0)
    top = int(1)
    pending[0] = root
    shares[0] = 8
    while top > 0:
        top -= 1
        index = pending[top]
        share = shares[top]
        right = nodes[index].right
        choices = nodes[index].choices
        left_share = int(0)
        if right != 0 and share > 1:
            left_share = (choices >> (3 * (share - 2))) & 7
            while left_share == 0 and share > 2:
                share -= 1
                left_share = (choices >> (3 * (share - 2))) & 7
        if left_share == 0:
            children[count] = index
            count += 1
        else:
            pending[top] = right
            shares[top] = share - left_share
            pending[top + 1] = nodes[index].left
            shares[top + 1] = left_share
            top += 2
    children[15] = count
    return children


@wp.kernel(enable_backward=False)
def find_children(
    first: int,
    level: wp.array(dtype=int),
    nodes: wp.array(dtype=BinaryNode),
    children_out: wp.array(dtype=int),
    inner_out: wp.array(dtype=int),
    leaves_out: wp.array(dtype=int),
):
    """Write the children of each wide node of a level, −1 for unused places, and count nodes and leaves among them."""
    i = first + wp.tid()
    root = nodes[level[i]]
    children = children_of(nodes, level[i])
    count = children[15]
    middle = root.lower + root.upper
    inner = int(0)
    for k in range(8):
        children_out[8 * i + k] = -1
    # Ylitie et al., section 3.2: each child at the place towards whose corner of the node it lies. The
    # best pair of a child and a place that are both left, again and again.
    free = int(255)
    waiting = (1 << count) - 1
    while waiting != 0:
        best = float(-_LARGE)
        best_child = int(0)
        best_place = int(0)
        for k in range(count):
            if (waiting >> k) & 1 != 0:
                child = nodes[children[k]]
                off = child.lower + child.upper - middle
                for place in range(8):
                    if (free >> place) & 1 != 0:
                        fit = wp.where((place & 1) != 0, off[0], -off[0])
                        fit += wp.where((place & 2) != 0, off[1], -off[1])
                        fit += wp.where((place & 4) != 0, off[2], -off[2])
                        if not (fit <= best):
                            best = fit
                            best_child = k
                            best_place = place
        waiting = waiting & ~(1 << best_child)
        free = free & ~(1 << best_place)
        children_out[8 * i + best_place] = children[best_child]
        if nodes[children[best_child]].right != 0:
            inner += 1
    inner_out[i] = inner
    leaves_out[i] = count - inner


@wp.kernel(enable_backward=False)
def list_inner(
    first: int,
    children: wp.array(dtype=int),
    nodes: wp.array(dtype=BinaryNode),
    inner_start: wp.array(dtype=int),
    next_level_out: wp.array(dtype=int),
):
    """Write the wide nodes of the next level."""
    i = first + wp.tid()
    k_out = inner_start[i]
    for k in range(8):
        child = children[8 * i + k]
        if child >= 0:
            if nodes[child].right != 0:
                next_level_out[k_out] = child
                k_out += 1


@wp.func
def write_box(nodes_out: wp.array(dtype=float), place: int, lower: wp.vec3, upper: wp.vec3):
    """Write one of the boxes of a wide node."""
    for axis in range(3):
        nodes_out[place + 8 * axis] = lower[axis]
        nodes_out[place + 24 + 8 * axis] = upper[axis]


@wp.kernel(enable_backward=False)
def write_level(
    first: int,
    children: wp.array(dtype=int),
    nodes: wp.array(dtype=BinaryNode),
    boxes: wp.array(dtype=vec8),
    points: wp.array(dtype=wp.vec3),
    indices: wp.array(dtype=int),
    inner_start: wp.array(dtype=int),
    leaf_start: wp.array(dtype=int),
    first_node: int,
    first_child: int,
    first_leaf: int,
    nodes_out: wp.array(dtype=float),
    children_out: wp.array(dtype=int),
    leaves_out: wp.array(dtype=float),
    leaf_ids_out: wp.array(dtype=int),
):
    """Write the wide nodes of a level and their leaves in the layout of `kernels/bvh.py`."""
    i = first + wp.tid()
    base = (first_node + i) * wp.static(NODE_FLOATS)
    inner = first_child + inner_start[i]
    leaf = first_leaf + leaf_start[i]
    for k in range(8):
        child = children[8 * i + k]
        if child >= 0:
            node = nodes[child]
            write_box(nodes_out, base + k, node.lower, node.upper)
            if node.right != 0:
                children_out[base + 48 + k] = inner
                inner += 1
            else:
                children_out[base + 48 + k] = -1 - leaf
                start = leaf * wp.static(LEAF_FLOATS)
                for n in range(wp.static(LEAF_SIZE)):
                    # Unused places repeat one corner three times: no ray hits that.
                    number = wp.cast(boxes[node.first + wp.min(n, node.count - 1)][3], wp.int32)
                    for corner in range(3):
                        p = points[indices[3 * number + wp.where(n < node.count, corner, 0)]]
                        for axis in range(3):
                            leaves_out[start + wp.static(LEAF_SIZE) * (3 * corner + axis) + n] = p[axis]
                    leaf_ids_out[start + wp.static(9 * LEAF_SIZE) + n] = number
                leaf += 1
        else:
            write_box(nodes_out, base + k, wp.vec3(_LARGE), wp.vec3(-_LARGE))
            children_out[base + 48 + k] = 0


@wp.kernel(enable_backward=False)
def write_upper_level(
    first: int,
    children: wp.array(dtype=int),
    nodes: wp.array(dtype=BinaryNode),
    boxes: wp.array(dtype=vec8),
    inner_start: wp.array(dtype=int),
    leaf_start: wp.array(dtype=int),
    first_node: int,
    first_child: int,
    first_leaf_node: int,
    nodes_out: wp.array(dtype=float),
    children_out: wp.array(dtype=int),
):
    """Write the wide nodes of a level of a tree over boxes; a leaf is a node whose children are −1 − their numbers."""
    i = first + wp.tid()
    base = (first_node + i) * wp.static(NODE_FLOATS)
    inner = first_child + inner_start[i]
    leaf = first_leaf_node + leaf_start[i]
    for k in range(8):
        child = children[8 * i + k]
        if child >= 0:
            node = nodes[child]
            write_box(nodes_out, base + k, node.lower, node.upper)
            if node.right != 0:
                children_out[base + 48 + k] = inner
                inner += 1
            else:
                children_out[base + 48 + k] = leaf
                start = leaf * wp.static(NODE_FLOATS)
                for n in range(8):
                    if n < node.count:
                        box = boxes[node.first + n]
                        lower = wp.vec3(box[0], box[1], box[2])
                        write_box(nodes_out, start + n, lower, wp.vec3(-box[4], -box[5], -box[6]))
                        children_out[start + 48 + n] = -1 - wp.cast(box[3], wp.int32)
                    else:
                        write_box(nodes_out, start + n, wp.vec3(_LARGE), wp.vec3(-_LARGE))
                        children_out[start + 48 + n] = 0
                leaf += 1
        else:
            write_box(nodes_out, base + k, wp.vec3(_LARGE), wp.vec3(-_LARGE))
            children_out[base + 48 + k] = 0
