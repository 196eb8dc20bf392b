"""Many rays at once: eight neighbours share the way down the tree as long as they stay together.

A packet visits a node once for all its rays: each of the node's boxes is tested against eight rays,
where a single ray tests eight boxes. The tests of a node do not wait for each other, so a coherent
packet takes little longer than one ray. Where few rays are left in a packet, each goes on alone from
there (Benthin et al., "Combining Single and Packet-Ray Tracing for Arbitrary Ray Distributions on the
Intel MIC Architecture", 2012). A kernel for the CPU: on CUDA it follows its rays one by one, and
`trace_rays` is the way.
"""

import warp as wp

from wrt.kernels.bvh import FOLLOW_RAY, Bvh, native_code
from wrt.kernels.ray_batch import BATCH_OF_RAYS, NAMES_OF_TEST, RayBatch
from wrt.kernels.simd import WOOP_DISTANCE, WOOP_EDGES, WOOP_ERROR

# As many as a vector holds.
PACKET = 8
# Rays left in a packet at which they part, measured.
LONE_RAYS = 4

_PACKET = (
    (
        BATCH_OF_RAYS
        + """
    const int first = packet * PACKET;
    const int left = (int)batch.origins.shape[0] - first, count = left < PACKET ? left : PACKET;

    RayTest tests[PACKET];
    alignas(64) float reach[PACKET], hit_us[PACKET], hit_vs[PACKET];
    alignas(64) int numbers[PACKET];
    for (int i = 0; i < PACKET; ++i) {
        reach[i] = i < count ? load_ray(tests[i], first + i) : -1.0f;
        numbers[i] = NOTHING_HIT;
        hit_us[i] = hit_vs[i] = 0.0f;
    }

    // The way of one ray from a node on.
    const auto follow_alone = [&](int i, int current) {
        if (reach[i] < t_min) return;
        const RayTest& test = tests[i];
"""
        + NAMES_OF_TEST
        + """
        float t_max = reach[i], hit_u = hit_us[i], hit_v = hit_vs[i];
        int id_max = numbers[i];
"""
        + FOLLOW_RAY
        + """
        hit_us[i] = hit_u;
        hit_vs[i] = hit_v;
        numbers[i] = id_max;
        reach[i] = any_hit && id_max != NOTHING_HIT ? -1.0f : t_max;  // a ray that is done reaches nothing
    };

#if VECTOR_CODE
    #define RAY_MASK(m) __builtin_bit_cast(unsigned char, __builtin_convertvector(m, b8))
    // Together go rays of one octant, which share the boxes' near sides, and of one main axis.
    bool together = count == PACKET;
    for (int i = 1; i < count; ++i)
        for (int k = 0; k < 3; ++k)
            together &= tests[i].near_row[k] == tests[0].near_row[k] && tests[i].kz == tests[0].kz;
    if (together) {
        f8 inverse[3], near_shift[3], far_shift[3], origin[3], shear[3];
        for (int k = 0; k < 3; ++k)
            for (int i = 0; i < PACKET; ++i) {
                origin[k][i] = tests[i].origin[k];
                shear[k][i] = tests[i].shear[k];
                inverse[k][i] = tests[i].inverse[k];
                near_shift[k][i] = tests[i].near_shift[k];
                far_shift[k][i] = tests[i].far_shift[k];
            }
        const int kx = tests[0].kx, ky = tests[0].ky, kz = tests[0].kz;
        const int* const near_row = tests[0].near_row;
        const int* const far_row = tests[0].far_row;
        // A stack entry: a child, and where it begins for each ray (infinity for rays that miss it).
        alignas(64) float begins[STACK_SIZE][PACKET];
        int waiting[STACK_SIZE];
        int top = 1;
        waiting[0] = 0;
        *(f8*)begins[0] = t_min;
        while (top > 0) {
            --top;
            const int current = waiting[top];
            const f8 limit = *(const f8*)reach;
            unsigned rays = RAY_MASK(*(const f8*)begins[top] <= limit * pad);
            if (rays == 0) continue;
            if (__builtin_popcount(rays) <= LONE_RAYS) {
                for (; rays; rays &= rays - 1) follow_alone(LOWEST_BIT(rays), current);
                continue;
            }
            if (current < 0) {
                const float* leaf = all_leaves + (size_t)(-1 - current) * (10 * LEAF_SIZE);
                const int* ids = (const int*)(leaf + 9 * LEAF_SIZE);
                f8 best = limit, best_u = *(const f8*)hit_us, best_v = *(const f8*)hit_vs;
                i8 best_id = *(const i8*)numbers;
                for (int j = 0; j < LEAF_SIZE; ++j) {
                    #pragma clang fp contract(off)
                    #define VECTOR f8
                    #define INTEGERS i8
                    #define CORNER(vertex, axis) leaf[3 * LEAF_SIZE * (vertex) + LEAF_SIZE * (axis) + j]
"""
        + WOOP_EDGES
        + """
                    if (RAY_MASK(inside) == 0) continue;
"""
        + WOOP_DISTANCE
        + """
                    const i8 nearer = inside & (t >= t_min) & ((t < best) | ((t == best) & (ids[j] < best_id)));
                    if (RAY_MASK(nearer) == 0) continue;
"""
        + WOOP_ERROR
        + """
                    #undef CORNER
                    #undef VECTOR
                    #undef INTEGERS
                    const i8 better = nearer & clear;
                    best = better ? t : best;
                    best_u = better ? v * inverse_det : best_u;
                    best_v = better ? w * inverse_det : best_v;
                    best_id = better ? (i8)ids[j] : best_id;
                }
                if (any_hit) best = (best_id != NOTHING_HIT) ? (f8)-1.0f : best;
                *(f8*)reach = best;
                *(f8*)hit_us = best_u;
                *(f8*)hit_vs = best_v;
                *(i8*)numbers = best_id;
                continue;
            }
            const float* node = all_nodes + (size_t)current * 56;
            const int* children = (const int*)(node + 48);
            const f8 still = (*(const f8*)begins[top] <= limit * pad) ? limit : (f8)-1.0f;
            const int bottom = top;
            float nearest[8];
            for (int k = 0; k < 8; ++k) {
                const f8 tn = __builtin_elementwise_max(
                    __builtin_elementwise_max(node[near_row[0] + k] * inverse[0] - near_shift[0],
                                              node[near_row[1] + k] * inverse[1] - near_shift[1]),
                    __builtin_elementwise_max(node[near_row[2] + k] * inverse[2] - near_shift[2], (f8)t_min));
                const f8 tf = __builtin_elementwise_min(
                    __builtin_elementwise_min(node[far_row[0] + k] * inverse[0] - far_shift[0],
                                              node[far_row[1] + k] * inverse[1] - far_shift[1]),
                    __builtin_elementwise_min(node[far_row[2] + k] * inverse[2] - far_shift[2], still)) * pad;
                const unsigned mask = RAY_MASK(tn <= tf);
                if (mask == 0) continue;
                const f8 begin = (tn <= tf) ? tn : (f8)__builtin_inff();
                const float key = __builtin_reduce_min(begin);
                int place = top++;
                for (; place > bottom && nearest[place - bottom - 1] < key; --place) {
                    *(f8*)begins[place] = *(const f8*)begins[place - 1];
                    waiting[place] = waiting[place - 1];
                    nearest[place - bottom] = nearest[place - bottom - 1];
                }
                *(f8*)begins[place] = begin;
                waiting[place] = children[k];
                nearest[place - bottom] = key;
                prefetch(children[k]);
            }
        }
    } else
#endif
    for (int i = 0; i < count; ++i) follow_alone(i, 0);

    for (int i = 0; i < count; ++i) write_hit(first + i, numbers[i], reach[i], hit_us[i], hit_vs[i]);
"""
    )
    .replace("PACKET", str(PACKET))
    .replace("LONE_RAYS", str(LONE_RAYS))
)


@wp.func_native(native_code(_PACKET))
def _trace_packet(bvh: Bvh, packet: int, batch: RayBatch): ...


@wp.kernel(enable_backward=False)
def trace_packets(first: int, bvh: Bvh, batch: RayBatch):
    """Trace rays PACKET at a time, one packet a thread."""
    _trace_packet(bvh, first + wp.tid(), batch)
