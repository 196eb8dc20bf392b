"""Refitting a tree to triangles that have moved: new corners and boxes in the same nodes and leaves."""

import warp as wp

from wrt.kernels.accel.build.collapse import write_corners
from wrt.kernels.core.ray_tree import Bvh
from wrt.kernels.native.constants import LEAF_FLOATS, LEAF_SIZE, NODE_FLOATS

# Unrolled loops take Warp many times as long to compile and run no faster.
wp.set_module_options({"max_unroll": 1})


@wp.kernel(enable_backward=False)
def refit_leaves(
    first: int,
    points: wp.array(dtype=wp.vec3),
    indices: wp.array(dtype=int),
    leaf_ids: wp.array(dtype=int),
    bvh: Bvh,
):
    """Rewrite the corners of each leaf's triangles."""
    write_corners(points, indices, leaf_ids, first + wp.tid(), bvh.leaves)


@wp.kernel(enable_backward=False)
def refit_level(first: int, first_node: int, bvh: Bvh, children: wp.array(dtype=int)):
    """Set the boxes of the nodes of a level, after those of the levels below."""
    base = (first_node + first + wp.tid()) * wp.static(NODE_FLOATS)
    for k in range(8):
        if bvh.nodes[base + k] <= bvh.nodes[base + 24 + k]:
            child = children[base + 48 + k]
            for axis in range(3):
                low = float(3.0e38)
                high = float(-3.0e38)
                if child >= 0:
                    row = child * wp.static(NODE_FLOATS) + 8 * axis
                    for n in range(8):
                        low = wp.min(low, bvh.nodes[row + n])
                        high = wp.max(high, bvh.nodes[row + 24 + n])
                else:
                    row = (-1 - child) * wp.static(LEAF_FLOATS) + axis * wp.static(LEAF_SIZE)
                    for n in range(wp.static(LEAF_SIZE)):
                        for corner in range(3):
                            x = bvh.leaves[row + 3 * corner * wp.static(LEAF_SIZE) + n]
                            low = wp.min(low, x)
                            high = wp.max(high, x)
                bvh.nodes[base + 8 * axis + k] = low
                bvh.nodes[base + 24 + 8 * axis + k] = high


@wp.kernel(enable_backward=False)
def find_outside(first: int, points: wp.array(dtype=wp.vec3), limit: float, found_out: wp.array(dtype=int)):
    """Store the number of the first point with a coordinate that is NaN or beyond the limit, if there is one."""
    i = first + wp.tid()
    p = points[i]
    if not (wp.abs(p[0]) <= limit and wp.abs(p[1]) <= limit and wp.abs(p[2]) <= limit):
        wp.atomic_min(found_out, 0, i)
