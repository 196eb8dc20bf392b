#pragma once
// Sampling the light tree (`kernels/lights/choice.py`).
#include "vectors.h"

namespace wrt {
#if WRT_VECTORS
// Square roots start from the processor's 14-bit estimates where it has them: 1.03 times as fast (docs/performance.md).
#if defined(__AVX512VL__)
WRT_INLINE f8 inverse_root(f8 a) { return __builtin_ia32_rsqrt14ps256_mask(a, (f8)0.0f, 255); }
WRT_INLINE f16 inverse_root(f16 a) { return __builtin_ia32_rsqrt14ps512_mask(a, (f16)0.0f, (unsigned short)-1); }
template<class V> WRT_INLINE V root(V a) { return a * inverse_root(most(a, (V)1e-36f)); }
#else
template<class V> WRT_INLINE V root(V a) { return __builtin_elementwise_sqrt(a); }
template<class V> WRT_INLINE V inverse_root(V a) { return 1.0f / root(a); }
#endif
WRT_INLINE bool any_of(bool c) { return c; }
WRT_INLINE bool any_of(i16 c) { return mask_of(c) != 0; }
#else
WRT_INLINE float root(float a) { return sqrtf(a); }
WRT_INLINE float inverse_root(float a) { return 1.0f / sqrtf(a); }
WRT_INLINE bool any_of(bool c) { return c; }
#endif

// The importance of a node's children, times the least squared distance, which keeps it within the range of floats for
// scenes of any scale.
//
// A group's sphere subtends the half angle u, widened by a thousandth, which covers the rounding of all cosines here;
// the tree's bound of the falloff cosine has the same margin. `cos_emitted` is the cosine of max(0, angle to the axis -
// spread - u), `cos_received` that of max(0, angle to the normal - u). So a group has zero importance only if none of
// its lights can reach the point. Spheres are loose around lights in a plane. A group's box therefore bounds its height
// above the point's horizon, which lowers the cosine (to one and a half times that height over the mean distance, since
// some lights are nearer); and if all normals agree, the box's extent along them shows whether the point is behind all
// lights. docs/performance.md has the gain.
template<class V> struct Importance {
    V importance, power;
    V distance2, inverse_mean;  // for the far field of a group, finite at its centre; 1 over its square root
};
// row(k) returns row k of a node; position, normal and receives belong to the point.
template<class V, class Row, class Vector, class Receives>
WRT_INLINE Importance<V> importance_of(Row row, const Vector& position, const Vector& normal, const Receives receives) {
    const V dx = row(0) - position[0], dy = row(1) - position[1], dz = row(2) - position[2];
    const V radius = size((V)row(6)), center2 = dx * dx + dy * dy + dz * dz, radius2 = radius * radius;
    const V inverse = inverse_root(most(center2, (V)1e-36f));
    const V distance2 = most(center2 + 0.25f * radius2, (V)1e-36f), inverse_mean = inverse_root(distance2);
    const V sin_u = least(radius * inverse + 1e-3f, (V)1.0f), cos_u = root((V)(1.0f - sin_u * sin_u));
    // At the lights: the angle to the axis, less the spread, less u.
    V depth = -(dx * row(7) + dy * row(8) + dz * row(9));
    depth = row(6) < 0.0f ? size(depth) : depth;
    const V cos_w = least(depth * inverse, (V)1.0f), sin_w = root(most(1.0f - cos_w * cos_w, (V)0.0f));
    const V cos_o = row(10), sin_o = row(12);
    const V cos_x = cos_w > cos_o ? (V)1.0f : cos_w * cos_o + sin_w * sin_o;
    const V sin_x = cos_w > cos_o ? (V)0.0f : sin_w * cos_o - cos_w * sin_o;
    const V cos_emitted = cos_x > cos_u ? (V)1.0f : cos_x * cos_u + sin_x * sin_u;
    // Inside the sphere any direction is possible.
    V importance = center2 <= radius2 ? (V)1.0f : (cos_emitted > row(11) ? cos_emitted : (V)0.0f);
    importance = (depth + row(13)) * inverse_mean < -3e-3f ? (V)0.0f : importance;
    if (any_of(receives != RECEIVES_ANYWHERE)) {
        V height = dx * normal[0] + dy * normal[1] + dz * normal[2];
        height = receives == RECEIVES_BOTH ? size(height) : height;
        const V above = row(3) * size(normal[0]) + row(4) * size(normal[1]) + row(5) * size(normal[2]);
        const V cos_i = least(height * inverse, (V)1.0f), sin_i = root(most(1.0f - cos_i * cos_i, (V)0.0f));
        V cos_received = cos_i > cos_u ? (V)1.0f : cos_i * cos_u + sin_i * sin_u;
        cos_received = center2 <= radius2 ? (V)1.0f : cos_received;
        cos_received = least(cos_received, 1.5f * (height + above) * inverse_mean + 1e-3f);
        importance *= receives == RECEIVES_ANYWHERE ? (V)1.0f : most(cos_received, (V)0.0f);
    }
    return {importance, row(14), distance2, inverse_mean};
}

#if WRT_VECTORS
// Eight numbers rotated by four, two and one places; likewise twice eight.
#define WRT_TURNED(a, ...) __builtin_shufflevector(a, a, __VA_ARGS__)
WRT_INLINE f8 least_of_eight(f8 a) {
    a = least(a, WRT_TURNED(a, 4, 5, 6, 7, 0, 1, 2, 3));
    a = least(a, WRT_TURNED(a, 2, 3, 0, 1, 6, 7, 4, 5));
    return least(a, WRT_TURNED(a, 1, 0, 3, 2, 5, 4, 7, 6));
}
WRT_INLINE f16 least_of_eight(f16 a) {
    a = least(a, WRT_TURNED(a, 4, 5, 6, 7, 0, 1, 2, 3, 12, 13, 14, 15, 8, 9, 10, 11));
    a = least(a, WRT_TURNED(a, 2, 3, 0, 1, 6, 7, 4, 5, 10, 11, 8, 9, 14, 15, 12, 13));
    return least(a, WRT_TURNED(a, 1, 0, 3, 2, 5, 4, 7, 6, 9, 8, 11, 10, 13, 12, 15, 14));
}
#undef WRT_TURNED
// The weights of the children of one node, or of two nodes side by side, and the least squared distance of each node.
template<class V> struct WeightsOf {
    V weights, nearest;
};
template<class V, class Row, class Vector, class Receives>
WRT_INLINE WeightsOf<V> weights_of(Row row, const Vector& position, const Vector& normal, const Receives receives) {
    Importance<V> of = importance_of<V>(row, position, normal, receives);
    const V least = least_of_eight(of.power > 0.0f ? of.distance2 : (V)3e38f);
    of.importance *= of.power;
    const V nearness = least * of.inverse_mean * of.inverse_mean;
    return {of.importance > 0.0f ? most(of.importance * nearness, (V)1e-36f) : (V)0.0f, least};
}
#endif

// The weights of a node's children, and the least squared distance.
struct Weights {
    alignas(32) float of[8];
    float nearest;
};
template<class Vector>
WRT_INLINE Weights weigh(const float* node, const Vector& position, const Vector& normal, const int receives) {
    Weights r;
#if WRT_VECTORS
    const auto row = [&](int k) WRT_INLINE_LAMBDA { return *(const f8*)(node + 8 * k); };
    const WeightsOf<f8> weights = weights_of<f8>(row, position, normal, receives);
    *(f8*)r.of = weights.weights;
    r.nearest = weights.nearest[0];
#else
    float inverses[8];
    r.nearest = 3e38f;
    for (int lane = 0; lane < 8; ++lane) {
        const auto row = [&](int k) { return node[8 * k + lane]; };
        const Importance<float> of = importance_of<float>(row, position, normal, receives);
        r.of[lane] = of.importance * of.power;
        inverses[lane] = of.inverse_mean;
        if (of.power > 0.0f) r.nearest = fminf(r.nearest, of.distance2);
    }
    for (int lane = 0; lane < 8; ++lane)
        if (r.of[lane] > 0.0f) r.of[lane] = fmaxf(r.of[lane] * (r.nearest * inverses[lane] * inverses[lane]), 1e-36f);
#endif
    return r;
}

// The probability of the lights in the tree, from the sum of the root's weights.
template<class LightTree> WRT_INLINE double share_of(const LightTree& tree, const double near, const float nearest) {
    const double irradiance = near * tree.scale / nearest;
    double share = tree.far > 0.0f ? 0.0 : 1.0;
    if (tree.far > 0.0f && near > 0.0) {
        share = 1.0 / (1.0 + tree.far / irradiance);
        share = share < LEAST_SHARE ? LEAST_SHARE : share < 1.0 - LEAST_SHARE ? share : 1.0 - LEAST_SHARE;
    }
    return share;
}
// A probability rounded to a float that is 0 only for a probability of 0.
WRT_INLINE float probability_of(const double p) { return p > 0.0 && p < 1e-37 ? 1e-37f : (float)p; }

constexpr double BELOW_ONE = 0.999999999999;

// A light, and the rescaled random numbers.
//
// Sums and probabilities are in double precision: one random number of 48 bits must reach each of a million lights with
// its probability, and the probability of a light must be the same computed downwards and upwards.
template<class LightTree, class Vector, class Numbers>
WRT_INLINE wp::vec_t<4, float> sample_light_tree(
    const LightTree& tree, const Vector& position, const Vector& normal, const int receives, const Numbers& u) {
    const float* const nodes = (const float*)tree.nodes.data;
    double probability = 1.0, place = (double)u[0] + (double)u[1] * 5.9604644775390625e-8;
    int current = 0;
    bool far = false;
    do {
        const float* const node = nodes + (size_t)current * LIGHT_NODE_FLOATS;
        const Weights weights = weigh(node, position, normal, receives);
        double sums[9];
        sums[0] = 0.0;
        for (int k = 0; k < 8; ++k) sums[k + 1] = sums[k] + (double)weights.of[k];
        if (current == 0) {
            const double share = share_of(tree, sums[8], weights.nearest);
            if (place >= share) {
                place = (place - share) / (1.0 - share);
                probability = 1.0 - share;
                far = true;
                break;
            }
            place /= share;
            probability = share;
        }
        if (!(sums[8] > 0.0)) {
            probability = 0.0;
            break;
        }
        const double target = (place < BELOW_ONE ? place : BELOW_ONE) * sums[8];
        int chosen = 0;
        for (int k = 1; k < 8; ++k) chosen += target >= sums[k];
        // Rounding may lead to a last child of zero weight.
        while (!(weights.of[chosen] > 0.0f)) --chosen;
        place = (target - sums[chosen]) / (double)weights.of[chosen];
        probability *= (double)weights.of[chosen] / sums[8];
        current = ((const int*)(node + LIGHT_CHILDREN))[chosen];
    } while (current >= 0);
    const int light = far ? -2 : probability > 0.0 ? -1 - current : -1;
    // The rescaled random number, as two numbers of 24 bits.
    place = (place < BELOW_ONE ? place : BELOW_ONE) * 16777216.0;
    const int rest = (int)place, more = (int)((place - rest) * 16777216.0);
    const float digit = 5.9604644775390625e-8f;
    return wp::vec_t<4, float>(float_of(light), probability_of(probability), rest * digit, more * digit);
}

// The probability with which `sample_light_tree` chooses a light.
template<class LightTree, class Vector>
WRT_INLINE float light_probability(
    const LightTree& tree, const int light, const Vector& position, const Vector& normal, const int receives) {
    const float* const nodes = (const float*)tree.nodes.data;
    int place = ((const int*)tree.places.data)[light];
    double probability = place < 0 ? 0.0 : 1.0;
    while (place >= 0) {
        const int current = place / 8, chosen = place % 8;
        const Weights weights = weigh(nodes + (size_t)current * LIGHT_NODE_FLOATS, position, normal, receives);
        if (!(weights.of[chosen] > 0.0f)) return 0.0f;
        double sum = 0.0;
        for (int k = 0; k < 8; ++k) sum += (double)weights.of[k];
        probability *= (double)weights.of[chosen] / sum;
        place = ((const int*)tree.parents.data)[current];
        if (place < 0) probability *= share_of(tree, sum, weights.nearest);
    }
    return probability_of(probability);
}

// The probability with which it chooses the lights at infinity.
template<class LightTree, class Vector>
WRT_INLINE float
far_light_probability(const LightTree& tree, const Vector& position, const Vector& normal, const int receives) {
    const Weights weights = weigh((const float*)tree.nodes.data, position, normal, receives);
    double near = 0.0;
    for (int k = 0; k < 8; ++k) near += (double)weights.of[k];
    return (float)(1.0 - share_of(tree, near, weights.nearest));
}
} // namespace wrt
