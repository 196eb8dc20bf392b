#pragma once
// Two-level traversal: instances of meshes, each mesh with a tree of its own (`kernels/core/ray_tree.py`).
#include "motion.h"
#include "traversal.h"

namespace wrt {
enum class Instances { still, moving, deforming };

// The inverse of an affine map by cofactors, for numbers near 1: the determinant must neither underflow nor overflow.
WRT_INLINE void invert(Matrix33& map, const Vector3& offset, Matrix33& linear, Vector3& shift) {
    float largest = 0.0f;
    for (int k = 0; k < 3; ++k)
        for (int j = 0; j < 3; ++j) largest = wp::max(largest, wp::abs(map[k][j]));
    for (int k = 0; k < 3; ++k)
        for (int j = 0; j < 3; ++j) map[k][j] /= largest;
    for (int k = 0; k < 3; ++k)
        for (int j = 0; j < 3; ++j)
            linear[j][k] = map[(k + 1) % 3][(j + 1) % 3] * map[(k + 2) % 3][(j + 2) % 3]
                         - map[(k + 1) % 3][(j + 2) % 3] * map[(k + 2) % 3][(j + 1) % 3];
    const float scale =
        1.0f / ((map[0][0] * linear[0][0] + map[0][1] * linear[1][0] + map[0][2] * linear[2][0]) * largest);
    for (int k = 0; k < 3; ++k) {
        shift[k] = 0.0f;
        for (int j = 0; j < 3; ++j) {
            linear[k][j] *= scale;
            shift[k] -= linear[k][j] * offset[j];
        }
    }
}

// Map a ray, or many; the direction is not normalised.
template<class From, class V> WRT_INLINE void map_ray(
    const Matrix33& linear, const Vector3& shift, const From& from_origin, const From& from_direction, V* origin,
    V* direction) {
    for (int k = 0; k < 3; ++k) {
        origin[k] = shift[k];
        direction[k] = 0.0f;
        for (int j = 0; j < 3; ++j) {
            origin[k] += linear[k][j] * from_origin[j];
            direction[k] += linear[k][j] * from_direction[j];
        }
    }
}

// The tree of a deforming mesh between two of its keys: boxes and triangles are interpolated. Rounding is monotonic, so
// triangles stay within their boxes.
struct MixedTree {
    Tree from, to;
    float share;
#if WRT_VECTORS
    alignas(32) mutable float mixed[LEAF_FLOATS];
    WRT_MEMBER const float* mix(const float* one, const float* other, const int count) const {
        WRT_NO_CONTRACTION
        for (int k = 0; k < count; ++k) mixed[k] = (1.0f - share) * one[k] + share * other[k];
        return mixed;
    }
    WRT_MEMBER const float* node(const int i) const { return mix(from.node(i), to.node(i), 6 * WIDTH); }
    WRT_MEMBER const float* leaf(const int child) const {
        memcpy(mixed + 9 * LEAF_SIZE, from.leaf(child) + 9 * LEAF_SIZE, 4 * LEAF_SIZE);
        return mix(from.leaf(child), to.leaf(child), 9 * LEAF_SIZE);
    }
#else
    WRT_MEMBER MixedFloats node(const int i) const { return {from.node(i), to.node(i), share}; }
    WRT_MEMBER MixedFloats leaf(const int child) const { return {from.leaf(child), to.leaf(child), share}; }
#endif
    WRT_MEMBER const int* children(const int i) const { return from.children(i); }
};

// Find the hit of a ray in the tree of a mesh; see `find_hit`.
template<Instances KIND, class Placed, class Mesh, class Skipped>
WRT_INLINE void find_hit_in_mesh(
    const Placed& placed, const Mesh& mesh, const Ray& ray, const float time, const float t_min, const bool any_hit,
    Nearest& nearest, Skipped skipped) {
    const Tree tree = tree_of(mesh.bvh);
    if constexpr (KIND == Instances::deforming) {
        if (mesh.keys > 1) {
            const KeyAt at = key_at(placed.key_times.data + mesh.first_time, mesh.keys, time);
            const auto tree_at = [&](const size_t key) -> Tree {
                return {tree.nodes + key * mesh.node_stride, tree.leaves + key * mesh.leaf_stride};
            };
            MixedTree between;
            between.from = tree_at(at.key);
            between.to = tree_at(at.key + 1 < mesh.keys ? at.key + 1 : at.key);
            between.share = at.share;
            find_hit(between, ray, 0, t_min, any_hit, nearest, skipped);
            return;
        }
    }
    find_hit(tree, ray, 0, t_min, any_hit, nearest, skipped);
}

// A hit as numbers: the instance, the triangle by its number through all instances, t, u and v; then the instance and
// the number of the first box, where it is entered, and where the second is.
#if defined(WRT_BOXES)
typedef wp::vec_t<9, float> InstanceFound;
#else
typedef wp::vec_t<5, float> InstanceFound;
#endif

// Trace a ray through the upper tree and the trees of the instances that it reaches. `skipped(number)` returns a
// predicate for the hits to skip in an instance; see `test_leaf`.
template<Instances KIND, class Placed, class Vector, class Skipped>
WRT_INLINE InstanceFound trace_instances(
    const Placed& placed, const Axes& axes, const Vector& world_origin, const Vector& world_direction,
    const float time, const float t_min, const float t_max, const bool any_hit, Skipped skipped) {
    Nearest best = nothing_before(t_max, -1);
    int best_instance = -1;
    // Of equal t the lower instance number wins: triangles of a later instance do not replace a hit of an earlier one,
    // and the other way round.
    const auto visit = [&](const int child) {
        const int number = -1 - child;
        const auto& instance = placed.instances.data[number];
        float linear[3][3], shift[3];
        for (int k = 0; k < 3; ++k) {
            shift[k] = instance.offset[k];
            for (int j = 0; j < 3; ++j) linear[k][j] = instance.linear.data[k][j];
        }
        if constexpr (KIND != Instances::still) {
            if (instance.motion >= 0) {
                float to_world[3][3], position[3];
                placement_at(
                    placed.motion_keys.data, placed.motions.data[instance.motion], time, to_world, position);
                invert(to_world, position, linear, shift);
            }
        }
        float origin[3], direction[3];
        map_ray(linear, shift, world_origin, world_direction, origin, direction);
        Ray ray;
        if (!set_up(ray, origin, direction)) return any_hit && best_instance >= 0;
        ray.axes = axes.from(instance.first_triangle);
        const int nothing_yet = best_instance >= 0 && best_instance < number ? -1 : NOTHING_HIT;
        Nearest nearest = nothing_before(best.t, nothing_yet);
        const auto& mesh = placed.meshes.data[instance.mesh];
        find_hit_in_mesh<KIND>(placed, mesh, ray, time, t_min, any_hit, nearest, skipped(number));
        if (nearest.id != nothing_yet) {
            best_instance = number;
            best.set(nearest.t, nearest.u, nearest.v, nearest.id);
        }
#if defined(WRT_BOXES)
        best.boxes.add(nearest.boxes.first, nearest.boxes.second, number, nearest.boxes.id);
#endif
        return any_hit && best_instance >= 0;
    };
    Tree tree = {(const float*)placed.nodes.data, nullptr};
    if constexpr (KIND != Instances::still) {
        const float slice = (time - placed.first_slice) * placed.slices_per_second;
        const float last = placed.slice_nodes.shape[0] - 1;
        tree.nodes = tree.at(placed.slice_nodes.data[(int)wp::max(0.0f, wp::min(slice, last))]);
    }
    Ray ray;
    if (set_up(ray, world_origin, world_direction)) follow(tree, ray, 0, t_min, best.t, visit);
    InstanceFound found;
    found[0] = float_of(best_instance);
    found[1] = float_of(
        best_instance >= 0 ? best.id + placed.instances.data[best_instance].first_triangle : -1);
    found[2] = best.t;
    found[3] = best.u;
    found[4] = best.v;
#if defined(WRT_BOXES)
    const bool enters = best.boxes.id != NOTHING_HIT;
    found[5] = float_of(enters ? best.boxes.instance : -1);
    found[6] = float_of(
        enters ? best.boxes.id + placed.instances.data[best.boxes.instance].first_triangle : -1);
    found[7] = best.boxes.first;
    found[8] = best.boxes.second;
#endif
    return found;
}
// The nearest hit or any.
template<Instances KIND, class Placed, class Vector>
WRT_INLINE InstanceFound closest_instance_hit(
    const Placed& placed, const Axes& axes, const Vector& origin, const Vector& direction, float time, float t_min,
    float t_max, bool any_hit) {
    const auto skipped = [](int) { return NoneSkipped(); };
    return trace_instances<KIND>(placed, axes, origin, direction, time, t_min, t_max, any_hit, skipped);
}
// The greatest number in the mesh of an instance of what is not behind a hit at the same distance.
template<class Placed>
WRT_INLINE int last_in_mesh(const Placed& placed, const int number, const int last_instance, const int last_id) {
    if (number != last_instance) return number < last_instance ? NOTHING_HIT : -1;
    return last_id - placed.instances.data[last_instance].first_triangle;
}
// The hit that follows another one at t_min, ordered by distance, instance and triangle.
template<Instances KIND, class Placed, class Vector>
WRT_INLINE InstanceFound next_instance_hit(
    const Placed& placed, const Axes& axes, const Vector& origin, const Vector& direction, float time, float t_min,
    float t_max, int last_instance, int last_id) {
    const auto skipped = [&](int number) -> SkippedUpTo {
        return {t_min, last_in_mesh(placed, number, last_instance, last_id)};
    };
    return trace_instances<KIND>(placed, axes, origin, direction, time, t_min, t_max, false, skipped);
}
#if defined(WRT_BOXES)
// The box that is entered after another one, at t_min, ordered alike; there is no hit.
template<Instances KIND, class Placed, class Vector>
WRT_INLINE InstanceFound next_instance_box(
    const Placed& placed, const Axes& axes, const Vector& origin, const Vector& direction, float time, float t_min,
    float t_max, int last_instance, int last_id) {
    const auto skipped = [&](int number) -> AllButLaterBoxes {
        return {t_min, last_in_mesh(placed, number, last_instance, last_id)};
    };
    return trace_instances<KIND>(placed, axes, origin, direction, time, t_min, t_max, false, skipped);
}
#endif
} // namespace wrt
