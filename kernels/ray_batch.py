"""Many rays given as arrays: what the ways to trace them share, and the plain one, a ray a thread."""

import warp as wp

from wrt.kernels.bvh import RAY_SETUP, Bvh, Hit, bvh_hit
from wrt.kernels.simd import PREFETCH

# Finite, so that a t that overflows is no hit.
LONGEST = wp.constant(3.4028235e38)


@wp.struct
class RayBatch:
    """Rays, and where their answers go.

    `t_max` has one entry or one a ray. `triangle_out` is −1 where nothing is hit, `t_out` then infinite.
    With `any_hit` it is not negative where anything is hit, and the other two are left alone. A ray whose
    direction is zero, or that is not finite, hits nothing.
    """

    origins: wp.array(dtype=wp.vec3)
    directions: wp.array(dtype=wp.vec3)
    t_min: float
    t_max: wp.array(dtype=float)
    any_hit: int
    triangle_out: wp.array(dtype=int)
    t_out: wp.array(dtype=float)
    uv_out: wp.array(dtype=wp.vec2)


# For kernels that trace several rays in one thread.
#   in:  bvh, batch
#   out: all_nodes, all_leaves, pad, t_min, any_hit; RayTest, load_ray, prefetch, write_hit
BATCH_OF_RAYS = (
    """
    const float* const all_nodes = (const float*)bvh.nodes.data;
    const float* const all_leaves = (const float*)bvh.leaves.data;
    const float pad = BOX_PAD, t_min = batch.t_min;
    const bool any_hit = batch.any_hit != 0;

    struct RayTest {
        float origin[3], inverse[4], near_shift[4], far_shift[4], shear[3];
        int near_row[4], far_row[4], kx, ky, kz, flip;
    };

    // Prepare a ray for the tests; return how far it reaches, below 0 where it can hit nothing.
    const auto load_ray = [&](RayTest& test, int ray) -> float {
        float* const origin = test.origin;
        float* const inverse = test.inverse;
        float* const near_shift = test.near_shift;
        float* const far_shift = test.far_shift;
        float* const shear = test.shear;
        int* const near_row = test.near_row;
        int* const far_row = test.far_row;
        int &kx = test.kx, &ky = test.ky, &kz = test.kz, &flip = test.flip;
        float direction[3];
        for (int k = 0; k < 3; ++k) {
            origin[k] = batch.origins.data[ray][k];
            direction[k] = batch.directions.data[ray][k];
        }
"""
    + RAY_SETUP
    + """
        // Finite, so that a t that overflows is no hit.
        return runs ? wp::min(batch.t_max.data[batch.t_max.shape[0] > 1 ? ray : 0], 3.4028235e38f) : -1.0f;
    };

"""
    + PREFETCH
    + """
    const auto write_hit = [&](int ray, int number, float t, float u, float v) {
        const bool hit = number != NOTHING_HIT;
        batch.triangle_out.data[ray] = hit ? number : -1;
        if (any_hit) return;
        batch.t_out.data[ray] = hit ? t : INFINITY;
        batch.uv_out.data[ray] = wp::vec_t<2, float>(u, v);
    };
"""
)

# The names that BOX_TEST and TRIANGLE_TEST use, for a RayTest called `test`.
NAMES_OF_TEST = """
        const float *const origin = test.origin, *const inverse = test.inverse, *const shear = test.shear;
        const float *const near_shift = test.near_shift, *const far_shift = test.far_shift;
        const int *const near_row = test.near_row, *const far_row = test.far_row;
        const int kx = test.kx, ky = test.ky, kz = test.kz, flip = test.flip;
"""


@wp.func
def reach_of(batch: RayBatch, ray: int) -> float:
    """Return how far a ray reaches."""
    if batch.t_max.shape[0] > 1:
        return wp.min(batch.t_max[ray], LONGEST)
    return wp.min(batch.t_max[0], LONGEST)


@wp.func
def write_answer(batch: RayBatch, ray: int, hit: Hit):
    """Store what a ray hits."""
    batch.triangle_out[ray] = hit.triangle
    if batch.any_hit == 0:
        missed = hit.triangle < 0
        batch.t_out[ray] = wp.where(missed, float(wp.inf), hit.t)
        batch.uv_out[ray] = wp.where(missed, wp.vec2(0.0, 0.0), wp.vec2(hit.u, hit.v))


@wp.kernel(enable_backward=False)
def trace_rays(first: int, bvh: Bvh, batch: RayBatch):
    """Trace rays one a thread."""
    ray = first + wp.tid()
    reach = reach_of(batch, ray)
    hit = Hit()
    hit.triangle = -1
    if reach >= batch.t_min:
        hit = bvh_hit(bvh, batch.origins[ray], batch.directions[ray], batch.t_min, reach, batch.any_hit != 0)
    write_answer(batch, ray, hit)


@wp.kernel(enable_backward=False)
def is_hit(first: int, triangle: wp.array(dtype=int), hit_out: wp.array(dtype=wp.bool)):
    """Tell which of `trace_rays`' answers are hits."""
    i = first + wp.tid()
    hit_out[i] = triangle[i] >= 0
