#pragma once
// Sampling the light tree for several lanes.
//
// All lanes descend together, each at a node of its own. The eight children of a node fill half a register of sixteen
// numbers, so the importances for two lanes are computed at once there, pair after pair: the pairs do not depend on each
// other, unlike the steps of a single descent. Then all lanes choose at once. Results agree bit for bit with `wrt::sample_light_tree`.
#include "lanes/memory.h"
#include "light_tree.h"

namespace lanes {
// What the weights of a node's children depend on, and these, for each lane.
struct Choices {
    alignas(64) float weights[WIDTH][8], nearests[WIDTH];
    alignas(64) int places[WIDTH];
};
// Weigh the children of each lane's node, of the lanes in `going`.
#if LANES_WIDTH == 16
LANES_INLINE void weigh(
    Choices& all, const float* nodes, const Vector<3, Floats>& position_, const Vector<3, Floats>& normal_,
    const Ints& receives_, const Mask going) {
    using wrt::f8;
    for (unsigned rest = bits(going); rest;) {
        const int a = __builtin_ctz(rest);
        rest &= rest - 1;
        const int b = rest ? __builtin_ctz(rest) : a;
        rest &= rest - 1;
        const float* const one = nodes + (size_t)all.places[a] * wrt::LIGHT_NODE_FLOATS;
        const float* const two = nodes + (size_t)all.places[b] * wrt::LIGHT_NODE_FLOATS;
        const ints both = choose(of_bits(0xff), (ints)a, (ints)b);
        #define OF_TWO(of_all) permuted(of_all, both)
        const floats position[3] = {OF_TWO(position_.c[0].v), OF_TWO(position_.c[1].v), OF_TWO(position_.c[2].v)};
        const floats normal[3] = {OF_TWO(normal_.c[0].v), OF_TWO(normal_.c[1].v), OF_TWO(normal_.c[2].v)};
        const ints receives = (ints)OF_TWO((floats)receives_.v);
        #undef OF_TWO
        const auto row = [&](int k) __attribute__((always_inline)) {
            const f8 of_one = *(const f8*)(one + 8 * k), of_two = *(const f8*)(two + 8 * k);
            return __builtin_shufflevector(of_one, of_two, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
        };
        const wrt::WeightsOf<floats> of = wrt::weights_of<floats>(row, position, normal, receives);
        *(f8*)all.weights[a] = __builtin_shufflevector(of.weights, of.weights, 0, 1, 2, 3, 4, 5, 6, 7);
        *(f8*)all.weights[b] = __builtin_shufflevector(of.weights, of.weights, 8, 9, 10, 11, 12, 13, 14, 15);
        all.nearests[a] = of.nearest[0];
        all.nearests[b] = of.nearest[8];
    }
}
#else
LANES_INLINE void weigh(
    Choices& all, const float* nodes, const Vector<3, Floats>& position_, const Vector<3, Floats>& normal_,
    const Ints& receives_, const Mask going) {
    LANES_EACH(l, going) {
        const float* const node = nodes + (size_t)all.places[l] * wrt::LIGHT_NODE_FLOATS;
        const float position[3] = {position_.c[0].v[l], position_.c[1].v[l], position_.c[2].v[l]};
        const float normal[3] = {normal_.c[0].v[l], normal_.c[1].v[l], normal_.c[2].v[l]};
        const wrt::Weights of = wrt::weigh(node, position, normal, receives_.v[l]);
        __builtin_memcpy(all.weights[l], of.of, sizeof of.of);
        all.nearests[l] = of.nearest;
    }
}
#endif

template<class LightTree>
LANES_CALLED Vector<4, Floats> sample_light_tree(
    const LightTree& tree, const Vector<3, Floats>& position, const Vector<3, Floats>& normal, const Ints& receives,
    const Vector<2, Floats>& u, const Mask exec) {
    using wrt::BELOW_ONE;
    using wrt::LEAST_SHARE;
    const float* const nodes = (const float*)tree.nodes.data;
    Choices all;
    #define IN_DOUBLE(a) __builtin_convertvector(a, doubles)
    doubles probability = 1.0, place = IN_DOUBLE(u.c[0].v) + IN_DOUBLE(u.c[1].v) * 5.9604644775390625e-8;
    ints current = 0;
    Mask going = exec, far = false;
    bool root = true;
    while (any(going)) {
        *(ints*)all.places = current;
        weigh(all, nodes, position, normal, receives, going);
        doubles sums[9];
        floats weights[8];
        sums[0] = 0.0;
        for (int half = 0; half < 2; ++half) {
            const FourRows four = transposed([&](int l) __attribute__((always_inline)) {
                return *(const f4*)(all.weights[l] + 4 * half);
            });
            for (int k = 0; k < 4; ++k) weights[4 * half + k] = four.r[k];
        }
        for (int k = 0; k < 8; ++k) sums[k + 1] = sums[k] + IN_DOUBLE(weights[k]);
        if (root && tree.far > 0.0f) {
            const doubles irradiance = sums[8] * (double)tree.scale / IN_DOUBLE(*(const floats*)all.nearests);
            doubles share = 1.0 / (1.0 + (double)tree.far / irradiance);
            const doubles most = 1.0 - LEAST_SHARE;
            share = share < LEAST_SHARE ? (doubles)LEAST_SHARE : (share < most ? share : most);
            share = sums[8] > 0.0 ? share : (doubles)0.0;
            far = going & Mask::of(place >= share);
            place = choose(far, (place - share) / (1.0 - share), place / share);
            probability = choose(far, 1.0 - share, share);
            going = going & ~far;
        }
        root = false;
        const Mask dark = going & ~Mask::of(sums[8] > 0.0);
        probability = choose(dark, (doubles)0.0, probability);
        going = going & ~dark;
        const doubles target = (place < BELOW_ONE ? place : (doubles)BELOW_ONE) * sums[8];
        doubles before = 0.0, own = 1.0;
        ints chosen = 0;
        for (int k = 0; k < 8; ++k) {
            const Mask here = Mask::of(target >= sums[k]) & Mask(weights[k] > 0.0f);
            before = choose(here, sums[k], before);
            own = choose(here, IN_DOUBLE(weights[k]), own);
            chosen = choose(here, (ints)k, chosen);
        }
        place = choose(going, (target - before) / own, place);
        probability = choose(going, probability * (own / sums[8]), probability);
        alignas(64) int children[WIDTH];
        *(ints*)children = chosen;
        LANES_EACH(l, going) {
            const float* const node = nodes + (size_t)all.places[l] * wrt::LIGHT_NODE_FLOATS;
            all.places[l] = ((const int*)(node + wrt::LIGHT_CHILDREN))[children[l]];
        }
        current = *(const ints*)all.places;
        going = going & Mask(current >= 0);
    }
    const Mask found = Mask::of(probability > 0.0);
    const ints light = choose(far, (ints)-2, choose(found, -1 - current, (ints)-1));
    place = (place < BELOW_ONE ? place : (doubles)BELOW_ONE) * 16777216.0;
    const ints rest = __builtin_convertvector(place, ints);
    const ints more = __builtin_convertvector((place - IN_DOUBLE(rest)) * 16777216.0, ints);
    const float digit = 5.9604644775390625e-8f;
    const doubles least = 1e-37;
    const doubles known = choose(found & Mask::of(probability < least), least, probability);
    Vector<4, Floats> r;
    r.c[0].v = __builtin_bit_cast(floats, light);
    r.c[1].v = __builtin_convertvector(known, floats);
    r.c[2].v = __builtin_convertvector(rest, floats) * digit;
    r.c[3].v = __builtin_convertvector(more, floats) * digit;
    return r;
    #undef IN_DOUBLE
}
} // namespace lanes
