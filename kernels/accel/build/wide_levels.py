"""The levels of the wide tree on a GPU, with all counters on the device.

Wide nodes are numbered level by level, so the inner children of all nodes before one count where its own begin: the
number of its first inner child is one more than their sum. The host launches as many threads as a level may have nodes.
"""

import warp as wp

from wrt.kernels.accel.build.collapse import sort_children
from wrt.kernels.accel.build.split import BinaryNode

# Unrolled loops take Warp many times as long to compile and run no faster.
wp.set_module_options({"max_unroll": 1})


@wp.struct
class WideLevels:
    """The wide nodes of a tree.

    `root` is the binary node of each; `children` its eight binary nodes, −1 for none; `inner` and `leaves` count those
    that are inner nodes and leaves; `inner_before` and `leaves_before` those of all nodes before. `start` is the first
    node of each level, then twice the number of nodes.
    """

    root: wp.array(dtype=int)
    children: wp.array(dtype=int)
    inner: wp.array(dtype=int)
    inner_before: wp.array(dtype=int)
    leaves: wp.array(dtype=int)
    leaves_before: wp.array(dtype=int)
    start: wp.array(dtype=int)


@wp.kernel(enable_backward=False)
def begin_levels(first: int, wide: WideLevels):
    """Make the root the only node of the first level."""
    wide.root[0] = 0
    wide.start[0] = 0
    wide.start[1] = 1


@wp.kernel(enable_backward=False)
def find_level_children(first: int, level: int, wide: WideLevels, nodes: wp.array(dtype=BinaryNode)):
    """Find the children of each wide node of a level."""
    i = wide.start[level] + first + wp.tid()
    if i >= wide.start[level + 1]:
        return
    found = sort_children(nodes, wide.root[i], i, wide.children)
    wide.inner[i] = found[0]
    wide.leaves[i] = found[1]


@wp.kernel(enable_backward=False)
def list_level_inner(first: int, level: int, wide: WideLevels, nodes: wp.array(dtype=BinaryNode)):
    """Write the wide nodes of the next level."""
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
    wide: WideLevels,
    nodes: wp.array(dtype=BinaryNode),
    costs: wp.array(dtype=float),
    numbers_out: wp.array(dtype=int),
):
    """Write what the host needs, in one thread: number of leaves, cost, box, and the starts of the levels.

    Numbers other than integers are written as their bits.
    """
    last = wide.root.shape[0] - 1
    numbers_out[0] = wide.leaves_before[last] + wide.leaves[last]
    numbers_out[1] = wp.cast(costs[1], wp.int32)
    for axis in range(3):
        numbers_out[2 + axis] = wp.cast(nodes[0].lower[axis], wp.int32)
        numbers_out[5 + axis] = wp.cast(nodes[0].upper[axis], wp.int32)
    for k in range(wide.start.shape[0]):
        numbers_out[8 + k] = wide.start[k]
