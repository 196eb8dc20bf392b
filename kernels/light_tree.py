"""Choosing among many lights by what they can do at a point: a walk down a tree over them.

The importance of a group of lights is that of Conty Estevez and Kulla, "Importance Sampling of Many Lights with
Adaptive Tree Splitting" (2018), with the trigonometry of Pharr, Jakob and Humphreys, "Physically Based Rendering",
4th edition, section 12.6.3: power over distance squared, times the greatest cosines that are possible at the lights and
at the point for any light of the group. Nodes have eight children (`wrt/build/light_tree.py`), weighed together.
"""

import warp as wp

from wrt.kernels.geometry import RECEIVES_ANYWHERE, RECEIVES_BOTH
from wrt.kernels.simd import VECTOR_CODE

NO_LIGHT = wp.constant(-1)
FAR_LIGHT = wp.constant(-2)

# Between lights that are somewhere and those infinitely far away a point chooses by what irradiance each could give
# it. What is in the way is not known, so each gets at least this.
_LEAST_SHARE = "0.2"


@wp.struct
class LightTree:
    """The tree as `wrt.build.light_tree.LightTree` has it, with at least one node.

    `far` is the irradiance of all lights that are infinitely far away, 0 where there are none; `scale` makes the
    importance of the root's children an irradiance as well.
    """

    nodes: wp.array(dtype=float)
    parents: wp.array(dtype=int)
    places: wp.array(dtype=int)
    scale: float
    far: float


@wp.struct
class TreeChoice:
    """A light, FAR_LIGHT for any that is not in the tree, or NO_LIGHT, and the probability of the choice.

    `rest` and `more` are what is left of the numbers that chose: uniform in [0, 1), `more` with the further digits.
    """

    light: int
    probability: float
    rest: float
    more: float


# The importance of a node's children, times the least of distance squared so that no scale of scene leaves the range of
# floats.
#
# A group's sphere is seen under the half angle u; that is widened by a thousandth, which covers the rounding of all
# cosines here, and so does what the tree leaves of the cosine of falloff. `cos_emitted` is that of max(0, angle to the
# axis − spread − u), `cos_received` that of max(0, angle to the normal − u). So a group weighs nothing only where none
# of its lights can light the point. Spheres are wide around lights that lie in a plane. So their box tells how far they
# are above the horizon of the point at most, which leaves less of the cosine (half as much again as that height over
# the mean distance, for some are nearer); and where all normals are one, their extent along it tells whether the point
# is behind them all. What this gains stands in docs/performance.md.
#
#   in:  node: const float*; position, normal: vectors; receives
#   out: importance, distance2 (for the far field of a group, and finite at its centre), inverse_mean (1 over the root
#        of that), power
_WEIGH = """
    const V dx = ROW(0) - position[0], dy = ROW(1) - position[1], dz = ROW(2) - position[2];
    const V radius = SIZE(ROW(6)), center2 = dx * dx + dy * dy + dz * dz, radius2 = radius * radius;
    const V inverse = INVERSE_ROOT(MOST(center2, (V)1e-36f));
    const V distance2 = MOST(center2 + 0.25f * radius2, (V)1e-36f), inverse_mean = INVERSE_ROOT(distance2);
    const V sin_u = LEAST(radius * inverse + 1e-3f, (V)1.0f), cos_u = ROOT(1.0f - sin_u * sin_u);
    // At the lights: the angle to the axis, then less the spread, then less u.
    V depth = -(dx * ROW(7) + dy * ROW(8) + dz * ROW(9));
    depth = WHERE(ROW(6) < 0.0f, SIZE(depth), depth);
    const V cos_w = LEAST(depth * inverse, (V)1.0f), sin_w = ROOT(MOST(1.0f - cos_w * cos_w, (V)0.0f));
    const V cos_o = ROW(10), sin_o = ROW(12);
    const V cos_x = WHERE(cos_w > cos_o, (V)1.0f, cos_w * cos_o + sin_w * sin_o);
    const V sin_x = WHERE(cos_w > cos_o, (V)0.0f, sin_w * cos_o - cos_w * sin_o);
    const V cos_emitted = WHERE(cos_x > cos_u, (V)1.0f, cos_x * cos_u + sin_x * sin_u);
    // Inside the sphere any direction is possible.
    V importance = WHERE(center2 <= radius2, (V)1.0f, WHERE(cos_emitted > ROW(11), cos_emitted, (V)0.0f));
    importance = WHERE((depth + ROW(13)) * inverse_mean < -3e-3f, (V)0.0f, importance);
    if (ANY(receives != RECEIVES_ANYWHERE)) {
        V height = dx * normal[0] + dy * normal[1] + dz * normal[2];
        height = WHERE(receives == RECEIVES_BOTH, SIZE(height), height);
        const V above = ROW(3) * SIZE_OF(normal[0]) + ROW(4) * SIZE_OF(normal[1]) + ROW(5) * SIZE_OF(normal[2]);
        const V cos_i = LEAST(height * inverse, (V)1.0f), sin_i = ROOT(MOST(1.0f - cos_i * cos_i, (V)0.0f));
        V cos_received = WHERE(cos_i > cos_u, (V)1.0f, cos_i * cos_u + sin_i * sin_u);
        cos_received = WHERE(center2 <= radius2, (V)1.0f, cos_received);
        cos_received = LEAST(cos_received, 1.5f * (height + above) * inverse_mean + 1e-3f);
        importance *= WHERE(receives == RECEIVES_ANYWHERE, (V)1.0f, MOST(cos_received, (V)0.0f));
    }
    const V power = ROW(14);
"""

# _WEIGH in vectors: of the children of one node, or of two nodes side by side.
# Roots are those of 14 bits that the processor looks up, where it does: 1.03 times as fast (docs/performance.md).
#   in:  V, ROW, ANY, SIZE_OF, NEAR_INVERSE_ROOT; TURN4, TURN2, TURN1, which turn eight numbers by so many places, or
#        twice eight
#   out: result, least: V, weights and the least of distance squared of each node
_WEIGH_AT_ONCE = (
    """
    #define WHERE(c, a, b) ((c) ? (a) : (b))
#if defined(__AVX512VL__)
    #define INVERSE_ROOT(a) NEAR_INVERSE_ROOT(a)
    #define ROOT(a) ((a) * INVERSE_ROOT(MOST(a, (V)1e-36f)))
#else
    #define INVERSE_ROOT(a) (1.0f / ROOT(a))
    #define ROOT(a) __builtin_elementwise_sqrt(a)
#endif
    #define LEAST(a, b) ((a) < (b) ? (a) : (b))
    #define MOST(a, b) ((a) > (b) ? (a) : (b))
    #define SIZE(a) __builtin_elementwise_abs(a)
"""
    + _WEIGH
    + """
    V least = WHERE(power > 0.0f, distance2, (V)3e38f);
    least = LEAST(least, TURN4(least));
    least = LEAST(least, TURN2(least));
    least = LEAST(least, TURN1(least));
    importance *= power;
    const V nearness = least * inverse_mean * inverse_mean;
    const V result = WHERE(importance > 0.0f, MOST(importance * nearness, (V)1e-36f), (V)0.0f);
    #undef WHERE
    #undef ROOT
    #undef INVERSE_ROOT
    #undef LEAST
    #undef MOST
    #undef SIZE
"""
)

#   in:  as of _WEIGH
#   out: weights: eight floats; nearest: the least of distance squared
WEIGHTS = (
    """
    alignas(32) float weights[8];
    float nearest = 3e38f;
#if VECTOR_CODE
    {
    #define V f8
    #define ROW(k) (*(const f8*)(node + 8 * (k)))
    #define ANY(c) (c)
    #define SIZE_OF(a) fabsf(a)
    #define NEAR_INVERSE_ROOT(a) __builtin_ia32_rsqrt14ps256_mask(a, (V)0.0f, 255)
    #define TURN4(a) __builtin_shufflevector(a, a, 4, 5, 6, 7, 0, 1, 2, 3)
    #define TURN2(a) __builtin_shufflevector(a, a, 2, 3, 0, 1, 6, 7, 4, 5)
    #define TURN1(a) __builtin_shufflevector(a, a, 1, 0, 3, 2, 5, 4, 7, 6)
"""
    + _WEIGH_AT_ONCE
    + """
    *(f8*)weights = result;
    nearest = least[0];
    #undef NEAR_INVERSE_ROOT
    #undef TURN4
    #undef TURN2
    #undef TURN1
    }
#else
    {
    #define V float
    #define ROW(k) node[8 * (k) + lane]
    #define ANY(c) (c)
    #define SIZE_OF(a) fabsf(a)
    #define WHERE(c, a, b) ((c) ? (a) : (b))
    #define ROOT(a) sqrtf(a)
    #define INVERSE_ROOT(a) (1.0f / sqrtf(a))
    #define LEAST(a, b) fminf(a, b)
    #define MOST(a, b) fmaxf(a, b)
    #define SIZE(a) fabsf(a)
    float inverses[8];
    for (int lane = 0; lane < 8; ++lane) {
"""
    + _WEIGH
    + """
        weights[lane] = importance * power;
        inverses[lane] = inverse_mean;
        if (power > 0.0f) nearest = fminf(nearest, distance2);
    }
    for (int lane = 0; lane < 8; ++lane)
        if (weights[lane] > 0.0f)
            weights[lane] = fmaxf(weights[lane] * (nearest * inverses[lane] * inverses[lane]), 1e-36f);
    #undef WHERE
    #undef ROOT
    #undef INVERSE_ROOT
    #undef LEAST
    #undef MOST
    #undef SIZE
    }
#endif
    #undef V
    #undef ROW
    #undef ANY
    #undef SIZE_OF
"""
)

# The same of two nodes, for `kernels/wide/light_tree.py`.
#   in:  f8, f16; one, two: const float*; position, normal: three f16 each, eight numbers of either node's point;
#        receives: integers, likewise
#   out: result, least: f16
WEIGHTS_OF_TWO = (
    """
    #define V f16
    #define JOINED(a, b) __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15)
    #define ROW(k) JOINED(*(const f8*)(one + 8 * (k)), *(const f8*)(two + 8 * (k)))
    #define ANY(c) lanes::any(lanes::Mask(c))
    #define SIZE_OF(a) SIZE(a)
    #define NEAR_INVERSE_ROOT(a) __builtin_ia32_rsqrt14ps512_mask(a, (V)0.0f, (unsigned short)-1)
    #define TURN4(a) __builtin_shufflevector(a, a, 4, 5, 6, 7, 0, 1, 2, 3, 12, 13, 14, 15, 8, 9, 10, 11)
    #define TURN2(a) __builtin_shufflevector(a, a, 2, 3, 0, 1, 6, 7, 4, 5, 10, 11, 8, 9, 14, 15, 12, 13)
    #define TURN1(a) __builtin_shufflevector(a, a, 1, 0, 3, 2, 5, 4, 7, 6, 9, 8, 11, 10, 13, 12, 15, 14)
"""
    + _WEIGH_AT_ONCE
    + """
    #undef V
    #undef JOINED
    #undef ROW
    #undef ANY
    #undef SIZE_OF
    #undef NEAR_INVERSE_ROOT
    #undef TURN4
    #undef TURN2
    #undef TURN1
"""
)

# The share of the lights in the tree.
#   in:  near: sum of the root's weights, nearest; tree
_SHARE = """
    const double irradiance = near * tree.scale / nearest;
    double share = tree.far > 0.0f ? 0.0 : 1.0;
    if (tree.far > 0.0f && near > 0.0) {
        share = 1.0 / (1.0 + tree.far / irradiance);
        share = share < LEAST_SHARE ? LEAST_SHARE : share < 1.0 - LEAST_SHARE ? share : 1.0 - LEAST_SHARE;
    }
"""

# Sums and shares are in double precision: the one random number, 48 bits of it, must reach every light of a million
# with its probability, and the probability of a light must be the same walked down as walked up.
_SAMPLE = (
    """
    const float* const nodes = (const float*)tree.nodes.data;
    double probability = 1.0, place = (double)u[0] + (double)u[1] * 5.9604644775390625e-8;
    int current = 0;
    bool far = false;
    do {
        const float* const node = nodes + (size_t)current * 128;
"""
    + WEIGHTS
    + """
        double sums[9];
        sums[0] = 0.0;
        for (int k = 0; k < 8; ++k) sums[k + 1] = sums[k] + (double)weights[k];
        if (current == 0) {
            const double near = sums[8];
"""
    + _SHARE
    + """
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
        // Rounding may lead to a last child of no weight.
        while (!(weights[chosen] > 0.0f)) --chosen;
        place = (target - sums[chosen]) / (double)weights[chosen];
        probability *= (double)weights[chosen] / sums[8];
        current = ((const int*)(node + 120))[chosen];
    } while (current >= 0);
    const int light = far ? -2 : probability > 0.0 ? -1 - current : -1;
    float bits;
    memcpy(&bits, &light, 4);
    // What is left, as numbers of 24 bits.
    place = (place < BELOW_ONE ? place : BELOW_ONE) * 16777216.0;
    const int rest = (int)place, more = (int)((place - rest) * 16777216.0);
    const float digit = 5.9604644775390625e-8f;
    return wp::vec_t<4, float>(bits, AS_FLOAT(probability), rest * digit, more * digit);
"""
)

_PROBABILITY = (
    """
    const float* const nodes = (const float*)tree.nodes.data;
    int place = ((const int*)tree.places.data)[light];
    double probability = place < 0 ? 0.0 : 1.0;
    while (place >= 0) {
        const int current = place / 8, chosen = place % 8;
        const float* const node = nodes + (size_t)current * 128;
"""
    + WEIGHTS
    + """
        if (!(weights[chosen] > 0.0f)) return 0.0f;
        double sum = 0.0;
        for (int k = 0; k < 8; ++k) sum += (double)weights[k];
        probability *= (double)weights[chosen] / sum;
        place = ((const int*)tree.parents.data)[current];
        if (place < 0) {
            const double near = sum;
"""
    + _SHARE
    + """
            probability *= share;
        }
    }
    return AS_FLOAT(probability);
"""
)

_FAR = (
    """
    const float* const node = (const float*)tree.nodes.data;
"""
    + WEIGHTS
    + """
    double near = 0.0;
    for (int k = 0; k < 8; ++k) near += (double)weights[k];
"""
    + _SHARE
    + """
    return (float)(1.0 - share);
"""
)


def light_tree_code(code: str) -> str:
    """Return the body of a function of C++ with constants in the place of their names, and types before it."""
    types = """
#if VECTOR_CODE
    typedef float f8 __attribute__((ext_vector_type(8), aligned(4)));
#endif
"""
    code = (types + code).replace("VECTOR_CODE", VECTOR_CODE).replace("LEAST_SHARE", _LEAST_SHARE)
    code = code.replace(
        "AS_FLOAT(probability)", "(probability > 0.0 && probability < 1e-37 ? 1e-37f : (float)probability)"
    )
    code = code.replace("RECEIVES_ANYWHERE", str(int(RECEIVES_ANYWHERE))).replace(
        "RECEIVES_BOTH", str(int(RECEIVES_BOTH))
    )
    return code.replace("BELOW_ONE", "0.999999999999")


@wp.func_native(light_tree_code(_SAMPLE))
def _sample_tree(tree: LightTree, position: wp.vec3, normal: wp.vec3, receives: int, u: wp.vec2) -> wp.vec4: ...


@wp.func_native(light_tree_code(_PROBABILITY))
def light_tree_probability(tree: LightTree, light: int, position: wp.vec3, normal: wp.vec3, receives: int) -> float:
    """Return the probability with which `sample_light_tree` chooses a light: the walk, from the light up."""
    ...


@wp.func_native(light_tree_code(_FAR))
def far_light_probability(tree: LightTree, position: wp.vec3, normal: wp.vec3, receives: int) -> float:
    """Return the probability with which `sample_light_tree` answers FAR_LIGHT."""
    ...


@wp.func
def sample_light_tree(tree: LightTree, position: wp.vec3, normal: wp.vec3, receives: int, u: wp.vec2) -> TreeChoice:
    """Return a light for the point `position`, chosen by one random number, whose lower bits are `u[1]`.

    Args:
        tree: the lights.
        position: of the point that is lit.
        normal: unit vector; ignored where the point RECEIVES_ANYWHERE.
        receives: a RECEIVES constant.
        u: two numbers in [0, 1) of 24 bits.
    """
    found = _sample_tree(tree, position, normal, receives, u)
    choice = TreeChoice()
    choice.light = wp.cast(found[0], wp.int32)
    choice.probability = found[1]
    choice.rest = found[2]
    choice.more = found[3]
    return choice
