#pragma once
// The triangle test of Woop, Benthin and Wald (2013): a ray against the triangles of a leaf, or many rays against one.
#include "boxes.h"
#include "exact/entries.h"
#include "exact/quadrics.h"

namespace wrt {
// The nearest hit so far; `id` is NOTHING_HIT before the first.
struct Nearest {
    float t, u, v;
    int id;
    [[no_unique_address]] Entries boxes;

    WRT_MEMBER void set(const float at, const float new_u, const float new_v, const int number) {
        t = at, u = new_u, v = new_v, id = number;
    }
};
WRT_INLINE Nearest nothing_before(const float t, const int id = NOTHING_HIT) {
    Nearest nearest;
    nearest.set(t, 0.0f, 0.0f, id);
    nearest.boxes.clear();
    return nearest;
}

// The triangle, translated and sheared so that the ray runs along z from the origin, and its edge functions u, v and w.
// Each vertex is transformed independently, so triangles that share an edge compute the same numbers; and products are
// rounded before they are subtracted, so an edge function may vanish but never has the wrong sign. Zero counts as inside
// on both sides: no ray slips between two triangles.
template<class V> struct Sheared {
    V ax, ay, az, bx, by, bz, cx, cy, cz, u, v, w;
};
// corner(vertex, axis) is a coordinate of the triangle; origin and shear are in the order kx, ky, kz.
template<class V, class Corner, class Number>
WRT_INLINE Sheared<V> sheared(Corner corner, const Number* origin, const Number* shear, int kx, int ky, int kz) {
    WRT_NO_CONTRACTION
    Sheared<V> s;
    s.az = corner(0, kz) - origin[2];
    s.bz = corner(1, kz) - origin[2];
    s.cz = corner(2, kz) - origin[2];
    s.ax = less_product((V)(corner(0, kx) - origin[0]), shear[0], s.az);
    s.ay = less_product((V)(corner(0, ky) - origin[1]), shear[1], s.az);
    s.bx = less_product((V)(corner(1, kx) - origin[0]), shear[0], s.bz);
    s.by = less_product((V)(corner(1, ky) - origin[1]), shear[1], s.bz);
    s.cx = less_product((V)(corner(2, kx) - origin[0]), shear[0], s.cz);
    s.cy = less_product((V)(corner(2, ky) - origin[1]), shear[1], s.cz);
    s.u = product(s.cx, s.by) - product(s.cy, s.bx);
    s.v = product(s.ax, s.cy) - product(s.ay, s.cx);
    s.w = product(s.bx, s.ay) - product(s.by, s.ax);
    return s;
}
// Whether the line through the ray meets the triangle, unless this is degenerate seen along the ray.
template<class V> WRT_INLINE auto is_inside(const Sheared<V>& s) {
    return (least(least(s.u, s.v), s.w) >= 0.0f) | (most(most(s.u, s.v), s.w) <= 0.0f);
}
template<class V> struct Distance {
    V det, inverse_det, t;
};
template<class V, class Number> WRT_INLINE Distance<V> distance_of(const Sheared<V>& s, const Number* shear) {
    WRT_NO_CONTRACTION
    Distance<V> d;
    d.det = (s.u + s.v) + s.w;
    d.inverse_det = 1.0f / d.det;
    d.t = product(
        product((product(s.u, s.az) + product(s.v, s.bz)) + product(s.w, s.cz), (V)shear[2]), d.inverse_det);
    return d;
}
// Edge-on triangles are missed.
template<class V> WRT_INLINE auto has_area(const Distance<V>& d) { return size(d.det) > 1e-28f; }

// A bound on the error of t: a hit nearer than that might be the surface that the ray leaves, and a ray that leaves a
// needle would hit that needle. The bound on the error of the edge functions is that of Pharr, Jakob and Humphreys
// ("Physically Based Rendering", 3rd edition, section 3.9.6; gamma(n) = n eps / (1 - n eps) with eps = 2^-24). Their
// bound on t also grows with the distance from a thin triangle, and would hide needles far away. But t is a mean of the
// corners' z: errors of its weights matter only as far as these differ, and not at all (0) if the whole triangle is in
// front of the ray. The first term is gamma(18) most_z, for all other roundings.
template<class V, class Number>
WRT_INLINE V error_of_distance(const Sheared<V>& s, const Distance<V>& d, const Number* shear) {
    WRT_NO_CONTRACTION
    const V most_x = most(most(size(s.ax), size(s.bx)), size(s.cx));
    const V most_y = most(most(size(s.ay), size(s.by)), size(s.cy));
    const V most_z = most(most(size(s.az), size(s.bz)), size(s.cz));
    const V error_x = 2.9802325e-7f * (most_x + most_z), error_y = 2.9802325e-7f * (most_y + most_z);
    const V error_e = 2.0f * (1.1920930e-7f * most_x * most_y + error_y * most_x + error_x * most_y);
    const V spread = most(most(s.az, s.bz), s.cz) - least(least(s.az, s.bz), s.cz), error_z = 1.0728836e-6f * most_z;
    const V error_t = size((V)shear[2]) * (error_z + 3.0f * spread * (error_e * size(d.inverse_det)));
    return ((most_z - spread > error_z) & (d.t > 0.0f)) ? (V)0.0f : error_t;
}

// Whether a ray goes on to a triangle's plane, in double precision: for a hit within the error of its distance. A ray in
// a corner begins as near to the other wall as that, and would leave a closed room. Of a ray that begins at a vertex the
// height is 0 apart from rounding, so the products are rounded alike on all devices. All is in the order kx, ky, kz.
template<class Corner> WRT_INLINE bool is_ahead(Corner corner, const float* origin, const float* shear) {
    WRT_NO_CONTRACTION
    double to[3], e1[3], e2[3];
    for (int k = 0; k < 3; ++k) {
        const double first = corner(0, k);
        to[k] = first - origin[k];
        e1[k] = corner(1, k) - first;
        e2[k] = corner(2, k) - first;
    }
    const double n[3] = {
        product(e1[1], e2[2]) - product(e1[2], e2[1]), product(e1[2], e2[0]) - product(e1[0], e2[2]),
        product(e1[0], e2[1]) - product(e1[1], e2[0])};
    const double height = product(n[0], to[0]) + product(n[1], to[1]) + product(n[2], to[2]);
    const double rise = (product(n[0], (double)shear[0]) + product(n[1], (double)shear[1]) + n[2]) * shear[2];
    return height * rise > 0.0;
}

#if WRT_VECTORS
#if defined(WRT_SPHERES)
// Test the spheres of a leaf, as `test_leaf` does its triangles; return whether there are no triangles.
template<class Skipped> WRT_INLINE bool
test_spheres(const float* leaf, const Ray& ray, const float t_min, Nearest& nearest, Skipped skipped) {
    const int* ids = (const int*)(leaf + 9 * LEAF_SIZE);
    float nears[LEAF_SIZE], fars[LEAF_SIZE];
    unsigned some = 0;
    const auto corner = [&](int vertex, int axis) {
        return *(const f8*)(leaf + 3 * LEAF_SIZE * vertex + LEAF_SIZE * axis);
    };
    some = mask_of((corner(0, 0) == corner(2, 0)) & (corner(0, 1) == corner(2, 1)) & (corner(0, 2) == corner(2, 2)));
    if (some == 0) return false;
    const Roots<f8> roots = roots_of<f8>(corner, ray.origin, ray.shear, ray.kx, ray.ky, ray.kz);
    unsigned met = some & mask_of((roots.far >= t_min) & (roots.near <= nearest.t));
    __builtin_memcpy(nears, &roots.near, sizeof nears);
    __builtin_memcpy(fars, &roots.far, sizeof fars);
    const auto keep = [&](const Roots<float>& meets, const int id) {
        const float t = first_of<float>(
            meets, [&](float root) { return root > 0.0f && root >= t_min && !skipped(root, id); });
        if (t > 0.0f && (t < nearest.t || (t == nearest.t && id < nearest.id))) nearest.set(t, 0.0f, 0.0f, id);
    };
#if defined(WRT_QUADRICS)
    const i8 rises[3] = {corner(0, 0) < corner(1, 0), corner(0, 1) < corner(1, 1), corner(0, 2) < corner(1, 2)};
    const unsigned disks = mask_of(rises[0] == rises[2]);
    const unsigned quadrics = some & mask_of(rises[0] != rises[1]);
    met &= ~quadrics;
#if defined(WRT_BOXES)
    unsigned boxes = some & mask_of((rises[0] == rises[1]) & (rises[0] != rises[2]));
    met &= ~boxes;
    // From the origin on, not from t_min: a box that was entered before does not count again.
    const f8 entries = entry_of<f8>(span_in_box<f8>(corner, ray.inverse, ray.near_shift, ray.far_shift, 0.0f));
    for (; boxes; boxes &= boxes - 1) {
        const int k = lowest_bit(boxes);
        if (!skipped.box(entries[k], ids[k])) nearest.boxes.add(entries[k], (float)LONGEST, 0, ids[k]);
    }
#endif
    // Boxes first: the test of a shape takes ten times as long.
    const Span<f8> spans = span_in_box<f8>(corner, ray.inverse, ray.near_shift, ray.far_shift, t_min);
    unsigned others = quadrics & mask_of(spans.begins_before((f8)nearest.t));
    for (; others; others &= others - 1) {
        const int k = lowest_bit(others);
        if (k > 0 && ids[k] == ids[k - 1]) continue;
        const auto coordinate = [&](int vertex, int axis) { return leaf[LEAF_SIZE * (3 * vertex + axis) + k]; };
        const auto axis_of = [&](int which, int axis) { return ray.axes.of(ids[k], which)[axis]; };
        const Span<float> span = {spans.begin[k], spans.end[k]};
        const bool is_disk = disks >> k & 1;
        keep(
            roots_of_quadric<float>(
                coordinate, axis_of, ray.axes.scales_of(ids[k]), span, is_disk, ray.origin, ray.shear, ray.kx, ray.ky,
                ray.kz),
            ids[k]);
    }
#endif
    for (; met; met &= met - 1) {
        const int k = lowest_bit(met);
        keep({nears[k], fars[k]}, ids[k]);
    }
    return some == (1u << LEAF_SIZE) - 1;
}
#endif

// Test the triangles of a leaf at once; of equal t the lowest id wins. `skipped(t, id)` returns which hits to skip.
template<class Skipped = NoneSkipped>
WRT_INLINE void
test_leaf(const float* leaf, const Ray& ray, const float t_min, Nearest& nearest, Skipped skipped = {}) {
    static_assert(LEAF_SIZE == 8, "a leaf fills a vector");
#if defined(WRT_SPHERES)
    if (test_spheres(leaf, ray, t_min, nearest, skipped)) return;
#endif
    float ts[LEAF_SIZE], us[LEAF_SIZE], vs[LEAF_SIZE];
    unsigned hits = 0;
    const int* ids = (const int*)(leaf + 9 * LEAF_SIZE);
    {
        WRT_NO_CONTRACTION
        const auto corner = [&](int vertex, int axis) {
            return *(const f8*)(leaf + 3 * LEAF_SIZE * vertex + LEAF_SIZE * axis);
        };
        const Sheared<f8> s = sheared<f8>(corner, ray.origin, ray.shear, ray.kx, ray.ky, ray.kz);
        const Distance<f8> d = distance_of(s, ray.shear);
        hits = mask_of(is_inside(s) & has_area(d) & (d.t >= t_min) & (d.t <= nearest.t));
        if (hits) {
            unsigned unsure = hits & mask_of(d.t <= error_of_distance(s, d, ray.shear));
            for (; unsure; unsure &= unsure - 1) {
                const int k = lowest_bit(unsure), axes[3] = {ray.kx, ray.ky, ray.kz};
                const auto one = [&](int vertex, int axis) { return leaf[LEAF_SIZE * (3 * vertex + axes[axis]) + k]; };
                if (!is_ahead(one, ray.origin, ray.shear)) hits &= ~(1u << k);
            }
            const f8 u = s.v * d.inverse_det, v = s.w * d.inverse_det;
            __builtin_memcpy(ts, &d.t, sizeof ts);
            __builtin_memcpy(us, &u, sizeof us);
            __builtin_memcpy(vs, &v, sizeof vs);
        }
    }
    for (; hits; hits &= hits - 1) {
        const int k = lowest_bit(hits);
        if (skipped(ts[k], ids[k])) continue;
        if (ts[k] < nearest.t || (ts[k] == nearest.t && ids[k] < nearest.id)) {
            // Not -0, which `pop_child` would take for a negative distance.
            nearest.set(ts[k] + 0.0f, us[k], vs[k], ids[k]);
        }
    }
}
#endif
} // namespace wrt
