"""Collapse of the binary tree to eight-wide nodes at the least cost, and their output.

Ylitie, Karras and Laine, "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs" (2017), section 3.
"""

import warp as wp

from wrt.kernels.accel.build.boxes import half_area, high_of, low_of, number_of, vec8
from wrt.kernels.accel.build.split import LARGE, BinaryNode
from wrt.kernels.native.constants import LEAF_FLOATS, LEAF_SIZE, NODE_FLOATS

# Unrolled loops take Warp many times as long to compile and run no faster.
wp.set_module_options({"max_unroll": 1})

COST_SLOTS = 8
# The measured cost of a node's test, in units of a leaf's.
_NODE_COST = wp.constant(1.0)
_open_nodes = wp.types.vector(length=16, dtype=int)


@wp.func
def collapse_costs(nodes: wp.array(dtype=BinaryNode), index: int, costs: wp.array(dtype=float)):
    """Find the least cost of representing a subtree by at most j = 1 to 7 roots (Ylitie et al., eq. 2)."""
    node = nodes[index]
    area = half_area(node.upper - node.lower)
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
        best = float(LARGE)
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
        # Of equal costs, as among boxes without area, more roots win: the tree is less deep.
        if shared[j - 1] <= cheapest:
            cheapest = shared[j - 1]
        else:
            choices = choices & ~(7 << (3 * (j - 2)))
        costs[base + j] = cheapest
    nodes[index].choices = choices


@wp.kernel(enable_backward=False)
def price_nodes(
    first: int, order: wp.array(dtype=int), nodes: wp.array(dtype=BinaryNode), costs: wp.array(dtype=float)
):
    """Compute the collapse costs of nodes of one level, after those of their children."""
    collapse_costs(nodes, order[first + wp.tid()], costs)


@wp.func
def children_of(nodes: wp.array(dtype=BinaryNode), root: int):
    """Return the binary nodes that become the children of a wide node, and their number."""
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


@wp.func
def sort_children(nodes: wp.array(dtype=BinaryNode), index: int, i: int, children_out: wp.array(dtype=int)) -> wp.vec2i:
    """Write the children of wide node `i`, −1 for unused places; return the numbers of inner nodes and of leaves.

    Args:
        nodes: the binary tree.
        index: its node that becomes the wide node.
        i: number of the wide node in the list of children.
        children_out: eight for each wide node.
    """
    root = nodes[index]
    children = children_of(nodes, index)
    count = children[15]
    middle = root.lower + root.upper
    inner = int(0)
    for k in range(8):
        children_out[8 * i + k] = -1
    # Ylitie et al., section 3.2: a child goes to the place towards whose corner of the node it lies. Assign the best
    # pair of a free place and an unassigned child, until all are assigned.
    free = int(255)
    waiting = (1 << count) - 1
    while waiting != 0:
        best = float(0.0)
        best_child = int(-1)
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
                        # Sums may overflow and compare false: then the first pair is taken.
                        if best_child < 0 or fit > best:
                            best = fit
                            best_child = k
                            best_place = place
        waiting = waiting & ~(1 << best_child)
        free = free & ~(1 << best_place)
        children_out[8 * i + best_place] = children[best_child]
        if nodes[children[best_child]].right != 0:
            inner += 1
    return wp.vec2i(inner, count - inner)


@wp.struct
class WideNodes:
    """The wide nodes of a tree, level by level.

    `root` is the binary node of each; `children` its eight binary nodes, −1 for none; `inner` and `leaves` count those
    that are inner nodes and leaves; `inner_before` and `leaves_before` those of all nodes before. So the number of a
    node's first inner child is one more than its `inner_before`. `start` is the first node of each level, then twice
    the number of nodes.
    """

    root: wp.array(dtype=int)
    children: wp.array(dtype=int)
    inner: wp.array(dtype=int)
    inner_before: wp.array(dtype=int)
    leaves: wp.array(dtype=int)
    leaves_before: wp.array(dtype=int)
    start: wp.array(dtype=int)


@wp.kernel(enable_backward=False)
def begin_wide_nodes(first: int, wide: WideNodes):
    """Make the root the only node of the first level, in one thread."""
    wide.root[0] = 0
    wide.start[0] = 0
    wide.start[1] = 1


@wp.kernel(enable_backward=False)
def find_children(first: int, level: int, wide: WideNodes, nodes: wp.array(dtype=BinaryNode)):
    """Find the children of each wide node of a level; threads beyond its nodes end."""
    i = wide.start[level] + first + wp.tid()
    if i >= wide.start[level + 1]:
        return
    found = sort_children(nodes, wide.root[i], i, wide.children)
    wide.inner[i] = found[0]
    wide.leaves[i] = found[1]


@wp.kernel(enable_backward=False)
def list_inner(first: int, level: int, wide: WideNodes, nodes: wp.array(dtype=BinaryNode)):
    """Write the wide nodes of the next level; threads beyond the nodes of this one end."""
    thread = first + wp.tid()
    begin = wide.start[level]
    end = wide.start[level + 1]
    if thread == 0 and begin == end:
        wide.start[level + 2] = end
    i = begin + thread
    if i >= end:
        return
    out = 1 + wide.inner_before[i]
    if i == end - 1:
        wide.start[level + 2] = out + wide.inner[i]
    for k in range(8):
        child = wide.children[8 * i + k]
        if child >= 0:
            if nodes[child].right != 0:
                wide.root[out] = child
                out += 1


@wp.kernel(enable_backward=False)
def summarize(
    first: int,
    last: int,
    wide: WideNodes,
    nodes: wp.array(dtype=BinaryNode),
    costs: wp.array(dtype=float),
    numbers_out: wp.array(dtype=int),
):
    """Write a summary for the host, in one thread: number of leaves, cost, box, and the starts of the levels.

    Numbers other than integers are written as their bits. No node comes after `last`.
    """
    numbers_out[0] = wide.leaves_before[last] + wide.leaves[last]
    numbers_out[1] = wp.cast(costs[1], wp.int32)
    for axis in range(3):
        numbers_out[2 + axis] = wp.cast(nodes[0].lower[axis], wp.int32)
        numbers_out[5 + axis] = wp.cast(nodes[0].upper[axis], wp.int32)
    for k in range(wide.start.shape[0]):
        numbers_out[8 + k] = wide.start[k]


@wp.func
def write_child(
    nodes_out: wp.array(dtype=float),
    children_out: wp.array(dtype=int),
    place: int,
    lower: wp.vec3,
    upper: wp.vec3,
    child: int,
):
    """Write a child and its box into a wide node."""
    for axis in range(3):
        nodes_out[place + 8 * axis] = lower[axis]
        nodes_out[place + 24 + 8 * axis] = upper[axis]
    children_out[place + 48] = child


@wp.kernel(enable_backward=False)
def write_nodes(
    first: int,
    wide: WideNodes,
    nodes: wp.array(dtype=BinaryNode),
    leaf_nodes: int,
    nodes_out: wp.array(dtype=float),
    children_out: wp.array(dtype=int),
    leaf_ranges_out: wp.array(dtype=wp.vec2i),
):
    """Write the wide nodes in the layout of `kernels/core/ray_tree.py`, and each leaf's range (first, count) of boxes.

    A leaf's number among the children is −1 − leaf, or `leaf_nodes` + leaf if leaves are nodes as well
    (`leaf_nodes` ≥ 0).
    """
    i = first + wp.tid()
    base = i * wp.static(NODE_FLOATS)
    inner = 1 + wide.inner_before[i]
    leaf = wide.leaves_before[i]
    for k in range(8):
        child = wide.children[8 * i + k]
        if child < 0:
            write_child(nodes_out, children_out, base + k, wp.vec3(LARGE), wp.vec3(-LARGE), -1)
        else:
            node = nodes[child]
            number = inner
            if node.right != 0:
                inner += 1
            else:
                number = wp.where(leaf_nodes >= 0, leaf_nodes + leaf, -1 - leaf)
                leaf_ranges_out[leaf] = wp.vec2i(node.first, node.count)
                leaf += 1
            write_child(nodes_out, children_out, base + k, node.lower, node.upper, number)


@wp.func
def write_corners(
    points: wp.array(dtype=wp.vec3),
    indices: wp.array(dtype=int),
    leaf_ids: wp.array(dtype=int),
    leaf: int,
    leaves_out: wp.array(dtype=float),
):
    """Write the corners of a leaf's triangles. An unused place repeats the last number, with coincident corners."""
    start = leaf * wp.static(LEAF_FLOATS)
    last = int(-1)
    for n in range(wp.static(LEAF_SIZE)):
        number = leaf_ids[start + wp.static(9 * LEAF_SIZE) + n]
        for corner in range(3):
            p = points[indices[3 * number + wp.where(number != last, corner, 0)]]
            for axis in range(3):
                leaves_out[start + wp.static(LEAF_SIZE) * (3 * corner + axis) + n] = p[axis]
        last = number


@wp.kernel(enable_backward=False)
def list_numbers(first: int, boxes: wp.array(dtype=vec8), numbers_out: wp.array(dtype=int)):
    """Write the number that each box carries."""
    i = first + wp.tid()
    numbers_out[i] = number_of(boxes[i])


@wp.kernel(enable_backward=False)
def write_leaves(
    first: int,
    leaf_ranges: wp.array(dtype=wp.vec2i),
    numbers: wp.array(dtype=int),
    points: wp.array(dtype=wp.vec3),
    indices: wp.array(dtype=int),
    leaves_out: wp.array(dtype=float),
    leaf_ids_out: wp.array(dtype=int),
):
    """Write the numbers and corners of each leaf's triangles."""
    leaf = first + wp.tid()
    begin = leaf_ranges[leaf][0]
    count = leaf_ranges[leaf][1]
    for n in range(wp.static(LEAF_SIZE)):
        number = numbers[begin + wp.min(n, count - 1)]
        leaf_ids_out[leaf * wp.static(LEAF_FLOATS) + wp.static(9 * LEAF_SIZE) + n] = number
    write_corners(points, indices, leaf_ids_out, leaf, leaves_out)


@wp.kernel(enable_backward=False)
def write_leaf_nodes(
    first: int,
    leaf_ranges: wp.array(dtype=wp.vec2i),
    boxes: wp.array(dtype=vec8),
    leaf_nodes: int,
    nodes_out: wp.array(dtype=float),
    children_out: wp.array(dtype=int),
):
    """Write the leaves of a tree over boxes as nodes from `leaf_nodes` on; their children are −1 − (a box's number)."""
    leaf = first + wp.tid()
    base = (leaf_nodes + leaf) * wp.static(NODE_FLOATS)
    begin = leaf_ranges[leaf][0]
    for n in range(8):
        if n < leaf_ranges[leaf][1]:
            box = boxes[begin + n]
            write_child(nodes_out, children_out, base + n, low_of(box), high_of(box), -1 - number_of(box))
        else:
            write_child(nodes_out, children_out, base + n, wp.vec3(LARGE), wp.vec3(-LARGE), -1)
