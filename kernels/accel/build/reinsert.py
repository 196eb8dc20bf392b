"""Reinsertion: subtrees of the binary tree move to where they cost less.

Meister and Bittner, "Parallel Reinsertion for Bounding Volume Hierarchy Optimization" (2018). Top-down splits separate
boxes by position, so a floor or a wall shares nodes with the things that stand on it, and all nodes below get larger
boxes than they need. Moving a node shrinks the boxes above its old place and enlarges those above its new one; it goes
where the sum of all areas is least.
"""

import warp as wp

from wrt.kernels.accel.build.boxes import half_area
from wrt.kernels.accel.build.split import BinaryNode

# Unrolled loops take Warp many times as long to compile and run no faster.
wp.set_module_options({"max_unroll": 1})

STACK_SIZE = 128
"""Nodes that may wait in a search; further ones are skipped."""

# A move must save more than this share of its parent's area: less may be rounding.
_LEAST_GAIN = wp.constant(1.0e-5)
_waiting_nodes = wp.types.vector(length=STACK_SIZE, dtype=int)
_waiting_sums = wp.types.vector(length=STACK_SIZE, dtype=float)


@wp.kernel(enable_backward=False)
def write_parents(
    first: int, inner: wp.array(dtype=int), nodes: wp.array(dtype=BinaryNode), parents_out: wp.array(dtype=int)
):
    """Write the parent of each child of the listed nodes."""
    i = inner[first + wp.tid()]
    parents_out[nodes[i].left] = i
    parents_out[nodes[i].right] = i


@wp.func
def sibling_of(nodes: wp.array(dtype=BinaryNode), parent: int, child: int) -> int:
    """Return the other child."""
    return wp.where(nodes[parent].left == child, nodes[parent].right, nodes[parent].left)


@wp.func
def area_around(nodes: wp.array(dtype=BinaryNode), index: int, lower: wp.vec3, upper: wp.vec3) -> float:
    """Return half the surface area of the box around a node and another box."""
    return half_area(wp.max(nodes[index].upper, upper) - wp.min(nodes[index].lower, lower))


@wp.kernel(enable_backward=False)
def find_places(
    first: int,
    moving: wp.array(dtype=int),
    nodes: wp.array(dtype=BinaryNode),
    parents: wp.array(dtype=int),
    most_visits: int,
    places_out: wp.array(dtype=int),
    gains_out: wp.array(dtype=float),
):
    """Find the best new sibling for each of the listed nodes, −1 for none, and the area that the move saves.

    The root and its children stay. After `most_visits` nodes a search ends with the best place so far.
    """
    i = first + wp.tid()
    node = moving[i]
    lower = nodes[node].lower
    upper = nodes[node].upper
    node_area = half_area(upper - lower)
    parent = parents[node]
    places_out[i] = -1
    gains_out[i] = 0.0
    if parent < 0:
        return
    if parents[parent] < 0:
        return
    sibling = sibling_of(nodes, parent, node)
    place = int(-1)
    saved = half_area(nodes[parent].upper - nodes[parent].lower)  # area saved by the removal, up to the current node
    best = _LEAST_GAIN * saved
    left_lower = nodes[sibling].lower  # the box of the current node without the removed one
    left_upper = nodes[sibling].upper
    waiting = _waiting_nodes()
    sums = _waiting_sums()
    below = parent
    subtree = sibling
    visits_left = int(most_visits)
    while subtree >= 0:
        # Search a subtree beside the path to the root; `sums` is the area saved once the nodes above have grown.
        top = int(1)
        waiting[0] = subtree
        sums[0] = saved
        while top > 0 and visits_left > 0:
            top -= 1
            visits_left -= 1
            at = waiting[top]
            most = sums[top]
            if most - node_area > best:
                gain = most - area_around(nodes, at, lower, upper)
                if gain > best and at != sibling:
                    best = gain
                    place = at
                if nodes[at].right != 0 and top < STACK_SIZE - 1:
                    gain += half_area(nodes[at].upper - nodes[at].lower)
                    waiting[top] = nodes[at].left
                    waiting[top + 1] = nodes[at].right
                    sums[top] = gain
                    sums[top + 1] = gain
                    top += 2
        subtree = int(-1)
        above = parents[below]
        if above >= 0 and visits_left > 0:
            if below != parent:
                saved += half_area(nodes[below].upper - nodes[below].lower) - half_area(left_upper - left_lower)
            subtree = sibling_of(nodes, above, below)
            left_lower = wp.min(left_lower, nodes[subtree].lower)
            left_upper = wp.max(left_upper, nodes[subtree].upper)
            below = above
    places_out[i] = place
    gains_out[i] = best


@wp.func
def replace_child(nodes: wp.array(dtype=BinaryNode), parents: wp.array(dtype=int), parent: int, child: int, other: int):
    """Replace a child of a node by another node."""
    if nodes[parent].left == child:
        nodes[parent].left = other
    else:
        nodes[parent].right = other
    parents[other] = parent


@wp.func
def refit_upwards(nodes: wp.array(dtype=BinaryNode), parents: wp.array(dtype=int), index: int):
    """Update the boxes of a node and of all its ancestors."""
    at = int(index)
    while at >= 0:
        left = nodes[at].left
        right = nodes[at].right
        nodes[at].lower = wp.min(nodes[left].lower, nodes[right].lower)
        nodes[at].upper = wp.max(nodes[left].upper, nodes[right].upper)
        at = parents[at]


@wp.func
def lies_below(parents: wp.array(dtype=int), index: int, node: int) -> bool:
    """Return whether a node is another or one of its descendants."""
    at = int(index)
    while at >= 0 and at != node:
        at = parents[at]
    return at >= 0


@wp.kernel(enable_backward=False)
def move_nodes(
    first: int,
    moving: wp.array(dtype=int),
    places: wp.array(dtype=int),
    nodes: wp.array(dtype=BinaryNode),
    parents: wp.array(dtype=int),
    touched: wp.array(dtype=int),
):
    """Move nodes to their places one after the other, except those whose old or new neighbours have moved.

    Runs in one thread: a move changes boxes up to the root, which the next one reads.
    """
    for i in range(moving.shape[0]):
        node = moving[i]
        place = places[i]
        parent = parents[node]
        above = parents[place]
        grandparent = parents[parent]
        sibling = sibling_of(nodes, parent, node)
        if touched[node] + touched[place] + touched[parent] + touched[above] + touched[sibling] != 0:
            continue
        if lies_below(parents, place, node):
            continue
        touched[node] = 1
        touched[place] = 1
        touched[parent] = 1
        touched[above] = 1
        touched[sibling] = 1
        # The parent moves along and joins both.
        replace_child(nodes, parents, grandparent, parent, sibling)
        replace_child(nodes, parents, above, place, parent)
        nodes[parent].left = place
        nodes[parent].right = node
        parents[place] = parent
        refit_upwards(nodes, parents, grandparent)
        refit_upwards(nodes, parents, parent)
