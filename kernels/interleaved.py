"""Several rays in one thread, a step of each in turn.

A ray's next step waits for the last one: for memory, and for a chain of dependent instructions. The
steps of other rays do not, so a processor that looks ahead works on all of them at once. For that
nothing must make it guess wrongly, as a mistaken branch throws away the work of every ray: hence children
are pushed without one (`PUSH_CHILDREN`). And what a ray needs next is fetched while the others have their
turns. Measured on one thread and incoherent rays, when children were still sorted by a network, in units
of single rays: on 82 k triangles two in turn 1.4, three to six 1.6; on 5.2 M triangles four in turn 1.3,
with fetching ahead 1.7, six 2.1, eight 2.3 (but 0.95 of four on the small mesh).

A kernel for the CPU; on CUDA the hardware does this with whole warps, and `trace_rays` is the way.
"""

import warp as wp

from wrt.kernels.bvh import Bvh, native_code
from wrt.kernels.ray_batch import BATCH_OF_RAYS, NAMES_OF_TEST, RayBatch
from wrt.kernels.simd import BOX_TEST, PUSH_CHILDREN, TRIANGLE_TEST

RAYS_PER_THREAD = 64
RAYS_IN_TURN = 5


# One step of the ray called RAY: a node or a leaf, and the choice of the next.
_STEP = (
    """
    if (RAY.number >= 0) {
        Ray& r = RAY;
        const RayTest& test = r.test;
        float &t_max = r.t_max, &hit_u = r.hit_u, &hit_v = r.hit_v;
        int &id_max = r.id_max, &top = r.top;
        int *const begins = r.begins, *const waiting = r.waiting;
"""
    + NAMES_OF_TEST
    + """
        if (r.current >= 0) {
            const float* node = all_nodes + (size_t)r.current * 56;
            const int* children = (const int*)(node + 48);
"""
    + BOX_TEST
    + PUSH_CHILDREN
    + """
        } else {
            const float* leaf = all_leaves + (size_t)(-1 - r.current) * (10 * LEAF_SIZE);
"""
    + TRIANGLE_TEST
    + """
            if (any_hit && id_max != NOTHING_HIT) top = 0;
        }
        const float limit = t_max * pad;
        int limit_bits;
        memcpy(&limit_bits, &limit, 4);
        for (;;) {
            if (top == 0) {
                write_hit(r.number, id_max, t_max, hit_u, hit_v);
                start(r);
                break;
            }
            --top;
            if (begins[top] <= limit_bits) {
                r.current = waiting[top];
                prefetch(r.current);
                break;
            }
        }
    }
"""
)

_INTERLEAVED = (
    BATCH_OF_RAYS
    + """
    struct Ray {
        RayTest test;
        float t_max, hit_u, hit_v;
        int id_max, current, top, number;
        int begins[STACK_SIZE + 8], waiting[STACK_SIZE + 8];
    };
    int next = chunk * RAYS_PER_THREAD, live = 0;
    const int left = (int)batch.origins.shape[0] - next;
    const int end = next + (left < RAYS_PER_THREAD ? left : RAYS_PER_THREAD);

    // Take the next ray that can hit anything in the place of one that is done.
    const auto start = [&](Ray& r) {
        if (r.number >= 0) --live;
        for (r.number = -1; next < end && r.number < 0; ++next) {
            r.t_max = load_ray(r.test, next);
            r.hit_u = r.hit_v = 0.0f;
            r.id_max = NOTHING_HIT;
            r.current = r.top = 0;
            if (r.t_max >= t_min) {
                r.number = next;
                ++live;
            } else {
                write_hit(next, NOTHING_HIT, 0.0f, 0.0f, 0.0f);
            }
        }
    };
    // While the other rays have their turns, what this one needs next comes from memory.
    Ray rays[RAYS_IN_TURN];
    for (int i = 0; i < RAYS_IN_TURN; ++i) {
        rays[i].number = -1;
        start(rays[i]);
    }
    while (live > 0) {
"""
    + "".join(_STEP.replace("RAY.", f"rays[{i}].").replace("= RAY;", f"= rays[{i}];") for i in range(RAYS_IN_TURN))
    + """
    }
"""
)


@wp.func_native(
    native_code(
        _INTERLEAVED.replace("RAYS_PER_THREAD", str(RAYS_PER_THREAD)).replace("RAYS_IN_TURN", str(RAYS_IN_TURN))
    )
)
def _trace_chunk(bvh: Bvh, chunk: int, batch: RayBatch): ...


@wp.kernel(enable_backward=False)
def trace_interleaved(first: int, bvh: Bvh, batch: RayBatch):
    """Trace RAYS_PER_THREAD rays a thread, RAYS_IN_TURN at a time."""
    _trace_chunk(bvh, first + wp.tid(), batch)
