"""Many rays given as arrays: what the ways to trace them share, and the plain one, a ray a thread."""

import warp as wp

from wrt.kernels.bvh import RAY_SETUP, Bvh, bvh_any_hit, bvh_closest_hit

# For kernels that trace several rays in one thread.
#   in:  bvh, origins, directions, t_min, t_maxs, any_hit, triangle_out, t_out, uv_out
#   out: all_nodes, all_leaves, pad; RayTest, load_ray, prefetch, write_hit
BATCH_OF_RAYS = (
    """
    const float* const all_nodes = (const float*)bvh.nodes.data;
    const float* const all_leaves = (const float*)bvh.leaves.data;
    const float pad = BOX_PAD;

    struct RayTest {
        float origin[3], inverse[3], near_shift[3], far_shift[3], shear[3];
        int near_row[3], far_row[3], kx, ky, kz;
    };

    // Prepare a ray for the tests; return how far it reaches, below 0 where it has no direction.
    const auto load_ray = [&](RayTest& test, int ray) -> float {
        float* const origin = test.origin;
        float* const inverse = test.inverse;
        float* const near_shift = test.near_shift;
        float* const far_shift = test.far_shift;
        float* const shear = test.shear;
        int* const near_row = test.near_row;
        int* const far_row = test.far_row;
        int &kx = test.kx, &ky = test.ky, &kz = test.kz;
        float direction[3];
        for (int k = 0; k < 3; ++k) {
            origin[k] = origins.data[ray][k];
            direction[k] = directions.data[ray][k];
        }
"""
    + RAY_SETUP
    + """
        const bool runs = dx + dy + dz > 0.0f;  // not so for NaN
        return runs ? t_maxs.data[t_maxs.shape[0] > 1 ? ray : 0] : -1.0f;
    };

    // Have a node or a leaf brought nearer, for a visit that is not yet.
    const auto prefetch = [&](int item) {
#if VECTOR_CODE
            const char* place = item >= 0 ? (const char*)(all_nodes + (size_t)item * 56)
                                          : (const char*)(all_leaves + (size_t)(-1 - item) * (10 * LEAF_SIZE));
            for (int line = 0; line < 4; ++line) __builtin_prefetch(place + 64 * line);
#endif
    };

    const auto write_hit = [&](int ray, int number, float t, float u, float v) {
        const bool hit = number != NOTHING_HIT;
        triangle_out.data[ray] = hit ? number : -1;
        if (any_hit) return;
        t_out.data[ray] = hit ? t : INFINITY;
        uv_out.data[ray] = wp::vec_t<2, float>(u, v);
    };
"""
)

# The names that BOX_TEST and TRIANGLE_TEST use, for a RayTest called `test`.
NAMES_OF_TEST = """
        const float *const origin = test.origin, *const inverse = test.inverse, *const shear = test.shear;
        const float *const near_shift = test.near_shift, *const far_shift = test.far_shift;
        const int *const near_row = test.near_row, *const far_row = test.far_row;
        const int kx = test.kx, ky = test.ky, kz = test.kz;
"""


@wp.kernel(enable_backward=False)
def trace_rays(
    first: int,
    bvh: Bvh,
    origins: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    t_min: float,
    t_max: wp.array(dtype=float),
    any_hit: bool,
    triangle_out: wp.array(dtype=int),
    t_out: wp.array(dtype=float),
    uv_out: wp.array(dtype=wp.vec2),
):
    """Trace rays one a thread; `t_max` has one entry or one a ray.

    `triangle_out` is −1 where nothing is hit, t then infinite. With `any_hit` it is not
    negative where anything is hit, and the other two are left alone. A direction of zero or NaN hits nothing.
    """
    ray = first + wp.tid()
    direction = directions[ray]
    reach = t_max[0]
    if t_max.shape[0] > 1:
        reach = t_max[ray]
    if not (wp.abs(direction[0]) + wp.abs(direction[1]) + wp.abs(direction[2]) > 0.0):
        reach = -1.0
    triangle = int(-1)
    if reach >= t_min:
        if any_hit:
            if bvh_any_hit(bvh, origins[ray], direction, t_min, reach):
                triangle = 0
        else:
            hit = bvh_closest_hit(bvh, origins[ray], direction, t_min, reach)
            triangle = hit.triangle
            uv_out[ray] = wp.vec2(hit.u, hit.v)
            t_out[ray] = wp.where(triangle >= 0, hit.t, wp.inf)
    elif not any_hit:
        uv_out[ray] = wp.vec2(0.0, 0.0)
        t_out[ray] = wp.inf
    triangle_out[ray] = triangle


@wp.kernel(enable_backward=False)
def is_hit(first: int, triangle: wp.array(dtype=int), hit_out: wp.array(dtype=wp.bool)):
    """Tell which of `trace_rays`' answers are hits."""
    i = first + wp.tid()
    hit_out[i] = triangle[i] >= 0
