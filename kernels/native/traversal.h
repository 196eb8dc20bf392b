#pragma once
// A single ray through a tree.
#include "gpu.h"
#include "triangles.h"

namespace wrt {
// The arrays of a tree (`kernels/core/ray_tree.py`).
struct Tree {
    const float *nodes, *leaves;
#if WRT_VECTORS
    typedef const float* Floats;
#endif
    WRT_MEMBER const float* at(const int i) const { return nodes + (size_t)i * NODE_FLOATS; }
    WRT_MEMBER Floats node(const int i) const { return Floats(at(i)); }
    WRT_MEMBER const int* children(const int i) const { return (const int*)(at(i) + 6 * WIDTH); }
    WRT_MEMBER Floats leaf(const int child) const { return Floats(leaves + (size_t)(-1 - child) * LEAF_FLOATS); }
    // Prefetch a node or a leaf for a later visit. A leaf has five cache lines, a node four.
    WRT_MEMBER void prefetch(const int child, const int lines = 5) const {
#if WRT_VECTORS
        const char* const place = (const char*)(child >= 0 ? node(child) : leaf(child));
        for (int line = 0; line < lines; ++line) __builtin_prefetch(place + 64 * line);
#endif
    }
};
template<class Bvh> WRT_INLINE Tree tree_of(const Bvh& bvh) {
    return {(const float*)bvh.nodes.data, (const float*)bvh.leaves.data};
}

#if WRT_VECTORS
// Trace a ray from node `current` on. `visit(leaf)` processes a leaf, may shorten `t_max`, and returns whether the ray is
// done.
template<class Nodes, class Visit>
WRT_INLINE void
follow(const Nodes& tree, const Ray& ray, int current, const float t_min, const float& t_max, Visit visit) {
    int begins[STACK_SIZE + 8], waiting[STACK_SIZE + 8], top = 0;
    const Stack stack = {begins, waiting, top};
    do {
        if (current >= 0) push_children(tree.node(current), tree.children(current), ray, t_min, t_max, stack);
        else if (visit(current)) return;
    } while (pop_child(current, t_max, stack));
}
#endif

// Find the nearest hit of a ray below node `current`, or any hit; `skipped` as in `test_leaf`.
template<class Nodes, class Skipped = NoneSkipped>
WRT_INLINE void find_hit(
    const Nodes& tree, const Ray& ray, const int current, const float t_min, const bool any_hit, Nearest& nearest,
    Skipped skipped = {}) {
    follow(tree, ray, current, t_min, nearest.t, [&](int leaf) {
        test_leaf(tree.leaf(leaf), ray, t_min, nearest, skipped);
        return any_hit && nearest.id != NOTHING_HIT;
    });
}

// `axes` is where the vectors of disks and cylinders are, as in all functions below.
template<class Bvh, class Vector, class Skipped = NoneSkipped>
WRT_INLINE Nearest trace_ray(
    const Bvh& bvh, const Axes& axes, const Vector& origin, const Vector& direction, const float t_min, const float t_max,
    const bool any_hit, Skipped skipped = {}) {
    Ray ray;
    ray.axes = axes;
    Nearest nearest = nothing_before(t_max);
    if (set_up(ray, origin, direction)) find_hit(tree_of(bvh), ray, 0, t_min, any_hit, nearest, skipped);
    return nearest;
}
// A hit as numbers: its own, t, u and v; then the number of the first box, where it is entered, and the second is.
#if defined(WRT_BOXES)
typedef wp::vec_t<7, float> Found;
#else
typedef wp::vec_t<4, float> Found;
#endif
WRT_INLINE Found found_of(const Nearest& nearest) {
    Found found;
    found[0] = float_of(nearest.id == NOTHING_HIT ? -1 : nearest.id);
    found[1] = nearest.t;
    found[2] = nearest.u;
    found[3] = nearest.v;
#if defined(WRT_BOXES)
    found[4] = float_of(nearest.boxes.id == NOTHING_HIT ? -1 : nearest.boxes.id);
    found[5] = nearest.boxes.first;
    found[6] = nearest.boxes.second;
#endif
    return found;
}
// The nearest hit up to t_max, of equal ones that with the lowest number, or any hit.
template<class Bvh, class Vector>
WRT_INLINE Found closest_hit(
    const Bvh& bvh, const Axes& axes, const Vector& origin, const Vector& direction, float t_max, bool any_hit) {
    return found_of(trace_ray(bvh, axes, origin, direction, 0.0f, t_max, any_hit));
}
// The nearest of the hits after (t_min, id_min), ordered by distance, then number.
template<class Bvh, class Vector>
WRT_INLINE Found next_hit(
    const Bvh& bvh, const Axes& axes, const Vector& origin, const Vector& direction, float t_min, float t_max,
    int id_min) {
    return found_of(trace_ray(bvh, axes, origin, direction, t_min, t_max, false, SkippedUpTo{t_min, id_min}));
}
#if defined(WRT_BOXES)
// The box that is entered after the one with this number at t_min, and before t_max; there is no hit.
template<class Bvh, class Vector>
WRT_INLINE Found next_box(
    const Bvh& bvh, const Axes& axes, const Vector& origin, const Vector& direction, float t_min, float t_max,
    int id_min) {
    return found_of(trace_ray(bvh, axes, origin, direction, t_min, t_max, false, AllButLaterBoxes{t_min, id_min}));
}
#endif
} // namespace wrt
