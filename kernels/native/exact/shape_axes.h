#pragma once
// Where the vectors of disks and cylinders are found during traversal (`quadrics.h`).
#include "vectors.h"

#if defined(WRT_QUADRICS)
namespace wrt {
// The arrays of a scene, or of a mesh in it, that hold the three vectors of each shape.
struct Axes {
    const int* corners;
    const float* normals;

    WRT_MEMBER const float* of(const int id, const int which) const {
        return normals + 3 * (size_t)corners[3 * (size_t)id + which];
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
#endif
