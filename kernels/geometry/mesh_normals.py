"""Vertex normals of deforming meshes, computed on the device."""

import warp as wp


@wp.kernel(enable_backward=False)
def smooth_normals(
    first_thread: int,
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
    v = first_thread + wp.tid()
    total = wp.vec3(0.0)
    for i in range(begins[v], ends[v]):
        corner = corners[i]
        face = corner - corner % 3
        here = points[indices[corner]]
        u = points[indices[face + (corner + 1) % 3]] - here
        w = points[indices[face + (corner + 2) % 3]] - here
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
