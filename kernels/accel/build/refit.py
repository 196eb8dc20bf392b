"""Vertices that move between frames: a check of their coordinates, smooth normals, and a tree refitted to them."""

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


@wp.kernel(enable_backward=False)
def smooth_normals(
    first: int,
    first_vertex: int,
    begins: wp.array(dtype=int),
    ends: wp.array(dtype=int),
    corners: wp.array(dtype=int),
    indices: wp.array(dtype=int),
    points: wp.array(dtype=wp.vec3),
    normals_out: wp.array(dtype=wp.vec3),
):
    """Write each vertex's normal, the mean of face normals weighted by angle (Thürmer and Wüthrich 1998).

    One thread sums for each vertex in a fixed order, so neither threads nor devices change the result. Vertex v has the
    corners `corners[begins[v]:ends[v]]`, where 3k to 3k + 2 belong to face k; `first_vertex` is its number in `points`.
    A vertex without a face of positive area keeps its normal.
    """
    v = first + wp.tid()
    total = wp.vec3(0.0)
    for i in range(begins[v], ends[v]):
        corner = corners[i]
        face = corner - corner % 3
        point = points[indices[corner]]
        u = points[indices[face + (corner + 1) % 3]] - point
        w = points[indices[face + (corner + 2) % 3]] - point
        # Scaled, so that products of tiny or huge edges stay within float32.
        scale = wp.max(wp.length(u), wp.length(w))
        if scale > 0.0:
            u = u / scale
            w = w / scale
            normal = wp.cross(u, w)
            twice_area = wp.length(normal)
            if twice_area > 0.0:
                total += normal * (wp.atan2(twice_area, wp.dot(u, w)) / twice_area)
    length = wp.length(total)
    if length > 0.0:
        normals_out[first_vertex + v] = total / length
