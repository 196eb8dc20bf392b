"""Several rays in one thread, a step of each in turn.

A ray's next step waits for the last one: for memory, and for a chain of dependent instructions. The
steps of other rays do not, so a processor that looks ahead works on all of them at once. For that
nothing must make it guess wrongly, as a mistaken branch throws away the work of every ray: where
`FOLLOW_RAY` sorts the two or three boxes that a ray meets in a loop, here a fixed network sorts all
eight. And what a ray needs next is fetched while the others have their turns. Measured on one thread
and incoherent rays, in units of single rays: on 82 k triangles a loop with two rays in turn 1.1, a
network with one 0.93, with two 1.4, with three to six 1.6; on 5.2 M triangles, four in turn 1.3, with
fetching ahead 1.7, six 2.1, eight 2.3 (but 0.95 of four on the small mesh).

A kernel for the CPU; on CUDA the hardware does this with whole warps, and `trace_rays` is the way.
"""

import warp as wp

from wrt.kernels.bvh import Bvh, native_code
from wrt.kernels.ray_batch import BATCH_OF_RAYS, NAMES_OF_TEST, RayBatch
from wrt.kernels.simd import BOX_TEST, TRIANGLE_TEST

RAYS_PER_THREAD = 64
RAYS_IN_TURN = 6


def _sorting_network() -> str:
    """Return C++ that sorts the eight elements of `key`, greatest first (Batcher 1968, bitonic)."""
    steps = []
    for block in (2, 4, 8):
        distance = block // 2
        while distance > 0:
            partners = [i ^ distance for i in range(8)]
            takes_greater = [((i & distance) == 0) == ((i & block) == 0) for i in range(8)]
            choice = [i if greater else i + 8 for i, greater in enumerate(takes_greater)]
            steps.append((partners, choice))
            distance //= 2
    return "".join(
        f"""
            {{
                const i8 other = __builtin_shufflevector(key, key, {", ".join(map(str, partners))});
                const i8 greater = __builtin_elementwise_max(key, other), less = __builtin_elementwise_min(key, other);
                key = __builtin_shufflevector(greater, less, {", ".join(map(str, choice))});
            }}"""
        for partners, choice in steps
    )


# Put the children that the ray meets on its stack, the nearest on top, without a branch: those it
# misses sort below all others and lie above the top, where the next children overwrite them. A key
# is where the box begins, its last three bits replaced by the child's place (and not looked at again).
_PUSH = (
    """
#if VECTOR_CODE
            const i8 places = {0, 1, 2, 3, 4, 5, 6, 7};
            i8 key = (__builtin_bit_cast(i8, tn) & ~7) | places;
            key = (tn <= tf) ? key : (i8)-1;
"""
    + _sorting_network()
    + """
            *(i8*)(r.begins + r.top) = key;
#if defined(__AVX2__)
            *(i8*)(r.waiting + r.top) = __builtin_ia32_permvarsi256(*(const i8*)children, key & 7);
#else
            for (int k = 0; k < 8; ++k) r.waiting[r.top + k] = children[key[k] & 7];
#endif
            r.top += __builtin_popcount(mask);
#else
            const int bottom = r.top;
            for (unsigned rest = mask; rest; rest &= rest - 1) {
                const int k = LOWEST_BIT(rest);
                int bits;
                memcpy(&bits, &begin[k], 4);
                int place = r.top++;
                for (; place > bottom && r.begins[place - 1] < bits; --place) {
                    r.begins[place] = r.begins[place - 1];
                    r.waiting[place] = r.waiting[place - 1];
                }
                r.begins[place] = bits;
                r.waiting[place] = children[k];
            }
#endif
"""
)

# One step of the ray called RAY: a node or a leaf, and the choice of the next.
_STEP = (
    """
    if (RAY.number >= 0) {
        Ray& r = RAY;
        const RayTest& test = r.test;
        float &t_max = r.t_max, &hit_u = r.hit_u, &hit_v = r.hit_v;
        int& id_max = r.id_max;
"""
    + NAMES_OF_TEST
    + """
        if (r.current >= 0) {
            const float* node = all_nodes + (size_t)r.current * 56;
            const int* children = (const int*)(node + 48);
"""
    + BOX_TEST
    + _PUSH
    + """
        } else {
            const float* leaf = all_leaves + (size_t)(-1 - r.current) * (10 * LEAF_SIZE);
"""
    + TRIANGLE_TEST
    + """
            if (any_hit && id_max != NOTHING_HIT) r.top = 0;
        }
        const float limit = t_max * pad;
        int limit_bits;
        memcpy(&limit_bits, &limit, 4);
        for (;;) {
            if (r.top == 0) {
                write_hit(r.number, id_max, t_max, hit_u, hit_v);
                start(r);
                break;
            }
            --r.top;
            if ((r.begins[r.top] & ~7) <= limit_bits) {
                r.current = r.waiting[r.top];
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
