"""Many rays at once: eight neighbours share the way down the tree as long as they stay together.

A packet visits a node once for all its rays: each of the node's boxes is tested against eight rays,
where a single ray tests eight boxes. The tests of a node do not wait for each other, so a coherent
packet takes little longer than one ray. Where few rays are left in a packet, each goes on alone from
there (Benthin et al., "Combining Single and Packet-Ray Tracing for Arbitrary Ray Distributions on the
Intel MIC Architecture", 2012). A kernel for the CPU: on CUDA it follows its rays one by one, and
`trace_rays` is the way.
"""

import warp as wp

from wrt.kernels.bvh import FOLLOW_RAY, RAY_SLAB, Bvh, native_code
from wrt.kernels.ray_batch import BATCH_OF_RAYS, NAMES_OF_TEST, RayBatch
from wrt.kernels.simd import LEAF_TOGETHER

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
    unsigned prepared = 0;
    alignas(64) float reach[PACKET], hit_us[PACKET], hit_vs[PACKET];
    alignas(64) int numbers[PACKET];
    for (int i = 0; i < PACKET; ++i) {
        numbers[i] = NOTHING_HIT;
        hit_us[i] = hit_vs[i] = 0.0f;
    }

    // The way of one ray from a node on.
    const auto follow_alone = [&](int i, int current) {
        if (!(prepared >> i & 1)) load_ray(tests[i], first + i);
        prepared |= 1u << i;
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
    // Eight vectors of three as three of eight.
    const auto load_vectors = [](f8* out, const float* from) {
        const f8 a = LOAD8(from), b = LOAD8(from + 8), c = LOAD8(from + 16);
        const f8 x = __builtin_shufflevector(a, b, 0, 3, 6, 9, 12, 15, -1, -1);
        const f8 y = __builtin_shufflevector(a, b, 1, 4, 7, 10, 13, -1, -1, -1);
        const f8 z = __builtin_shufflevector(a, b, 2, 5, 8, 11, 14, -1, -1, -1);
        out[0] = __builtin_shufflevector(x, c, 0, 1, 2, 3, 4, 5, 10, 13);
        out[1] = __builtin_shufflevector(y, c, 0, 1, 2, 3, 4, 8, 11, 14);
        out[2] = __builtin_shufflevector(z, c, 0, 1, 2, 3, 4, 9, 12, 15);
    };
    #define RAY_MASK(m) __builtin_bit_cast(unsigned char, __builtin_convertvector(m, b8))
    // Together go rays of one octant, which share the boxes' near sides, and of one main axis: for all of
    // them RAY_SETUP is done at once.
    bool together = count == PACKET;
    f8 origin[3], direction[3], inverse[3], near_shift[3], far_shift[3], shear[3];
    int near_row[3], far_row[3], kx = 0, ky = 0, kz = 0;
    if (together) {
        load_vectors(origin, (const float*)(batch.origins.data + first));
        load_vectors(direction, (const float*)(batch.directions.data + first));
        for (int k = 0; k < 3; ++k) {
            const f8 d = direction[k], o = origin[k];
"""
        + RAY_SLAB.replace("NUMBER", "f8")
        + """
            inverse[k] = inverse_d;
            near_shift[k] = shift + error;
            far_shift[k] = shift - error;
            const unsigned backwards = RAY_MASK(inverse[k] < 0.0f);
            together &= backwards == 0 || backwards == 0xff;
            near_row[k] = (backwards ? 24 : 0) + 8 * k;
            far_row[k] = (backwards ? 0 : 24) + 8 * k;
        }
        const f8 dx = SIZE(direction[0]), dy = SIZE(direction[1]), dz = SIZE(direction[2]);
        const unsigned along_x = RAY_MASK((dx > dy) & (dx > dz)), along_y = RAY_MASK(!(dx > dy) & (dy > dz));
        together &= along_x == 0xff || along_y == 0xff || (along_x | along_y) == 0;
        kz = along_x ? 0 : along_y ? 1 : 2;
        kx = kz == 2 ? 0 : kz + 1;
        ky = kx == 2 ? 0 : kx + 1;
        shear[0] = direction[kx] * inverse[kz];
        shear[1] = direction[ky] * inverse[kz];
        shear[2] = inverse[kz];
        const f8 most = batch.t_max.shape[0] > 1 ? LOAD8(batch.t_max.data + first) : (f8)batch.t_max.data[0];
        const f8 length = dx + dy + dz;
        const auto runs = length + 0.0f * (length + near_shift[0] + near_shift[1] + near_shift[2]) > 0.0f;
        *(f8*)reach = runs ? LEAST(most, (f8)3.4028235e38f) : (f8)-1.0f;
    }
    if (together) {
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
            const i8 within = *(const f8*)begins[top] <= limit * pad;
            unsigned rays = RAY_MASK(within);
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
                #define VECTOR f8
                #define INTEGERS i8
                #define CORNER(vertex, axis) leaf[3 * LEAF_SIZE * (vertex) + LEAF_SIZE * (axis) + j]
                #define ANY(c) (RAY_MASK(c) != 0)
"""
        + LEAF_TOGETHER
        + """
                #undef ANY
                #undef CORNER
                #undef VECTOR
                #undef INTEGERS
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
                const f8 near_x = LESS((f8)node[near_row[0] + k], inverse[0], near_shift[0]);
                const f8 near_y = LESS((f8)node[near_row[1] + k], inverse[1], near_shift[1]);
                const f8 near_z = LESS((f8)node[near_row[2] + k], inverse[2], near_shift[2]);
                const f8 far_x = LESS((f8)node[far_row[0] + k], inverse[0], far_shift[0]);
                const f8 far_y = LESS((f8)node[far_row[1] + k], inverse[1], far_shift[1]);
                const f8 far_z = LESS((f8)node[far_row[2] + k], inverse[2], far_shift[2]);
                const f8 tn = MOST(MOST(near_x, near_y), MOST(near_z, (f8)t_min));
                const f8 tf = LEAST(LEAST(far_x, far_y), LEAST(far_z, still)) * pad;
                const unsigned mask = RAY_MASK(tn <= tf);
                if (mask == 0) continue;
                const f8 begin = (tn <= tf) ? tn : (f8)__builtin_inff();
                // By halves: clang's __builtin_reduce_min takes one after the other.
                const f8 four = LEAST(begin, __builtin_shufflevector(begin, begin, 4, 5, 6, 7, 0, 1, 2, 3));
                const f8 two = LEAST(four, __builtin_shufflevector(four, four, 2, 3, 0, 1, 6, 7, 4, 5));
                const float key = LEAST(two[0], two[1]);
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
        // An infinite distance where nothing is hit.
        const i8 number = *(const i8*)numbers, hit = number != NOTHING_HIT;
        *(i8*)(batch.triangle_out.data + first) = hit ? number : (i8)-1;
        if (any_hit) return;
        *(f8*)(batch.t_out.data + first) = hit ? *(const f8*)reach : (f8)INFINITY;
        float* const uv = (float*)(batch.uv_out.data + first);
        for (int i = 0; i < PACKET; ++i) {
            uv[2 * i] = hit_us[i];
            uv[2 * i + 1] = hit_vs[i];
        }
        return;
    }
#endif
    for (int i = 0; i < count; ++i) {
        reach[i] = load_ray(tests[i], first + i);
        prepared |= 1u << i;
        if (reach[i] >= t_min) follow_alone(i, 0);
        write_hit(first + i, numbers[i], reach[i], hit_us[i], hit_vs[i]);
    }
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
