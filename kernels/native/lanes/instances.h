#pragma once
// Groups of rays through instances that do not move (`instances.h`).
//
// A group descends the upper tree together. At an instance that many of its rays reach, these descend the mesh's tree
// together in its space. Where few are left, in either tree, they go on alone, several interleaved, as in one tree
// (`rays.h`). The hits are those of single rays, bit for bit.
#include "instances.h"
#include "lanes/rays.h"

namespace lanes {
// A group of rays in flight.
struct InstanceJourneys {
    Rays rays;  // in the world
    Partings partings;
    int trees[MOST_PARTINGS];  // the instances in whose trees the nodes of the partings are; −1 for the upper tree
    floats origin[3], direction[3];
    alignas(64) int instances[WIDTH];  // that the rays have hit; NOTHING_HIT for none
};
template<class Placed> WRT_INLINE wrt::Tree upper_tree(const Placed& placed) {
    return {(const float*)placed.nodes.data, nullptr};
}
template<class Instance, class From, class V> WRT_INLINE void
enter(const Instance& instance, const From& from_origin, const From& from_direction, V* origin, V* direction) {
    float linear[3][3], shift[3];
    for (int k = 0; k < 3; ++k) {
        shift[k] = instance.offset[k];
        for (int j = 0; j < 3; ++j) linear[k][j] = instance.linear.data[k][j];
    }
    wrt::map_ray(linear, shift, from_origin, from_direction, origin, direction);
}

// A ray that has left its group: in the space of an instance, and the nodes of the upper tree that wait.
struct LoneInInstances : LoneOf<InstanceJourneys> {
    wrt::Ray world, ray;
    wrt::Tree tree;
    wrt::Nearest best;  // in the instances that it has left
    int instance, best_instance, id_before;
    int upper_top, upper_begins[wrt::STACK_SIZE + 8], upper_waiting[wrt::STACK_SIZE + 8];
};
// These rays, for `follow_in_turn`.
template<bool any_hit, class Placed> struct LoneRaysInInstances {
    const Placed& placed;
    const wrt::Axes axes;
    InstanceJourneys *next, *end;

    // Send a ray to a node of an instance's tree; return false if it hits nothing there.
    WRT_MEMBER bool visit(LoneInInstances& r, const int number, const int node) {
        const auto& instance = placed.instances.data[number];
        float from[3], along[3], origin[3], direction[3];
        LANES_UNROLL for (int k = 0; k < 3; ++k) {
            from[k] = r.group->origin[k][r.number];
            along[k] = r.group->direction[k][r.number];
        }
        enter(instance, from, along, origin, direction);
        if (!wrt::set_up(r.ray, origin, direction)) return false;
        r.ray.axes = axes.from(instance.first_triangle);
        r.tree = wrt::tree_of(placed.meshes.data[instance.mesh].bvh);
        r.instance = number;
        r.current = node;
        // Of equal distances the lower instance wins, then the lower triangle.
        r.id_before = r.best_instance < number    ? -1
                      : r.best_instance == number ? r.best.id
                                                  : wrt::NOTHING_HIT;
        r.nearest = wrt::nothing_before(r.best.t, r.id_before);
        return true;
    }
    WRT_MEMBER bool branch(LoneInInstances& r) {
        if (r.nearest.id != r.id_before) {
            r.best.set(r.nearest.t, r.nearest.u, r.nearest.v, r.nearest.id);
            r.best_instance = r.instance;
        }
#if defined(WRT_BOXES)
        r.best.boxes.add(r.nearest.boxes.first, r.nearest.boxes.second, r.instance, r.nearest.boxes.id);
#endif
        if (any_hit && r.best_instance != wrt::NOTHING_HIT) return false;
        const wrt::Tree upper = upper_tree(placed);
        const wrt::Stack stack = {r.upper_begins, r.upper_waiting, r.upper_top};
        for (;;) {
            int node;
            if (!wrt::pop_child(node, r.best.t, stack)) {
                const int k = r.next_parting(r.best.t * (float)wrt::BOX_PAD);
                if (k < 0) return false;
                node = r.group->partings.nodes[k];
                const int number = r.group->trees[k];
                if (number >= 0) {
                    if (visit(r, number, node)) return true;
                    continue;
                }
            }
            if (node >= 0) wrt::push_children(upper.node(node), upper.children(node), r.world, 0.0f, r.best.t, stack);
            else if (visit(r, -1 - node, 0)) return true;
        }
    }
    WRT_MEMBER void start(LoneInInstances& r) {
        while (r.take(next, end)) {
            r.best = r.nearest;
            r.best_instance = r.group->instances[r.number];
            r.id_before = r.nearest.id;
            r.nearest.boxes.clear();
            r.upper_top = 0;
            r.world = r.group->rays.one(r.number);
            if (r.best.t >= 0.0f && branch(r)) return;
        }
    }
    WRT_MEMBER void finish(const LoneInInstances& r) {
        r.group->rays.set(r.number, r.best);
        r.group->instances[r.number] = r.best_instance;
    }
    WRT_MEMBER const wrt::Ray& ray(const LoneInInstances& r) { return r.ray; }
    WRT_MEMBER const wrt::Tree& tree(const LoneInInstances& r) { return r.tree; }
};
template<bool any_hit, class Placed>
LANES_CALLED void
follow_alone(const Placed& placed, const wrt::Axes& axes, InstanceJourneys* groups, const int count) {
    LoneRaysInInstances<any_hit, Placed> rays = {placed, axes, groups, groups + count};
    wrt::follow_in_turn<any_hit, wrt::IN_TURN, LoneInInstances>(0.0f, wrt::IN_TURN, 4, rays);
}

// Rays that go on alone are put on the group's list.
template<bool any_hit, class Placed> struct Leaving {
    const Placed& placed;
    const wrt::Axes& axes;
    InstanceJourneys& group;
    int tree;

    WRT_MEMBER void operator()(const int node, const unsigned rays, const floats& begins) {
        group.trees[group.partings.count] = tree;
        group.partings.add(node, rays, begins, [&] { follow_alone<any_hit>(placed, axes, &group, 1); });
    }
};
template<bool any_hit, bool octants, bool axes, class Part>
LANES_CALLED void follow_in_mesh(const wrt::Tree& tree, Rays& rays, Part part) {
    wrt::follow_together<any_hit, octants, axes>(tree, rays, 0.0f, part);
}

// Trace the rays that are `within` the box of an instance in its tree, and keep their hits.
template<bool any_hit, class Placed>
LANES_CALLED void visit_instance(
    const Placed& placed, const wrt::Axes& axes, InstanceJourneys& group, const int number, const ints& within) {
    const auto& instance = placed.instances.data[number];
    floats origin[3], direction[3];
    enter(instance, group.origin, group.direction, origin, direction);
    Rays rays;
    rays.axes = axes.from(instance.first_triangle);
    const ints can_hit = wrt::set_up(rays, origin, direction) & within;
    const unsigned runs = wrt::mask_of(can_hit);
    if (runs == 0) return;
    wrt::row(rays.reach) = can_hit ? wrt::row(group.rays.reach) : (floats)-1.0f;
    const int one = __builtin_ctz(runs);
    const bool octants = wrt::mask_of(wrt::row(rays.flips) != rays.flips[one]) & runs;
    const bool mixed_axes = wrt::mask_of(wrt::row(rays.kzs) != rays.kzs[one]) & runs;
    const wrt::Tree tree = wrt::tree_of(placed.meshes.data[instance.mesh].bvh);
    const Leaving<any_hit, Placed> part = {placed, axes, group, number};
    if (octants) follow_in_mesh<any_hit, true, true>(tree, rays, part);
    else if (mixed_axes) follow_in_mesh<any_hit, false, true>(tree, rays, part);
    else follow_in_mesh<any_hit, false, false>(tree, rays, part);
    const floats reach = wrt::row(group.rays.reach), t = wrt::row(rays.reach);
    const ints ids = wrt::row(rays.ids), instances = wrt::row(group.instances);
    const ints before = (instances > number) | ((instances == number) & (ids < wrt::row(group.rays.ids)));
    const ints better = (ids != wrt::NOTHING_HIT) & ((t < reach) | ((t == reach) & before));
    wrt::row(group.rays.reach) = better ? t : reach;
    wrt::row(group.rays.us) = better ? wrt::row(rays.us) : wrt::row(group.rays.us);
    wrt::row(group.rays.vs) = better ? wrt::row(rays.vs) : wrt::row(group.rays.vs);
    wrt::row(group.rays.ids) = better ? ids : wrt::row(group.rays.ids);
    wrt::row(group.instances) = better ? (ints)number : instances;
#if defined(WRT_BOXES)
    const auto& boxes = rays.boxes.all;
    group.rays.boxes.all.add(boxes.first, boxes.second, (ints)number, boxes.id);
#endif
}
template<bool any_hit, bool octants, class Placed>
LANES_CALLED void follow_together(const Placed& placed, const wrt::Axes& axes, InstanceJourneys& group) {
    const Leaving<any_hit, Placed> part = {placed, axes, group, -1};
    const auto visit = [&](const int child, const ints within, int) __attribute__((always_inline)) {
        visit_instance<any_hit>(placed, axes, group, -1 - child, within);
    };
    wrt::visit_together<octants>(upper_tree(placed), group.rays, 0.0f, visit, part);
}

// Trace the rays of `exec` as long as they stay together.
template<bool any_hit, class Placed>
LANES_CALLED void set_out(
    const Placed& placed, const wrt::Axes& axes, InstanceJourneys& group, const Vector<3, Floats>& origin,
    const Vector<3, Floats>& direction, const Floats t_max, const Mask exec) {
    for (int k = 0; k < 3; ++k) {
        group.origin[k] = origin.c[k].v;
        group.direction[k] = direction.c[k].v;
    }
    const ints can_hit = wrt::set_up(group.rays, group.origin, group.direction) & (t_max.v >= 0.0f);
    const unsigned runs = wrt::mask_of(can_hit) & bits(exec);
    wrt::row(group.rays.reach) = choose(of_bits(runs), t_max.v, (floats)-1.0f);
    wrt::row(group.instances) = wrt::NOTHING_HIT;
    group.partings.some = group.partings.count = 0;
    if (__builtin_popcount(runs) < wrt::FEW_RAYS) {
        group.trees[0] = -1;
        group.partings.all_leave(runs);
        return;
    }
    const bool octants = wrt::mask_of(wrt::row(group.rays.flips) != group.rays.flips[__builtin_ctz(runs)]) & runs;
    if (octants) follow_together<any_hit, true>(placed, axes, group);
    else follow_together<any_hit, false>(placed, axes, group);
}

// The hits of rays that are done, as of `wrt::closest_instance_hit`.
#if defined(WRT_BOXES)
typedef Vector<9, Floats> InstanceFound;
#else
typedef Vector<5, Floats> InstanceFound;
#endif
template<class Placed>
LANES_CALLED InstanceFound found(const Placed& placed, const InstanceJourneys& group, const Floats t_max) {
    const ints instances = wrt::row(group.instances), none = instances == wrt::NOTHING_HIT;
    ints triangles = -1;
    for (int n = 0; n < WIDTH; ++n)
        if (!none[n]) triangles[n] = group.rays.ids[n] + placed.instances.data[instances[n]].first_triangle;
    InstanceFound found;
    found.c[0].v = __builtin_bit_cast(floats, none ? (ints)-1 : instances);
    found.c[1].v = __builtin_bit_cast(floats, triangles);
    found.c[2].v = none ? t_max.v : wrt::row(group.rays.reach);
    found.c[3].v = wrt::row(group.rays.us);
    found.c[4].v = wrt::row(group.rays.vs);
#if defined(WRT_BOXES)
    const auto& boxes = group.rays.boxes.all;
    const ints no_box = boxes.id == wrt::NOTHING_HIT;
    ints numbers = -1;
    for (int n = 0; n < WIDTH; ++n)
        if (!no_box[n]) numbers[n] = boxes.id[n] + placed.instances.data[boxes.instance[n]].first_triangle;
    found.c[5].v = __builtin_bit_cast(floats, no_box ? (ints)-1 : boxes.instance);
    found.c[6].v = __builtin_bit_cast(floats, numbers);
    found.c[7].v = boxes.first;
    found.c[8].v = boxes.second;
#endif
    return found;
}
} // namespace lanes
