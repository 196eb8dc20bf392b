#pragma once
// Where the vectors of disks and cylinders are found during traversal (`quadrics.h`). Trees without these need none.
#include "vectors.h"

namespace wrt {
#if defined(WRT_QUADRICS)
// Powers of two for the vectors of a shape that bring the largest coordinate of each to [1, 2). So products of vectors
// of any length neither overflow nor vanish, and scaling rounds nothing.
struct Scales {
    float by[3];
};

// The arrays of a scene, or of a mesh in it, that hold the three vectors of each shape.
struct Axes {
    const int* corners;
    const float* normals;

    WRT_MEMBER const float* of(const int id, const int which) const {
        return normals + 3 * (size_t)corners[3 * (size_t)id + which];
    }
    WRT_MEMBER Scales scales_of(const int id) const {
        Scales scales;
        WRT_UNROLL for (int which = 0; which < 3; ++which) {
            const float* const v = of(id, which);
            const float largest = most(most(size(v[0]), size(v[1])), size(v[2]));
            scales.by[which] = float_of(0x7f000000 - (bits_of(largest) & 0x7f800000));
        }
        return scales;
    }
    WRT_MEMBER Axes from(const int first_triangle) const { return {corners + 3 * (size_t)first_triangle, normals}; }
};
template<class Corners, class Normals> WRT_INLINE Axes axes_of(const Corners& corners, const Normals& normals) {
    return {(const int*)corners.data, (const float*)normals.data};
}
#else
struct Axes {
    WRT_MEMBER Axes from(int) const { return {}; }
};
template<class Corners, class Normals> WRT_INLINE Axes axes_of(const Corners&, const Normals&) { return {}; }
#endif
} // namespace wrt
