"""Sweeps from the leaves of the binary tree to its root on a GPU: boxes, and costs of collapsing.

A thread begins at each leaf. Of two that come to a node the first ends, and the second goes on, when both children are
done (Karras, "Maximizing Parallelism in the Construction of BVHs, Octrees, and k-d Trees", 2012, section 4). Places of
the array that hold no node have a count of 0.
"""

import warp as wp

from wrt.kernels.accel.build.collapse import collapse_costs
from wrt.kernels.accel.build.split import BinaryNode
from wrt.kernels.native import include

# Unrolled loops take Warp many times as long to compile and run no faster.
wp.set_module_options({"max_unroll": 1})

threads_h = include("threads.h")


@wp.func_native("wrt::fence();")
def fence():
    """Order the writes and reads of this thread as others see them."""
    threads_h()


@wp.func
def is_leaf(nodes: wp.array(dtype=BinaryNode), index: int) -> bool:
    """Return whether a place of the array holds a leaf."""
    return nodes[index].count > 0 and nodes[index].right == 0


@wp.func
def arrives_second(visits: wp.array(dtype=int), index: int) -> bool:
    """Return whether the other child of a node is done; the node's count of visits is 0 again afterwards."""
    fence()
    second = wp.atomic_add(visits, index, 1) == 1
    if second:
        visits[index] = 0
        fence()
    return second


@wp.kernel(enable_backward=False)
def write_all_parents(first: int, nodes: wp.array(dtype=BinaryNode), parents_out: wp.array(dtype=int)):
    """Write the parent of each node, −1 for the root."""
    i = first + wp.tid()
    if i == 0:
        parents_out[0] = -1
    if nodes[i].count > 0 and nodes[i].right != 0:
        parents_out[nodes[i].left] = i
        parents_out[nodes[i].right] = i


@wp.kernel(enable_backward=False)
def sweep_upwards(
    first: int,
    nodes: wp.array(dtype=BinaryNode),
    parents: wp.array(dtype=int),
    visits: wp.array(dtype=int),
    costs: wp.array(dtype=float),
):
    """Set the boxes of all inner nodes to those around their children; unless `costs` is empty, price all nodes too."""
    i = first + wp.tid()
    if not is_leaf(nodes, i):
        return
    prices = costs.shape[0] > 0
    if prices:
        collapse_costs(nodes, i, costs)
    at = parents[i]
    while at >= 0:
        if not arrives_second(visits, at):
            return
        left = nodes[at].left
        right = nodes[at].right
        nodes[at].lower = wp.min(nodes[left].lower, nodes[right].lower)
        nodes[at].upper = wp.max(nodes[left].upper, nodes[right].upper)
        if prices:
            collapse_costs(nodes, at, costs)
        at = parents[at]
