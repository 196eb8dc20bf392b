"""Smooth normals of meshes: of large ones on all cores, and of those that deform."""

import warp as wp


@wp.func
def _group_of(groups: wp.array(dtype=int), vertex: int) -> int:
    """Return the group of a vertex: its own number if there are no groups."""
    if len(groups) > 0:
        return groups[vertex]
    return vertex


@wp.func
def _angle(twice_area: wp.float64, cosine: wp.float64, per_size: wp.float64) -> wp.float64:
    """Return a face's angle, radians, from cross and dot product of its edges and 1 over their size."""
    # Accurate for slivers, unlike arccos.
    return wp.float64(wp.atan2(wp.float32(twice_area * per_size), wp.float32(cosine * per_size)))


@wp.kernel(enable_backward=False)
def sum_normals(
    first_thread: int,
    threads: int,
    points: wp.array(dtype=wp.vec3),
    scale: wp.float64,
    indices: wp.array(dtype=int),
    groups: wp.array(dtype=int),
    sums_out: wp.array(dtype=wp.vec4d),
):
    """Add to the sums of vertex groups: face normals weighted by their angles at the corners, and those angles.

    Thread t has the groups from t·G / threads on. It visits all faces in order, so neither the number of threads nor
    their timing changes the sums.

    Args:
        first_thread: index of thread 0.
        threads: the number of threads.
        points: positions.
        scale: factor of edges that keeps their products within double precision.
        indices: vertices of faces, three each.
        groups: the group of each vertex; empty if each is its own.
        sums_out: (G,), initially zero.
    """
    t = first_thread + wp.tid()
    count = wp.int64(len(sums_out))
    low = wp.int32(count * wp.int64(t) / wp.int64(threads))
    high = wp.int32(count * wp.int64(t + 1) / wp.int64(threads))
    for f in range(len(indices) // 3):
        i, j, k = indices[3 * f], indices[3 * f + 1], indices[3 * f + 2]
        p, q, r = _group_of(groups, i), _group_of(groups, j), _group_of(groups, k)
        if p >= low and p < high or q >= low and q < high or r >= low and r < high:
            a = wp.vec3d(points[i])
            u = (wp.vec3d(points[j]) - a) * scale
            v = (wp.vec3d(points[k]) - a) * scale
            normal = wp.cross(u, v)
            twice_area = wp.length(normal)
            if twice_area > wp.float64(0.0):
                uu, vv, uv = wp.length_sq(u), wp.length_sq(v), wp.dot(u, v)
                per_size = wp.float64(1.0) / (uu + vv)
                normal /= twice_area
                weighted = wp.vec4d(normal[0], normal[1], normal[2], wp.float64(1.0))
                if p >= low and p < high:
                    sums_out[p] += weighted * _angle(twice_area, uv, per_size)
                if q >= low and q < high:
                    sums_out[q] += weighted * _angle(twice_area, uu - uv, per_size)
                if r >= low and r < high:
                    sums_out[r] += weighted * _angle(twice_area, vv - uv, per_size)


@wp.kernel(enable_backward=False)
def write_normals(
    first_thread: int,
    sums: wp.array(dtype=wp.vec4d),
    groups: wp.array(dtype=int),
    normals_out: wp.array(dtype=wp.vec3),
):
    """Write each vertex's unit normal, zero if those around it cancel.

    Args:
        first_thread: index of thread 0.
        sums: the result of `sum_normals`.
        groups: as for `sum_normals`.
        normals_out: one per vertex.
    """
    vertex = first_thread + wp.tid()
    total = sums[_group_of(groups, vertex)]
    normal = wp.vec3d(total[0], total[1], total[2])
    length = wp.length(normal)
    unit = wp.vec3()
    if length > wp.float64(1e-6) * total[3]:  # faces with opposite normals leave rounding errors only
        unit = wp.vec3(normal / length)
    normals_out[vertex] = unit


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
