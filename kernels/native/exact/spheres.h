#pragma once
// A ray against the spheres of a leaf, or many rays against one.
//
// A sphere lies in the tree as a triangle whose first and second corners are opposite corners of the box around it, and
// whose third corner is the first again. So boxes are built, refitted and moved as those of triangles; and the triangle
// test, in which two products cancel exactly, never hits one. Modules that define WRT_SPHERES test them.
#include "boxes.h"

namespace wrt {
#if WRT_VECTORS
template<class V> WRT_INLINE V square_root(V a) { return __builtin_elementwise_sqrt(a); }
#else
WRT_INLINE float square_root(float a) { return sqrtf(a); }
#endif

// The distances at which a line meets a sphere; both NaN or in the wrong order where it does not.
template<class V> struct Roots {
    V near, far;
};

// Where rays enter and leave a sphere (Haines, Günther and Akenine-Möller, "Precision Improvements for Ray/Sphere
// Intersection", Ray Tracing Gems, 2019). The discriminant comes from the distance of the centre to the line, and the
// root nearer to the origin from the product of both, which has the sign of the origin's distance to the surface: a ray
// that leaves from the right side of a sphere is never taken for one from the other side.
//
// The line is origin + s (shear x, shear y, 1) in the order kx, ky, kz; the distance is s times the third shear.
// corner(vertex, axis) is a coordinate of the box. All is rounded alike for one ray and for many.
template<class V, class Corner, class Number>
WRT_INLINE Roots<V> roots_of(Corner corner, const Number* origin, const Number* shear, int kx, int ky, int kz) {
    WRT_NO_CONTRACTION
    const int axes[3] = {kx, ky, kz};
    V from[3], radius;
    WRT_UNROLL for (int k = 0; k < 3; ++k) {
        const V low = corner(0, axes[k]), high = corner(1, axes[k]), half = product((V)0.5f, size((V)(high - low)));
        from[k] = origin[k] - product((V)0.5f, low + high);
        radius = k == 0 ? half : least(radius, half);
    }
    const V across = (V)shear[0], along = (V)shear[1], unit = (V)shear[2];
    const V inverse = 1.0f / ((product(across, across) + product(along, along)) + 1.0f);
    const V middle = -product((product(from[0], across) + product(from[1], along)) + from[2], inverse);
    const V x = from[0] + product(middle, across), y = from[1] + product(middle, along), z = from[2] + middle;
    const V square = product(radius, radius);
    const V left = square - ((product(x, x) + product(y, y)) + product(z, z));
    const V outside =
        ((product(from[0], from[0]) + product(from[1], from[1])) + product(from[2], from[2])) - square;
    // NaN where the line misses, and in unused places of a leaf, whose corners coincide
    const V half_chord = square_root(product((radius > 0.0f) ? left : (V)-1.0f, inverse));
    const V farther = middle + ((middle < 0.0f) ? (V)-half_chord : half_chord);
    const V a = product(farther, unit), b = product(product(outside, inverse) / farther, unit);
    return {(a < b) ? a : b, (a < b) ? b : a};
}

// The distance of the first root that counts, or a negative one; `counts(t)` returns which do.
template<class V, class Counts> WRT_INLINE V first_of(const Roots<V>& roots, Counts counts) {
    const V later = (counts(roots.far)) ? roots.far : (V)-1.0f;
    return (counts(roots.near)) ? roots.near : later;
}
} // namespace wrt
