"""Building the tree: binned surface-area splits, then the cheapest collapse to eight-wide nodes.

Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies" (2007); Ylitie, Karras and
Laine, "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs" (2017), section 3.

A binary tree comes first. It lies in preorder: the left child of node i is i + 1, the right child
i + 2·(triangles on the left), for a subtree over n triangles has at most 2n − 1 nodes. So every node
knows its place without any counter shared between threads.
"""

import warp as wp

from wrt.kernels.bvh import LEAF_FLOATS, LEAF_SIZE, NODE_FLOATS
from wrt.kernels.simd import vec8

BINS = 16
COST_SLOTS = 8
_LARGE = wp.constant(3.0e38)
# Cost of a node's test in units of a leaf's, measured.
_NODE_COST = wp.constant(1.0)
_task_stack = wp.types.vector(length=64, dtype=int)
_open_nodes = wp.types.vector(length=16, dtype=int)
_bin_costs = wp.types.vector(length=16, dtype=float)


@wp.struct
class BinaryNode:
    """A node of the binary tree over `count` boxes from `first`; a leaf where `right` is 0.

    A `count` of 0 marks an unused place. `choices` holds the collapse: three bits for each number of
    roots j from 2 to 8, the share of the left child, 0 for "as with one root fewer".
    """

    lower: wp.vec3
    first: int
    upper: wp.vec3
    count: int
    right: int
    choices: int
    depth: int


@wp.kernel(enable_backward=False)
def make_boxes(first: int, points: wp.array(dtype=wp.vec3), indices: wp.array(dtype=int), boxes: wp.array(dtype=vec8)):
    """Write each triangle's box: lower corner, number, negated upper corner, so that min joins boxes."""
    i = first + wp.tid()
    a = points[indices[3 * i]]
    b = points[indices[3 * i + 1]]
    c = points[indices[3 * i + 2]]
    low = wp.min(wp.min(a, b), c)
    high = wp.max(wp.max(a, b), c)
    boxes[i] = vec8(low[0], low[1], low[2], wp.cast(i, wp.float32), -high[0], -high[1], -high[2], 0.0)


@wp.func
def half_area(box: vec8) -> float:
    """Return half the surface of a box in the layout of `make_boxes`."""
    x = -box[4] - box[0]
    y = -box[5] - box[1]
    z = -box[6] - box[2]
    return x * y + y * z + z * x


@wp.func
def bin_of(box: vec8, axis: int, low: float, scale: float) -> int:
    """Return the bin of a box's centre, from 0 to BINS − 1."""
    return wp.clamp(int((box[axis] - box[axis + 4] - low) * scale), 0, wp.static(BINS - 1))


@wp.func
def leaf_blocks(count: int) -> float:
    """Return the number of full leaves that `count` triangles take."""
    return float((count + wp.static(LEAF_SIZE - 1)) // wp.static(LEAF_SIZE))


@wp.func
def split_node(
    nodes: wp.array(dtype=BinaryNode),
    index: int,
    boxes: wp.array(dtype=vec8),
    bin_boxes: wp.array(dtype=vec8),
    bin_counts: wp.array(dtype=int),
    scratch: int,
    max_sah_depth: int,
):
    """Set a node's box and, where it holds more than a leaf may, split its boxes between two children.

    Splits by surface area may be lopsided. From `max_sah_depth` on the boxes are halved, so no binary
    tree is deeper than that plus log2 of its boxes.
    """
    first = nodes[index].first
    count = nodes[index].count
    depth = nodes[index].depth
    empty = vec8(_LARGE)
    bounds = empty
    centers = empty
    for i in range(first, first + count):
        box = boxes[i]
        bounds = wp.min(bounds, box)
        x = box[0] - box[4]
        y = box[1] - box[5]
        z = box[2] - box[6]
        centers = wp.min(centers, vec8(x, y, z, 0.0, -x, -y, -z, 0.0))
    nodes[index].lower = wp.vec3(bounds[0], bounds[1], bounds[2])
    nodes[index].upper = wp.vec3(-bounds[4], -bounds[5], -bounds[6])
    nodes[index].right = 0
    if count <= wp.static(LEAF_SIZE):
        return

    best_cost = float(_LARGE)
    best_axis = int(-1)
    best_bin = int(0)
    scale = wp.vec3(0.0)
    for axis in range(3):
        extent = -centers[axis + 4] - centers[axis]
        if extent > 0.0:
            scale[axis] = float(BINS) * 0.9999 / extent
    if depth < max_sah_depth:
        for k in range(wp.static(3 * BINS)):
            bin_boxes[scratch + k] = empty
            bin_counts[scratch + k] = 0
        for i in range(first, first + count):
            box = boxes[i]
            for axis in range(3):
                k = scratch + axis * wp.static(BINS) + bin_of(box, axis, centers[axis], scale[axis])
                bin_boxes[k] = wp.min(bin_boxes[k], box)
                bin_counts[k] = bin_counts[k] + 1
        for axis in range(3):
            if scale[axis] > 0.0:
                # Costs of the right sides from the end, then of the left sides from the start.
                base = scratch + axis * wp.static(BINS)
                side = empty
                n = int(0)
                costs = _bin_costs()
                for j in range(wp.static(BINS - 1)):
                    k = wp.static(BINS - 1) - j
                    side = wp.min(side, bin_boxes[base + k])
                    n += bin_counts[base + k]
                    costs[k] = wp.where(n > 0, half_area(side) * leaf_blocks(n), _LARGE)
                side = empty
                n = 0
                for k in range(wp.static(BINS - 1)):
                    side = wp.min(side, bin_boxes[base + k])
                    n += bin_counts[base + k]
                    if n > 0 and n < count:
                        cost = half_area(side) * leaf_blocks(n) + costs[k + 1]
                        if cost < best_cost:
                            best_cost = cost
                            best_axis = axis
                            best_bin = k

    left = count // 2
    if best_axis >= 0:
        low = centers[best_axis]
        i = first
        j = first + count - 1
        while i <= j:
            if bin_of(boxes[i], best_axis, low, scale[best_axis]) <= best_bin:
                i += 1
            else:
                other = boxes[j]
                boxes[j] = boxes[i]
                boxes[i] = other
                j -= 1
        left = i - first

    right = index + 2 * left
    nodes[index].right = right
    nodes[index + 1].first = first
    nodes[index + 1].count = left
    nodes[index + 1].depth = depth + 1
    nodes[right].first = first + left
    nodes[right].count = count - left
    nodes[right].depth = depth + 1


@wp.kernel(enable_backward=False)
def split_nodes(
    first: int,
    open_nodes: wp.array(dtype=int),
    nodes: wp.array(dtype=BinaryNode),
    boxes: wp.array(dtype=vec8),
    bin_boxes: wp.array(dtype=vec8),
    bin_counts: wp.array(dtype=int),
    max_sah_depth: int,
):
    """Split each of a list of nodes once."""
    i = first + wp.tid()
    split_node(nodes, open_nodes[i], boxes, bin_boxes, bin_counts, i * wp.static(3 * BINS), max_sah_depth)


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
    left = (index + 1) * wp.static(COST_SLOTS)
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


@wp.kernel(enable_backward=False)
def build_subtrees(
    first: int,
    roots: wp.array(dtype=int),
    nodes: wp.array(dtype=BinaryNode),
    boxes: wp.array(dtype=vec8),
    bin_boxes: wp.array(dtype=vec8),
    bin_counts: wp.array(dtype=int),
    max_sah_depth: int,
    costs: wp.array(dtype=float),
):
    """Split everything below each of a list of nodes, and price its collapse."""
    i = first + wp.tid()
    root = roots[i]
    size = 2 * nodes[root].count - 1
    stack = _task_stack()
    stack[0] = root
    top = int(1)
    while top > 0:
        top -= 1
        index = stack[top]
        split_node(nodes, index, boxes, bin_boxes, bin_counts, i * wp.static(3 * BINS), max_sah_depth)
        right = nodes[index].right
        if right != 0:
            # The larger child waits, so the stack never exceeds log2 of the triangles.
            small = index + 1
            large = right
            if nodes[small].count > nodes[large].count:
                small = right
                large = index + 1
            stack[top] = large
            stack[top + 1] = small
            top += 2
    # Children come after their parents, so this order is bottom-up.
    for k in range(size):
        index = root + size - 1 - k
        if nodes[index].count > 0:
            collapse_costs(nodes, index, costs)


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
            pending[top + 1] = index + 1
            shares[top + 1] = left_share
            top += 2
    children[15] = count
    return children


@wp.kernel(enable_backward=False)
def count_children(
    first: int,
    level: wp.array(dtype=int),
    nodes: wp.array(dtype=BinaryNode),
    inner_out: wp.array(dtype=int),
    leaves_out: wp.array(dtype=int),
):
    """Count the children of each wide node of a level that are nodes and that are leaves."""
    i = first + wp.tid()
    children = children_of(nodes, level[i])
    inner = int(0)
    for k in range(children[15]):
        if nodes[children[k]].right != 0:
            inner += 1
    inner_out[i] = inner
    leaves_out[i] = children[15] - inner


@wp.kernel(enable_backward=False)
def list_children(
    first: int,
    level: wp.array(dtype=int),
    nodes: wp.array(dtype=BinaryNode),
    inner_start: wp.array(dtype=int),
    next_level_out: wp.array(dtype=int),
):
    """Write the wide nodes of the next level."""
    i = first + wp.tid()
    children = children_of(nodes, level[i])
    k_out = inner_start[i]
    for k in range(children[15]):
        if nodes[children[k]].right != 0:
            next_level_out[k_out] = children[k]
            k_out += 1


@wp.kernel(enable_backward=False)
def write_level(
    first: int,
    level: wp.array(dtype=int),
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
    children = children_of(nodes, level[i])
    base = (first_node + i) * wp.static(NODE_FLOATS)
    inner = first_child + inner_start[i]
    leaf = first_leaf + leaf_start[i]
    for k in range(8):
        if k < children[15]:
            node = nodes[children[k]]
            for axis in range(3):
                nodes_out[base + 8 * axis + k] = node.lower[axis]
                nodes_out[base + 24 + 8 * axis + k] = node.upper[axis]
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
            for axis in range(3):
                nodes_out[base + 8 * axis + k] = _LARGE
                nodes_out[base + 24 + 8 * axis + k] = -_LARGE
            children_out[base + 48 + k] = 0
