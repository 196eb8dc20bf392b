#pragma once
// Rays that descend the tree side by side: each box and each triangle is tested against all rays.
//
// When few rays are left at a node, each leaves the group and goes on alone from there (Benthin et al., "Combining
// Single and Packet-Ray Tracing for Arbitrary Ray Distributions on the Intel MIC Architecture", 2012).
#include "traversal.h"

#if WRT_VECTORS
namespace wrt {
// Vectors with a number for each of N rays.
template<int N> struct Of {
    typedef float floats __attribute__((ext_vector_type(N)));
    typedef int ints __attribute__((ext_vector_type(N)));
    typedef bool bools __attribute__((ext_vector_type(N)));
};
// An array with one number for each ray, as a vector.
template<class T, int N> struct RowOf {
    typedef T vector __attribute__((ext_vector_type(N)));
};
template<class T, int N> struct RowOf<const T, N> {
    typedef const typename RowOf<T, N>::vector vector;
};
template<class T, int N> WRT_INLINE typename RowOf<T, N>::vector& row(T (&numbers)[N]) {
    return *(typename RowOf<T, N>::vector*)numbers;
}

#if defined(WRT_BOXES)
// The boxes that N rays enter.
template<int N> struct alignas(64) EntriesOfRays {
    typedef EntriesOf<typename Of<N>::floats, typename Of<N>::ints> All;
    All all;

    WRT_MEMBER Entries one(const int n) const { return {all.first[n], all.second[n], all.instance[n], all.id[n]}; }
    WRT_MEMBER void set(const int n, const Entries& one) {
        all.first[n] = one.first;
        all.second[n] = one.second;
        all.instance[n] = one.instance;
        all.id[n] = one.id;
    }
    WRT_MEMBER void clear() { all.clear(); }
};
#else
template<int N> struct EntriesOfRays {
    WRT_MEMBER Entries one(int) const { return {}; }
    WRT_MEMBER void set(int, const Entries&) {}
    WRT_MEMBER void clear() {}
};
#endif

// `Ray` for N rays, and their hits. A ray that is done has a negative reach.
template<int N> struct alignas(64) Rays {
    float origins[3][N], shears[3][N];
    float inverses[3][N], near_shifts[3][N], far_shifts[3][N];
    int near_rows[3][N], far_rows[3][N], kxs[N], kys[N], kzs[N], flips[N];
    float reach[N], us[N], vs[N];
    int ids[N];
    [[no_unique_address]] Axes axes;
    [[no_unique_address]] EntriesOfRays<N> boxes;

    WRT_MEMBER Ray one(const int n) const {
        Ray ray;
        WRT_UNROLL for (int k = 0; k < 3; ++k) {
            ray.inverse[k] = inverses[k][n];
            ray.near_shift[k] = near_shifts[k][n];
            ray.far_shift[k] = far_shifts[k][n];
            ray.near_row[k] = near_rows[k][n];
            ray.far_row[k] = far_rows[k][n];
            ray.origin[k] = origins[k][n];
            ray.shear[k] = shears[k][n];
        }
        ray.flip = flips[n];
        ray.kx = kxs[n];
        ray.ky = kys[n];
        ray.kz = kzs[n];
        ray.axes = axes;
        return ray;
    }
    WRT_MEMBER Nearest nearest(const int n) const { return {reach[n], us[n], vs[n], ids[n], boxes.one(n)}; }
    WRT_MEMBER void set(const int n, const Nearest& nearest) {
        reach[n] = nearest.t;
        us[n] = nearest.u;
        vs[n] = nearest.v;
        ids[n] = nearest.id;
        boxes.set(n, nearest.boxes);
    }
};

// Prepare rays, as `set_up` does one, and return which can hit anything; the caller sets `reach`.
template<int N> WRT_INLINE typename Of<N>::ints
set_up(Rays<N>& a, const typename Of<N>::floats* origin, const typename Of<N>::floats* direction) {
    typedef typename Of<N>::floats Floats;
    typedef typename Of<N>::ints Ints;
    Floats inverse[3], shifts = 0.0f;
    Ints flip = 7;
    WRT_UNROLL for (int k = 0; k < 3; ++k) {
        const Slab<Floats> slab = slab_of(direction[k], origin[k]);
        const Ints backwards = slab.inverse < 0.0f;
        inverse[k] = slab.inverse;
        flip += backwards * (1 << k);
        shifts += slab.shift + slab.error;
        row(a.inverses[k]) = slab.inverse;
        row(a.near_shifts[k]) = slab.shift + slab.error;
        row(a.far_shifts[k]) = slab.shift - slab.error;
        row(a.near_rows[k]) = (backwards & 24) + 8 * k;
        row(a.far_rows[k]) = (~backwards & 24) + 8 * k;
    }
    const Floats dx = size(direction[0]), dy = size(direction[1]), dz = size(direction[2]), length = dx + dy + dz;
    const Ints kz = dx > dy ? (dx > dz ? (Ints)0 : (Ints)2) : (dy > dz ? (Ints)1 : (Ints)2);
    const Ints kx = kz == 2 ? (Ints)0 : kz + 1, ky = kx == 2 ? (Ints)0 : kx + 1;
    const auto along = [](Ints axis, const Floats* v) { return axis == 0 ? v[0] : (axis == 1 ? v[1] : v[2]); };
    const Floats inverse_z = along(kz, inverse);
    row(a.origins[0]) = along(kx, origin);
    row(a.origins[1]) = along(ky, origin);
    row(a.origins[2]) = along(kz, origin);
    row(a.shears[0]) = along(kx, direction) * inverse_z;
    row(a.shears[1]) = along(ky, direction) * inverse_z;
    row(a.shears[2]) = inverse_z;
    row(a.kxs) = kx;
    row(a.kys) = ky;
    row(a.kzs) = kz;
    row(a.flips) = flip;
    row(a.us) = row(a.vs) = (Floats)0.0f;
    row(a.ids) = (Ints)NOTHING_HIT;
    a.boxes.clear();
    return length + 0.0f * (length + shifts) > 0.0f;
}

// Test the triangles of a leaf one by one against the rays that are `within` its box. A first pass finds without
// branches the triangles that the line of any ray meets; a second completes the test for these, at the cost of computing
// their edges twice. The rays share the main axis of ray `one`, or have any (`axes`).
template<int N, bool any_hit, bool axes>
WRT_INLINE void test_leaf(
    const float* leaf, Rays<N>& a, const typename Of<N>::ints within, const int one, const float t_min) {
    typedef typename Of<N>::floats Floats;
    typedef typename Of<N>::ints Ints;
    typedef typename Of<N>::bools Bools;
    const int* ids = (const int*)(leaf + 9 * LEAF_SIZE);
    // With several main axes, the coordinates are permuted to the order of the test.
    const Ints main_axis = row(a.kzs);
    const Bools is_x = __builtin_convertvector(main_axis == 0, Bools);
    const Bools is_y = __builtin_convertvector(main_axis == 1, Bools);
    const int kx = axes ? 0 : a.kxs[one], ky = axes ? 1 : a.kys[one], kz = axes ? 2 : a.kzs[one];
    const auto in_order = [&](int axis, Floats x, Floats y, Floats z) WRT_INLINE_LAMBDA -> Floats {
        return axis == 0 ? (is_x ? y : (is_y ? z : x)) : axis == 1 ? (is_x ? z : (is_y ? x : y))
                                                           : (is_x ? x : (is_y ? y : z));
    };
    Floats origin[3], shear[3];
    for (int k = 0; k < 3; ++k) origin[k] = row(a.origins[k]), shear[k] = row(a.shears[k]);
    Floats best = row(a.reach), best_u = row(a.us), best_v = row(a.vs);
    Ints best_id = row(a.ids);
    const auto corner_of = [&](int j, int vertex, int axis) WRT_INLINE_LAMBDA -> Floats {
        const float* c = leaf + 3 * LEAF_SIZE * vertex + j;
        if (!axes) return (Floats)c[LEAF_SIZE * axis];
        return in_order(axis, (Floats)c[0], (Floats)c[LEAF_SIZE], (Floats)c[2 * LEAF_SIZE]);
    };
    const auto sheared_triangle = [&](int j) WRT_INLINE_LAMBDA {
        const auto corner = [&](int vertex, int axis) WRT_INLINE_LAMBDA { return corner_of(j, vertex, axis); };
        return sheared<Floats>(corner, origin, shear, kx, ky, kz);
    };
#if defined(WRT_SPHERES)
    const auto keep_first = [&](int j, const Roots<Floats>& roots) WRT_INLINE_LAMBDA {
        const Floats t = first_of(
            roots, [&](const Floats& root) WRT_INLINE_LAMBDA { return (root > 0.0f) & (root >= t_min); });
        const Ints better = within & (t > 0.0f) & ((t < best) | ((t == best) & (ids[j] < best_id)));
        best = better ? t : best;
        best_u = better ? (Floats)0.0f : best_u;
        best_v = better ? (Floats)0.0f : best_v;
        best_id = better ? (Ints)ids[j] : best_id;
    };
    const auto test_sphere = [&](int j) WRT_INLINE_LAMBDA {
        const auto corner = [&](int vertex, int axis) WRT_INLINE_LAMBDA { return corner_of(j, vertex, axis); };
#if defined(WRT_QUADRICS)
        const auto rises = [&](int axis) WRT_INLINE_LAMBDA {
            return leaf[LEAF_SIZE * axis + j] < leaf[LEAF_SIZE * (3 + axis) + j];
        };
#if defined(WRT_BOXES)
        const bool is_box = rises(0) == rises(1) && rises(0) != rises(2);
#else
        constexpr bool is_box = false;
#endif
        if (is_box || rises(0) != rises(1)) {
            const auto of_box = [&](int vertex, int axis) WRT_INLINE_LAMBDA -> Floats {
                return (Floats)leaf[LEAF_SIZE * (3 * vertex + axis) + j];
            };
            Floats inverse[3], near_shift[3], far_shift[3];
            for (int k = 0; k < 3; ++k) {
                inverse[k] = row(a.inverses[k]);
                near_shift[k] = row(a.near_shifts[k]);
                far_shift[k] = row(a.far_shifts[k]);
            }
#if defined(WRT_BOXES)
            if (is_box) {
                const Floats entry =
                    entry_of<Floats>(span_in_box<Floats>(of_box, inverse, near_shift, far_shift, 0.0f));
                a.boxes.all.add(within ? entry : (Floats)(float)LONGEST, (Floats)(float)LONGEST, (Ints)0, (Ints)ids[j]);
                return;
            }
#endif
            const Span<Floats> span = span_in_box<Floats>(of_box, inverse, near_shift, far_shift, t_min);
            if (mask_of(span.begins_before(best) & within) == 0) return;
            const auto axis_of = [&](int which, int axis) WRT_INLINE_LAMBDA -> Floats {
                const float* v = a.axes.of(ids[j], which);
                return axes ? in_order(axis, (Floats)v[0], (Floats)v[1], (Floats)v[2]) : (Floats)v[axis];
            };
            const bool is_disk = rises(0) == rises(2);
            const Scales scales = a.axes.scales_of(ids[j]);
            keep_first(j, roots_of_quadric<Floats>(corner, axis_of, scales, span, is_disk, origin, shear, kx, ky, kz));
            return;
        }
#endif
        keep_first(j, roots_of<Floats>(corner, origin, shear, kx, ky, kz));
    };
#endif
    unsigned some = 0;
    WRT_NO_UNROLLING for (int j = 0; j < LEAF_SIZE; ++j) {
        if (j > 0 && ids[j] == ids[j - 1]) continue;  // unused, or another piece of the same triangle
#if defined(WRT_SPHERES)
        const float *first = leaf + j, *third = leaf + 6 * LEAF_SIZE + j;
        if (first[0] == third[0] && first[LEAF_SIZE] == third[LEAF_SIZE] &&
            first[2 * LEAF_SIZE] == third[2 * LEAF_SIZE]) {
            test_sphere(j);
            continue;
        }
#endif
        some |= (unsigned)(mask_of(is_inside(sheared_triangle(j)) & within) != 0) << j;
    }
    for (; some; some &= some - 1) {
        WRT_NO_CONTRACTION
        const int j = lowest_bit(some);
        const Sheared<Floats> s = sheared_triangle(j);
        const Distance<Floats> d = distance_of(s, shear);
        const Ints meets = is_inside(s) & has_area(d) & within;
        Ints better = meets & (d.t >= t_min) & ((d.t < best) | ((d.t == best) & (ids[j] < best_id)));
        unsigned unsure = mask_of(better & (d.t <= error_of_distance(s, d, shear)));
        for (; unsure; unsure &= unsure - 1) {
            const int n = lowest_bit(unsure), own[3] = {a.kxs[n], a.kys[n], a.kzs[n]};
            const auto corner = [&](int vertex, int axis) { return leaf[LEAF_SIZE * (3 * vertex + own[axis]) + j]; };
            const float from[3] = {origin[0][n], origin[1][n], origin[2][n]};
            const float to[3] = {shear[0][n], shear[1][n], shear[2][n]};
            if (!is_ahead(corner, from, to)) better[n] = 0;
        }
        best = better ? d.t + 0.0f : best;  // not -0, which `pop_child` would take for a negative distance
        best_u = better ? s.v * d.inverse_det : best_u;
        best_v = better ? s.w * d.inverse_det : best_v;
        best_id = better ? (Ints)ids[j] : best_id;
    }
    if (any_hit) best = best_id != NOTHING_HIT ? (Floats)-1.0f : best;
    row(a.reach) = best;
    row(a.us) = best_u;
    row(a.vs) = best_v;
    row(a.ids) = best_id;
}

// Trace rays of one octant, or of any (`octants`). Rays of one octant agree which
// sides of a box are near; others select them one by one, which takes twice the instructions and still less than single
// rays where most rays come along, as at the root. `visit(leaf, within, one)` tests a leaf against the rays that are
// `within`; `one` is any of the rays. `part(node, rays, begins)` takes over a set of rays, as bits, that go on alone; the
// set may be empty.
template<bool octants, int N, class Visit, class Part>
WRT_INLINE void visit_together(const Tree& tree, Rays<N>& a, const float t_min, Visit visit, Part part) {
    typedef typename Of<N>::floats Floats;
    typedef typename Of<N>::ints Ints;
    typedef typename Of<N>::bools Bools;
    const float pad = (float)BOX_PAD;
    constexpr int lone_rays = octants ? LONE_MIXED_RAYS : LONE_RAYS;
    // For each node on the stack the distances of its box along the rays, infinity for rays that miss it.
    alignas(64) float begins[STACK_SIZE][N];
    int waiting[STACK_SIZE], top = 1;
    waiting[0] = 0;
    row(begins[0]) = (Floats)t_min;
    const int one = lowest_bit(mask_of(row(a.reach) >= t_min) | 1u << (N - 1)), flip = a.flips[one];
    const int near_row[3] = {a.near_rows[0][one], a.near_rows[1][one], a.near_rows[2][one]};
    const int far_row[3] = {a.far_rows[0][one], a.far_rows[1][one], a.far_rows[2][one]};
    Bools back[3];
    for (int k = 0; k < 3; ++k) back[k] = __builtin_convertvector(row(a.inverses[k]) < 0.0f, Bools);
    while (top > 0) {
        --top;
        const int current = waiting[top];
        const Floats limit = row(a.reach);
        const Ints within = row(begins[top]) <= limit * pad;
        const unsigned rays = mask_of(within);
        if (__builtin_popcount(rays) <= lone_rays) {
            part(current, rays, row(begins[top]));
            continue;
        }
        if (current < 0) {
            visit(current, within, one);
            continue;
        }
        const float* node = tree.node(current);
        const int* children = tree.children(current);
        const Floats still = within ? limit : (Floats)-1.0f;
        WRT_NO_UNROLLING for (int i = 0; i < WIDTH; ++i) {
            const int k = i ^ flip;
            Floats nears[3], fars[3];
            for (int axis = 0; axis < 3; ++axis) {
                Floats near = (Floats)node[near_row[axis] + k], far = (Floats)node[far_row[axis] + k];
                if (octants) {
                    const Floats lower = (Floats)node[8 * axis + k], upper = (Floats)node[24 + 8 * axis + k];
                    near = back[axis] ? upper : lower;
                    far = back[axis] ? lower : upper;
                }
                nears[axis] = product_less(near, row(a.inverses[axis]), row(a.near_shifts[axis]));
                fars[axis] = product_less(far, row(a.inverses[axis]), row(a.far_shifts[axis]));
            }
            const Floats tn = most(most(nears[0], nears[1]), most(nears[2], (Floats)t_min));
            const Floats tf = least(least(fars[0], fars[1]), least(fars[2], still)) * pad;
            const Ints met = tn <= tf;
            row(begins[top]) = met ? tn : (Floats)__builtin_inff();
            waiting[top] = children[k];
            top += mask_of(met) != 0;
        }
    }
}
// The same with the triangles of the leaves; see `test_leaf`.
template<bool any_hit, bool octants, bool axes, int N, class Part>
WRT_INLINE void follow_together(const Tree& tree, Rays<N>& a, const float t_min, Part part) {
    const auto visit = [&](const int leaf, const typename Of<N>::ints within, const int one) WRT_INLINE_LAMBDA {
        test_leaf<N, any_hit, axes>(tree.leaf(leaf), a, within, one, t_min);
    };
    visit_together<octants>(tree, a, t_min, visit, part);
}
} // namespace wrt
#endif
