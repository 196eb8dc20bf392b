"""Smooth normals of large meshes, on all cores: each thread sums for vertices of its own, in the order of the faces."""

import warp as wp


@wp.func
def _group_of(groups: wp.array(dtype=int), vertex: int) -> int:
    """Return the group of a vertex: itself where there are none."""
    if len(groups) > 0:
        return groups[vertex]
    return vertex


@wp.func
def _angle(twice_area: wp.float64, cosine: wp.float64, per_size: wp.float64) -> wp.float64:
    """Return an angle of a face, radians, from the cross and the dot product of its edges, and 1 over their size."""
    # Exact for slivers, where arccos is not.
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
    """Add to the sums of groups of vertices: normals of faces weighted by their angles at corners, and those angles.

    Thread t has the groups from t·G / threads on. It looks at all faces, and so takes each of its groups' in the one
    order that there is: neither the number of threads nor which is faster changes the sums.

    Args:
        first_thread: index of thread 0.
        threads: how many share the work.
        points: positions.
        scale: what edges are multiplied by, so that their products stay inside double precision.
        indices: vertices of faces, three each.
        groups: the group of each vertex; empty where each is its own.
        sums_out: (G,), zero before.
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
    """Write each vertex's unit normal, zero where those around it cancel.

    Args:
        first_thread: index of thread 0.
        sums: as `sum_normals` leaves them.
        groups: likewise.
        normals_out: one a vertex.
    """
    vertex = first_thread + wp.tid()
    total = sums[_group_of(groups, vertex)]
    normal = wp.vec3d(total[0], total[1], total[2])
    length = wp.length(normal)
    unit = wp.vec3()
    if length > wp.float64(1e-6) * total[3]:  # faces that look opposite ways leave only rounding
        unit = wp.vec3(normal / length)
    normals_out[vertex] = unit
