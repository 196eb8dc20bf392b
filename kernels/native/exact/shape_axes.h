#pragma once
// Where the vectors of disks and cylinders are found during traversal (`quadrics.h`). Trees without these need none.
#include "vectors.h"

#if defined(WRT_QUADRICS)
namespace wrt {
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

// A tree with the arrays of its shapes.
template<class Bvh> struct TreeOfShapes {
    const decltype(Bvh::nodes)& nodes;
    const decltype(Bvh::leaves)& leaves;
    Axes axes;
};
template<class Bvh, class Corners, class Normals>
WRT_INLINE TreeOfShapes<Bvh> with_axes(const Bvh& bvh, const Corners& corners, const Normals& normals) {
    return {bvh.nodes, bvh.leaves, axes_of(corners, normals)};
}

// The trees of instances with the arrays of their shapes.
template<class Placed> struct InstancesOfShapes {
    const decltype(Placed::nodes)& nodes;
    const decltype(Placed::instances)& instances;
    const decltype(Placed::meshes)& meshes;
    float first_slice, slices_per_second;
    const decltype(Placed::slice_nodes)& slice_nodes;
    const decltype(Placed::motion_keys)& motion_keys;
    const decltype(Placed::motions)& motions;
    const decltype(Placed::key_times)& key_times;
    Axes axes;
};
template<class Placed, class Corners, class Normals>
WRT_INLINE InstancesOfShapes<Placed>
instances_with_axes(const Placed& placed, const Corners& corners, const Normals& normals) {
    return {
        placed.nodes, placed.instances, placed.meshes, placed.first_slice, placed.slices_per_second,
        placed.slice_nodes, placed.motion_keys, placed.motions, placed.key_times, axes_of(corners, normals)};
}
} // namespace wrt
#else
namespace wrt {
template<class Bvh, class Corners, class Normals>
WRT_INLINE const Bvh& with_axes(const Bvh& bvh, const Corners&, const Normals&) {
    return bvh;
}
template<class Placed, class Corners, class Normals>
WRT_INLINE const Placed& instances_with_axes(const Placed& placed, const Corners&, const Normals&) {
    return placed;
}
} // namespace wrt
#endif
