#pragma once
// Arrays of rays (`kernels/accel/ray_batch.py`): coherent ones in packets, others interleaved, or one by one.
#include "in_turn.h"
#include "instances.h"
#include "together.h"

namespace wrt {
// The greatest distance of a ray in a batch; negative if it cannot hit anything.
template<class Batch> WRT_INLINE float reach_of(const Batch& batch, const int ray) {
    return wp::min(batch.t_max.data[batch.t_max.shape[0] > 1 ? ray : 0], (float)LONGEST);
}
template<class Batch> WRT_INLINE void write_hit(const Batch& batch, const int ray, const Nearest& nearest) {
    const bool hit = nearest.id != NOTHING_HIT;
    batch.triangle_out.data[ray] = hit ? nearest.id : -1;
    if (batch.any_hit) return;
    batch.t_out.data[ray] = hit ? nearest.t : INFINITY;
    batch.uv_out.data[ray] = wp::vec_t<2, float>(nearest.u, nearest.v);
}

#if WRT_VECTORS
// The rays of a chunk, for `follow_in_turn`.
struct BatchTraveller : Traveller {
    Ray ray;
};
template<class Batch> struct RaysInTurn {
    const Batch& batch;
    const Tree all;
    int next, end;

    WRT_MEMBER void start(BatchTraveller& t) {
        for (t.number = -1; next < end && t.number < 0; ++next) {
            const bool runs = set_up(t.ray, batch.origins.data[next], batch.directions.data[next]);
            t.nearest = nothing_before(runs ? reach_of(batch, next) : -1.0f);
            t.current = t.top = 0;
            if (t.nearest.t >= batch.t_min) t.number = next;
            else write_hit(batch, next, nothing_before(0.0f));
        }
    }
    WRT_MEMBER bool branch(BatchTraveller&) { return false; }
    WRT_MEMBER void finish(const BatchTraveller& t) { write_hit(batch, t.number, t.nearest); }
    WRT_MEMBER const Ray& ray(const BatchTraveller& t) { return t.ray; }
    WRT_MEMBER const Tree& tree(const BatchTraveller&) { return all; }
};

// Transpose eight vectors of three to three vectors of eight.
WRT_INLINE void load_vectors(f8* out, const float* from) {
    const f8 a = *(const f8*)from, b = *(const f8*)(from + 8), c = *(const f8*)(from + 16);
    const f8 x = __builtin_shufflevector(a, b, 0, 3, 6, 9, 12, 15, -1, -1);
    const f8 y = __builtin_shufflevector(a, b, 1, 4, 7, 10, 13, -1, -1, -1);
    const f8 z = __builtin_shufflevector(a, b, 2, 5, 8, 11, 14, -1, -1, -1);
    out[0] = __builtin_shufflevector(x, c, 0, 1, 2, 3, 4, 5, 10, 13);
    out[1] = __builtin_shufflevector(y, c, 0, 1, 2, 3, 4, 8, 11, 14);
    out[2] = __builtin_shufflevector(z, c, 0, 1, 2, 3, 4, 9, 12, 15);
}
// Trace a packet of rays of the same octant and main axis; return false for other rays.
template<bool any_hit, class Batch>
static bool trace_together(const Tree& tree, const int first, const Batch& batch) {
    Rays<PACKET> rays;
    f8 origin[3], direction[3];
    load_vectors(origin, (const float*)(batch.origins.data + first));
    load_vectors(direction, (const float*)(batch.directions.data + first));
    const i8 runs = set_up(rays, origin, direction);
    if (mask_of((row(rays.flips) != rays.flips[0]) | (row(rays.kzs) != rays.kzs[0]))) return false;
    const f8 reach = batch.t_max.shape[0] > 1 ? *(const f8*)(batch.t_max.data + first) : (f8)batch.t_max.data[0];
    row(rays.reach) = runs ? least(reach, (f8)(float)LONGEST) : (f8)-1.0f;
    follow_together<any_hit, false, false>(tree, rays, batch.t_min, [&](int node, unsigned some, const f8&) {
        for (; some; some &= some - 1) {
            const int n = lowest_bit(some);
            Nearest nearest = rays.nearest(n);
            find_hit(tree, rays.one(n), node, batch.t_min, any_hit, nearest);
            if (any_hit && nearest.id != NOTHING_HIT) nearest.t = -1.0f;
            rays.set(n, nearest);
        }
    });
    for (int i = 0; i < PACKET; ++i) write_hit(batch, first + i, rays.nearest(i));
    return true;
}
#endif
// Trace a single ray.
template<class Bvh, class Batch> WRT_INLINE void trace_one(const Bvh& bvh, const int i, const Batch& batch) {
    Ray ray;
    const bool runs = set_up(ray, batch.origins.data[i], batch.directions.data[i]);
    Nearest nearest = nothing_before(runs ? reach_of(batch, i) : -1.0f);
    if (nearest.t >= batch.t_min) find_hit(tree_of(bvh), ray, 0, batch.t_min, batch.any_hit != 0, nearest);
    write_hit(batch, i, nearest);
}
// The same among instances; triangles are numbered through all of them.
template<class Placed, class Batch>
WRT_INLINE void trace_one_in_instances(const Placed& placed, const int i, const Batch& batch) {
    const float reach = reach_of(batch, i);
    Nearest nearest = nothing_before(reach);
    if (reach >= batch.t_min) {
        const InstanceFound found = closest_instance_hit<Instances::still>(
            placed, Axes(), batch.origins.data[i], batch.directions.data[i], 0.0f, batch.t_min, reach,
            batch.any_hit != 0);
        if (bits_of(found[0]) >= 0) nearest.set(found[2], found[3], found[4], bits_of(found[1]));
    }
    write_hit(batch, i, nearest);
}

// The rays of one thread, of `count` each; on CUDA, where the hardware interleaves warps, one by one.
template<class Bvh, class Batch> WRT_INLINE void trace_chunk(const Bvh& bvh, const int chunk, const Batch& batch) {
    const int first = chunk * RAYS_PER_THREAD, end = wp::min(first + RAYS_PER_THREAD, (int)batch.origins.shape[0]);
#if WRT_VECTORS
    RaysInTurn<Batch> rays = {batch, tree_of(bvh), first, end};
    if (batch.any_hit) follow_in_turn<true, RAYS_IN_TURN, BatchTraveller>(batch.t_min, RAYS_IN_TURN, 5, rays);
    else follow_in_turn<false, RAYS_IN_TURN, BatchTraveller>(batch.t_min, RAYS_IN_TURN, 5, rays);
#else
    for (int i = first; i < end; ++i) trace_one(bvh, i, batch);
#endif
}
template<class Bvh, class Batch> WRT_INLINE void trace_packet(const Bvh& bvh, const int packet, const Batch& batch) {
    const int first = packet * PACKET, end = wp::min(first + PACKET, (int)batch.origins.shape[0]);
#if WRT_VECTORS
    const Tree tree = tree_of(bvh);
    if (end - first == PACKET &&
        (batch.any_hit ? trace_together<true>(tree, first, batch) : trace_together<false>(tree, first, batch)))
        return;
#endif
    for (int i = first; i < end; ++i) trace_one(bvh, i, batch);
}
} // namespace wrt
