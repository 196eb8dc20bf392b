#pragma once
// A ray against a disk or a cylinder of a leaf, or many rays against one.
//
// They lie in the tree as spheres do (`spheres.h`), as triangles over their boxes that no ray hits. In the first two
// axes the corners of a sphere's box are in the same order, those of another shape in opposite orders; the third axis
// distinguishes a disk, ordered as the first, from a cylinder. The middle of the box is the middle of the shape, and
// the normals of the vertices map the unit shape to it: x and y are two radii, z is a disk's normal, or a cylinder's
// axis from end to end. These are read from the arrays of the scene. Modules that define WRT_QUADRICS test them.
//
// A box whose corners are in the same order along x and y, and in the opposite one along z, is that of a distance
// function. Modules that define WRT_BOXES report where a ray enters it (`entries.h`).
#include "exact/shape_axes.h"
#include "exact/spheres.h"

#if defined(WRT_QUADRICS)
namespace wrt {
template<class V> struct Local {
    V x, y, z;
};

// The part of a ray in the box around a shape. Hits elsewhere do not count: so it does not matter whether and when a
// box is tested before its shape, and rays that go alone or together hit the same. Rounding of the slab test moves begin
// and end by gamma(3) |o / d| and gamma(2) of themselves (Pharr, Jakob and Humphreys, section 3.9.2), which the error of
// `slab_of` and BOX_PAD exceed: no hit is lost whose ray meets the shape by more than the error of the shape's own test.
template<class V> struct Span {
    V begin, end;

    WRT_MEMBER auto holds(const V t) const { return (t * (V)(float)BOX_PAD >= begin) & (t <= end * (V)(float)BOX_PAD); }
    WRT_MEMBER auto begins_before(const V t_max) const {
        return (begin <= end * (V)(float)BOX_PAD) & (begin <= t_max * (V)(float)BOX_PAD);
    }
};
// corner(vertex, k) is a coordinate of the box, and the others are those of `Ray` in the same order of axes. Of the two
// corners, the nearer has the lower number: rounding is monotonic.
template<class V, class Corner, class Number>
WRT_INLINE Span<V> span_in_box(
    Corner corner, const Number* inverse, const Number* near_shift, const Number* far_shift, const float t_min) {
    Span<V> span = {(V)t_min, (V)(float)LONGEST};
    WRT_UNROLL for (int k = 0; k < 3; ++k) {
        const V one = corner(0, k), other = corner(1, k), slope = inverse[k], near = near_shift[k], far = far_shift[k];
        span.begin = most(span.begin, least(product_less(one, slope, near), product_less(other, slope, near)));
        span.end = least(span.end, most(product_less(one, slope, far), product_less(other, slope, far)));
    }
    return span;
}

// Where a line enters and leaves an open cylinder, or meets a disk, in the space of the unit shape, in which s is the
// same number; in any order. As for spheres the root nearer to the origin comes from the product of both, so that a ray
// which leaves one side is never taken for a ray from the other. Roots beyond the shape are negative.
template<class V> WRT_INLINE Roots<V> roots_in_unit_shape(const Local<V>& o, const Local<V>& d, V unit, bool is_disk) {
    WRT_NO_CONTRACTION
    const V none = -1.0f;
    if (is_disk) {
        const V s = -o.z / d.z;
        const V x = o.x + product(s, d.x), y = o.y + product(s, d.y);
        const V t = (product(x, x) + product(y, y) <= 1.0f) ? product(s, unit) : none;
        return {t, t};
    }
    const V inverse = 1.0f / (product(d.x, d.x) + product(d.y, d.y));
    const V middle = -product(product(o.x, d.x) + product(o.y, d.y), inverse);
    const V x = o.x + product(middle, d.x), y = o.y + product(middle, d.y);
    const V left = 1.0f - (product(x, x) + product(y, y)), outside = (product(o.x, o.x) + product(o.y, o.y)) - 1.0f;
    const V half_chord = square_root(product(left, inverse));
    const V farther = middle + ((middle < 0.0f) ? (V)-half_chord : half_chord);
    const V nearer = product(outside, inverse) / farther;
    const V one = (size(o.z + product(farther, d.z)) <= 0.5f) ? product(farther, unit) : none;
    const V other = (size(o.z + product(nearer, d.z)) <= 0.5f) ? product(nearer, unit) : none;
    return {one, other};
}

// As `roots_of`, of a disk or cylinder; axis(which, k) is a coordinate of its vectors. They are mapped to the unit
// vectors by their cofactors, so that they need not be orthogonal.
template<class V, class Corner, class Axis, class Number>
WRT_INLINE Roots<V> roots_of_quadric(
    Corner corner, Axis axis, const Scales& scales, const Span<V>& span, bool is_disk, const Number* origin,
    const Number* shear, int kx, int ky, int kz) {
    WRT_NO_CONTRACTION
    const int axes[3] = {kx, ky, kz};
    const V direction[3] = {(V)shear[0], (V)shear[1], (V)1.0f};
    V from[3], vectors[3][3], to[3][3], o[3], d[3], inverse = 0.0f;
    WRT_UNROLL for (int k = 0; k < 3; ++k)
        from[k] = origin[k] - product((V)0.5f, corner(0, axes[k]) + corner(1, axes[k]));
    WRT_UNROLL for (int j = 0; j < 3; ++j) WRT_UNROLL for (int k = 0; k < 3; ++k)
        vectors[j][k] = product((V)axis(j, axes[k]), (V)scales.by[j]);
    WRT_UNROLL for (int j = 0; j < 3; ++j) WRT_UNROLL for (int k = 0; k < 3; ++k) {
        const int k1 = (k + 1) % 3, k2 = (k + 2) % 3, j1 = (j + 1) % 3, j2 = (j + 2) % 3;
        to[j][k] = product(vectors[j1][k1], vectors[j2][k2]) - product(vectors[j1][k2], vectors[j2][k1]);
    }
    WRT_UNROLL for (int k = 0; k < 3; ++k) inverse = inverse + product(vectors[0][k], to[0][k]);
    inverse = 1.0f / inverse;
    const auto mapped = [&](int j, const V* v) WRT_INLINE_LAMBDA {
        WRT_NO_CONTRACTION
        const V sum = (product(to[j][0], v[0]) + product(to[j][1], v[1])) + product(to[j][2], v[2]);
        return product(product(sum, inverse), (V)scales.by[j]);
    };
    WRT_UNROLL for (int j = 0; j < 3; ++j) o[j] = mapped(j, from), d[j] = mapped(j, direction);
    const Roots<V> met =
        roots_in_unit_shape<V>({o[0], o[1], o[2]}, {d[0], d[1], d[2]}, (V)shear[2], is_disk);
    const V none = -1.0f;
    const V one = (span.holds(met.near)) ? met.near : none, other = (span.holds(met.far)) ? met.far : none;
    return {(one < other) ? one : other, (one < other) ? other : one};
}
#if defined(WRT_BOXES)
// Where a ray enters a box, LONGEST if it does not.
template<class V> WRT_INLINE V entry_of(const Span<V>& span) {
    return (span.begin <= span.end * (V)(float)BOX_PAD) ? span.begin : (V)(float)LONGEST;
}
#endif
} // namespace wrt
#endif
