#pragma once
// Groups of rays through the ray tree, as the paths of all lanes cast them.
//
// All rays of a group descend together first (`together.h`). When few are left, the node is put on a list with the bits
// of these rays; they go on alone from there, several interleaved (`in_turn.h`), from many groups if these are traced
// together. The hits are those of single rays, bit for bit.
#include "in_turn.h"
#include "lanes/memory.h"
#include "together.h"

namespace lanes {
typedef wrt::Rays<WIDTH> Rays;
// Nodes at which some rays leave their group, to go on alone. If there are more, the group's lone rays go on without
// those of other groups, so fewer are interleaved.
constexpr int MOST_PARTINGS = 64;  // as many as `Lone::left` has bits
struct alignas(64) Partings {
    float begins[MOST_PARTINGS][WIDTH];  // of all rays
    unsigned rays[MOST_PARTINGS];        // bits of the rays that leave
    int nodes[MOST_PARTINGS], count;
    unsigned some;  // bits of the rays that leave anywhere

    // Put a node on the list; `go` follows those on it when it is full.
    template<class Go>
    WRT_MEMBER void add(const int node, const unsigned leaving, const floats& begins_there, Go go) {
        // Also without any rays left, which saves a branch that would be mispredicted.
        const int k = count;
        *(floats*)begins[k] = begins_there;
        nodes[k] = node;
        rays[k] = leaving;
        some |= leaving;
        count = k + (leaving != 0);
        if (count == MOST_PARTINGS) {
            go();
            count = 0;
        }
    }
    // Put the root on the empty list.
    WRT_MEMBER void all_leave(const unsigned leaving) {
        count = 1;
        some = rays[0] = leaving;
        nodes[0] = 0;
        *(floats*)begins[0] = (floats)0.0f;
    }
};
// A group of rays in flight.
struct Journeys {
    Rays rays;
    Partings partings;
};

// A ray that leaves its group.
template<class Journeys> struct LoneOf : wrt::Traveller {
    unsigned long long left;  // bits of the partings still to follow
    Journeys* group;

    // Take the next ray that leaves any of some groups, and return whether there is one.
    WRT_MEMBER bool take(Journeys*& next, Journeys* const end) {
        number = -1;
        for (; next < end; ++next) {
            Partings& partings = next->partings;
            if (!partings.some) continue;
            group = next;
            number = __builtin_ctz(partings.some);
            partings.some &= partings.some - 1;
            nearest = next->rays.nearest(number);
            top = 0;
            const ints own = (ints)(1 << number);
            left = 0;
            LANES_UNROLL for (int first = 0; first < MOST_PARTINGS; first += WIDTH) {
                const ints parts = (*(const ints*)(partings.rays + first) & own) != 0;
                left |= (unsigned long long)wrt::mask_of(parts) << first;
            }
            left &= ~0ull >> (64 - partings.count);
            return true;
        }
        return false;
    }
    // Take the next parting whose box begins before `limit`; −1 if there is none.
    WRT_MEMBER int next_parting(const float limit) {
        while (left) {
            const int k = __builtin_ctzll(left);
            left &= left - 1;
            if (group->partings.begins[k][number] <= limit) return k;
        }
        return -1;
    }
};
// Those of one tree, for `follow_in_turn`.
typedef LoneOf<Journeys> Lone;
struct LoneRays {
    const wrt::Tree all;
    Journeys *next, *end;

    WRT_MEMBER bool branch(Lone& r) {
        const float limit = r.nearest.t * (float)wrt::BOX_PAD;
        const int k = limit < 0.0f ? -1 : r.next_parting(limit);
        if (k >= 0) r.current = r.group->partings.nodes[k];
        return k >= 0;
    }
    WRT_MEMBER void start(Lone& r) {
        while (r.take(next, end))
            if (branch(r)) return;
    }
    WRT_MEMBER void finish(Lone& r) { r.group->rays.set(r.number, r.nearest); }
    WRT_MEMBER wrt::Ray ray(const Lone& r) { return r.group->rays.one(r.number); }
    WRT_MEMBER const wrt::Tree& tree(const Lone&) { return all; }
};
// Reading a large tree takes several hundred cycles, as it fits no cache.
template<class Bvh> LANES_INLINE bool is_large(const Bvh& bvh) { return bvh.leaves.shape[0] > wrt::LARGE_TREE; }

template<bool any_hit, class Bvh>
LANES_CALLED void follow_alone(const Bvh& bvh, Journeys* groups, const int count) {
    LoneRays rays = {wrt::tree_of(bvh), groups, groups + count};
    const bool large = is_large(bvh);
    const int in_turn = large ? wrt::IN_TURN_IF_LARGE : wrt::IN_TURN;
    wrt::follow_in_turn<any_hit, wrt::IN_TURN_IF_LARGE, Lone>(0.0f, in_turn, large ? 5 : 4, rays);
}

template<bool any_hit, bool octants, bool axes, class Bvh>
LANES_CALLED void follow_together(const Bvh& bvh, Journeys& journeys) {
    wrt::follow_together<any_hit, octants, axes>(
        wrt::tree_of(bvh), journeys.rays, 0.0f,
        [&](const int node, const unsigned rays, const floats& begins) __attribute__((always_inline)) {
            journeys.partings.add(node, rays, begins, [&] { follow_alone<any_hit>(bvh, &journeys, 1); });
        });
}
template<bool any_hit, class Bvh>
static void follow_any_together(const Bvh& bvh, Journeys& journeys, const bool octants, const bool axes) {
    if (octants) follow_together<any_hit, true, true>(bvh, journeys);
    else if (axes) follow_together<any_hit, false, true>(bvh, journeys);
    else follow_together<any_hit, false, false>(bvh, journeys);
}

// Trace the rays of `exec` as long as they stay together.
template<class Bvh>
LANES_CALLED void set_out(
    const Bvh& bvh, const wrt::Axes& axes, Journeys& journeys, const Vector<3, Floats>& origin_,
    const Vector<3, Floats>& direction_, const Floats t_max, const bool any_hit, const Mask exec) {
    Rays& a = journeys.rays;
    Partings& partings = journeys.partings;
    a.axes = axes;
    const floats origin[3] = {origin_.c[0].v, origin_.c[1].v, origin_.c[2].v};
    const floats direction[3] = {direction_.c[0].v, direction_.c[1].v, direction_.c[2].v};
    const ints can_hit = wrt::set_up(a, origin, direction) & (t_max.v >= 0.0f);
    const unsigned runs = wrt::mask_of(can_hit) & bits(exec);
    wrt::row(a.reach) = choose(of_bits(runs), t_max.v, (floats)-1.0f);

    const int few = is_large(bvh) ? wrt::FEW_RAYS_IF_LARGE : wrt::FEW_RAYS;
    partings.some = partings.count = 0;
    if (__builtin_popcount(runs) < few) {
        partings.all_leave(runs);
    } else {
        const int one = __builtin_ctz(runs);
        const bool octants = wrt::mask_of(wrt::row(a.flips) != a.flips[one]) & runs;
        const bool mixed_axes = wrt::mask_of(wrt::row(a.kzs) != a.kzs[one]) & runs;
        if (any_hit) follow_any_together<true>(bvh, journeys, octants, mixed_axes);
        else follow_any_together<false>(bvh, journeys, octants, mixed_axes);
    }
}

// The hits of rays that are done, as of `wrt::found_of`.
#if defined(WRT_BOXES)
typedef Vector<7, Floats> Found;
#else
typedef Vector<4, Floats> Found;
#endif
LANES_CALLED Found found(const Journeys& journeys, const Floats t_max) {
    const Rays& a = journeys.rays;
    const ints id = wrt::row(a.ids);
    Found found;
    found.c[0].v = __builtin_bit_cast(floats, id == wrt::NOTHING_HIT ? (ints)-1 : id);
    found.c[1].v = id == wrt::NOTHING_HIT ? t_max.v : wrt::row(a.reach);
    found.c[2].v = wrt::row(a.us);
    found.c[3].v = wrt::row(a.vs);
#if defined(WRT_BOXES)
    const ints box = a.boxes.all.id;
    found.c[4].v = __builtin_bit_cast(floats, box == wrt::NOTHING_HIT ? (ints)-1 : box);
    found.c[5].v = a.boxes.all.first;
    found.c[6].v = a.boxes.all.second;
#endif
    return found;
}

// The lanes' `wrt::closest_hit`. All rays of `exec` have the same any_hit.
template<class Bvh, class Corners, class Normals>
LANES_CALLED Found closest_hit(
    const Bvh& bvh, const Corners& corners, const Normals& normals, const Vector<3, Floats>& origin,
    const Vector<3, Floats>& direction, Floats t_max, Mask any_hit_, Mask exec) {
    const bool any_hit = lane(any_hit_, __builtin_ctz(bits(exec) | 1u << (WIDTH - 1)));
    Journeys journeys;
    set_out(bvh, wrt::axes_of(corners, normals), journeys, origin, direction, t_max, any_hit, exec);
    if (journeys.partings.some) {
        if (any_hit) follow_alone<true>(bvh, &journeys, 1);
        else follow_alone<false>(bvh, &journeys, 1);
    }
    return found(journeys, t_max);
}
} // namespace lanes
