#pragma once
// A ray through a tree on CUDA: nodes and leaves by loads of four numbers, and a stack of one entry a level.
//
// A thread's stack is in device memory, as are all arrays that are indexed at run time; arrays are in registers if the
// loops over them are unrolled. So children are not sorted, and wait together in one entry: their node, and a mask. The
// octant of the ray gives the order from near to far (Ylitie, Karras and Laine 2017, section 3.2), as in `boxes.h`.
#include "triangles.h"

namespace wrt {
#if !WRT_VECTORS
// The numbers of a node or a leaf. `load` reads four from place i on, a multiple of four, by one load.
struct Floats {
    const float* at;
    WRT_MEMBER explicit Floats(const float* const at) : at(at) {}
    WRT_MEMBER float one(const int i) const { return at[i]; }
    WRT_MEMBER void load(float* to, const int i) const {
        const float4 four = *(const float4*)(at + i);
        to[0] = four.x, to[1] = four.y, to[2] = four.z, to[3] = four.w;
    }
    WRT_MEMBER int id(const int i) const { return ((const int*)at)[i]; }
};
// Those of a node or a leaf between two keys of a deforming mesh.
struct MixedFloats {
    Floats from, to;
    float share;
    WRT_MEMBER float mixed(const float a, const float b) const { return product(1.0f - share, a) + product(share, b); }
    WRT_MEMBER float one(const int i) const { return mixed(from.one(i), to.one(i)); }
    WRT_MEMBER void load(float* out, const int i) const {
        float a[4], b[4];
        from.load(a, i);
        to.load(b, i);
        WRT_UNROLL for (int k = 0; k < 4; ++k) out[k] = mixed(a[k], b[k]);
    }
    WRT_MEMBER int id(const int i) const { return from.id(i); }
};

// The children whose boxes a ray meets, as bits: bit p is child p ^ ray.flip, so the lowest bit is nearest.
template<class Boxes>
WRT_INLINE unsigned children_met(const Boxes& boxes, const Ray& ray, const float t_min, const float t_max) {
    unsigned met = 0;
    WRT_UNROLL for (int first = 0; first < WIDTH; first += 4) {
        float begin[4] = {t_min, t_min, t_min, t_min}, end[4] = {t_max, t_max, t_max, t_max};
        WRT_UNROLL for (int axis = 0; axis < 3; ++axis) {
            float near[4], far[4];
            boxes.load(near, ray.near_row[axis] + first);
            boxes.load(far, ray.far_row[axis] + first);
            WRT_UNROLL for (int k = 0; k < 4; ++k) {
                begin[k] = fmaxf(begin[k], near[k] * ray.inverse[axis] - ray.near_shift[axis]);
                end[k] = fminf(end[k], far[k] * ray.inverse[axis] - ray.far_shift[axis]);
            }
        }
        WRT_UNROLL for (int k = 0; k < 4; ++k) met |= begin[k] <= end[k] * (float)BOX_PAD ? 1u << (first + k) : 0u;
    }
    met = ray.flip & 1 ? (met & 0x55u) << 1 | (met >> 1 & 0x55u) : met;
    met = ray.flip & 2 ? (met & 0x33u) << 2 | (met >> 2 & 0x33u) : met;
    return ray.flip & 4 ? (met & 0x0fu) << 4 | met >> 4 : met;
}
// Where the box of child k begins along a ray.
template<class Boxes> WRT_INLINE float begin_of(const Boxes& boxes, const Ray& ray, const int k) {
    float begin = 0.0f;
    WRT_UNROLL for (int axis = 0; axis < 3; ++axis)
        begin = fmaxf(begin, boxes.one(ray.near_row[axis] + k) * ray.inverse[axis] - ray.near_shift[axis]);
    return begin;
}

// Trace a ray from node `current` on; see `traversal.h`. A waiting child is skipped once a hit is nearer than
// its box. The distance of the box is not kept; three of its numbers are read again.
//
// Each lane of a warp goes on through nodes to a leaf, then all test their leaves together (Aila and Laine 2009). There
// is no other way out of the loops than the one at their ends: lanes that took it would meet the others behind the loops.
template<class Nodes, class Visit>
WRT_INLINE void
follow(const Nodes& tree, const Ray& ray, int current, const float t_min, const float& t_max, Visit visit) {
    constexpr int NOTHING_LEFT = -2147483647 - 1;
    int2 stack[MAX_DEPTH];
    int top = 0, parent = 0;
    unsigned waiting = 0;
    const float reach = t_max;
    do {
        if (current < 0 && visit(current)) top = 0, waiting = 0;
        do {
            if (current >= 0) {
                const unsigned met = children_met(tree.node(current), ray, t_min, t_max);
                if (met) {
                    if (waiting) stack[top++] = make_int2(parent, (int)waiting);
                    parent = current;
                    waiting = met;
                }
            }
            current = NOTHING_LEFT;
            while (current == NOTHING_LEFT && (waiting || top > 0)) {
                if (!waiting) {
                    const int2 entry = stack[--top];
                    parent = entry.x;
                    waiting = (unsigned)entry.y;
                }
                const int k = lowest_bit(waiting) ^ ray.flip;
                waiting &= waiting - 1;
                if (!(t_max < reach && begin_of(tree.node(parent), ray, k) > t_max * (float)BOX_PAD))
                    current = tree.children(parent)[k];
            }
        } while (current >= 0);
    } while (current != NOTHING_LEFT);
}

// Test the triangles of a leaf, four by one set of loads; of equal t the lowest id wins. `skipped(t, id)` returns which
// hits to skip.
template<class Leaf, class Skipped = NoneSkipped>
WRT_INLINE void
test_leaf(const Leaf& leaf, const Ray& ray, const float t_min, Nearest& nearest, Skipped skipped = {}) {
    const int row[3] = {LEAF_SIZE * ray.kx, LEAF_SIZE * ray.ky, LEAF_SIZE * ray.kz};
    WRT_NO_UNROLLING for (int first = 0; first < LEAF_SIZE; first += 4) {
        float corners[3][3][4];
        WRT_UNROLL for (int vertex = 0; vertex < 3; ++vertex)
            WRT_UNROLL for (int axis = 0; axis < 3; ++axis)
                leaf.load(corners[vertex][axis], 3 * LEAF_SIZE * vertex + row[axis] + first);
        WRT_UNROLL for (int k = 0; k < 4; ++k) {
            const auto corner = [&](int vertex, int axis) { return corners[vertex][axis][k]; };
            const auto keep = [&](const float t, const float u, const float v) {
                const int id = leaf.id(9 * LEAF_SIZE + first + k);
                if (!skipped(t, id) && (t < nearest.t || (t == nearest.t && id < nearest.id)))
                    nearest.set(t + 0.0f, u, v, id);
            };
#if defined(WRT_SPHERES)
            if (corner(0, 0) == corner(2, 0) && corner(0, 1) == corner(2, 1) && corner(0, 2) == corner(2, 2)) {
                const int id = leaf.id(9 * LEAF_SIZE + first + k);
                Roots<float> roots;
#if defined(WRT_QUADRICS)
                const auto coordinate = [&](int vertex, int axis) {
                    return leaf.one(LEAF_SIZE * (3 * vertex + axis) + first + k);
                };
                const auto rises = [&](int axis) { return coordinate(0, axis) < coordinate(1, axis); };
                const auto axis_of = [&](int which, int axis) { return ray.axes.of(id, which)[axis]; };
#if defined(WRT_BOXES)
                if (rises(0) == rises(1) && rises(0) != rises(2)) {
                    // From the origin on, not from t_min: a ray may begin within a box.
                    const float entry = entry_of<float>(
                        span_in_box<float>(coordinate, ray.inverse, ray.near_shift, ray.far_shift, 0.0f));
                    if (!skipped.box(entry, id)) nearest.boxes.add(entry, (float)LONGEST, 0, id);
                    continue;
                }
#endif
                if (rises(0) != rises(1)) {
                    const Span<float> span =
                        span_in_box<float>(coordinate, ray.inverse, ray.near_shift, ray.far_shift, t_min);
                    if (!span.begins_before(nearest.t)) continue;
                    roots = roots_of_quadric<float>(
                        coordinate, axis_of, ray.axes.scales_of(id), span, rises(0) == rises(2), ray.origin,
                        ray.shear, ray.kx, ray.ky, ray.kz);
                } else
#endif
                    roots = roots_of<float>(corner, ray.origin, ray.shear, 0, 1, 2);
                if (!((roots.far >= t_min) & (roots.near <= nearest.t))) continue;
                const float t = first_of<float>(
                    roots, [&](float root) { return root > 0.0f && root >= t_min && !skipped(root, id); });
                if (t > 0.0f) keep(t, 0.0f, 0.0f);
                continue;
            }
#endif
            const Sheared<float> s = sheared<float>(corner, ray.origin, ray.shear, 0, 1, 2);
            if (!is_inside(s)) continue;
            const Distance<float> d = distance_of(s, ray.shear);
            if (has_area(d) && d.t >= t_min && d.t <= nearest.t &&
                (d.t > error_of_distance(s, d, ray.shear) || is_ahead(corner, ray.origin, ray.shear)))
                keep(d.t, s.v * d.inverse_det, s.w * d.inverse_det);
        }
    }
}
#endif
} // namespace wrt
