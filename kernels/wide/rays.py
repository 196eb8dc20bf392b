"""Sixteen rays through the ray tree, as paths that go on side by side have them.

All go down the tree together first, the way `kernels/packets.py` does: each box is tested against all rays, and each
triangle. Rays of one octant and one main axis share which sides of a box are near; the others choose for themselves,
which costs twice the instructions and is still less than going alone where most of them come along, as at the root.
Where few are left, the node is put on a list with the bits of these rays; from what has their bits they go on alone,
some in turn (`kernels/interleaved.py`), those of many groups if they are given together. The answers are those of
`kernels/bvh.py`, bit for bit.
"""

from wrt.kernels.bvh import RAY_SLAB, STACK_SIZE, native_code
from wrt.kernels.simd import BOX_TEST, LEAF_TOGETHER, PREFETCH, PUSH_CHILDREN, TRIANGLE_TEST

# Measured: the rays that are followed in turn; those left of rays of one octant, and of others, at which they part;
# rays at all for which going together is worth it. What is read of a large tree, with leaves of 8 MB and more, is in no
# cache: it takes several hundred cycles, in which more rays have their turns.
IN_TURN, IN_TURN_IF_LARGE = 8, 24
LONE_RAYS, LONE_MIXED_RAYS = 4, 8
FEW_RAYS, FEW_RAYS_IF_LARGE = 6, 8
LARGE_TREE = 1 << 21  # numbers in its leaves

_TYPES = """
namespace lanes {
LANES_INLINE unsigned bits(i16 m) { return __builtin_bit_cast(unsigned short, __builtin_convertvector(m, b16)); }

// What the tests of `kernels/simd.py` need of sixteen rays, and what they have met.
struct alignas(64) Rays {
    float origins[3][16], shears[3][16];  // in the order of the triangle test, the main axis last
    float inverses[3][16], near_shifts[3][16], far_shifts[3][16];
    int near_rows[3][16], far_rows[3][16], kxs[16], kys[16], kzs[16], flips[16];
    float reach[16], hit_us[16], hit_vs[16];  // a ray that is done reaches nothing
    int numbers[16];
};
// Nodes at which some rays part from their group, to go on alone from there. Where there are more, a group's lone rays
// go on without those of others, fewer in turn.
constexpr int MOST_PARTINGS = 64;  // as many as `Lone::left` has bits
struct alignas(64) Partings {
    float begins[MOST_PARTINGS][16];  // of all rays
    unsigned rays[MOST_PARTINGS];     // bits of those that part
    int nodes[MOST_PARTINGS], count;
    unsigned some;  // bits of rays that part anywhere
};
// A group of rays on their way.
struct Journeys {
    Rays rays;
    Partings partings;
};
struct Lone {
    float t_max, hit_u, hit_v;
    int id_max, current, top, number;
    unsigned long long left;  // bits of the partings that it has not gone on from
    Journeys* group;
    int begins[STACK_SIZE + 8], waiting[STACK_SIZE + 8];
};
} // namespace lanes
""".replace("STACK_SIZE", str(STACK_SIZE))


def _of_origin_in_order(code: str) -> str:
    """Return a triangle test whose `origin` has the main axis last."""
    for place, axis in enumerate(("kx", "ky", "kz")):
        code = code.replace(f"origin[{axis}]", f"origin[{place}]")
    return code


_FOLLOW_ALONE = (
    """
static bool is_large(const TREE_TYPE& bvh) { return bvh.leaves.shape[0] > LARGE_TREE; }

template<bool any_hit>
LANES_CALLED void follow_alone(const TREE_TYPE& bvh, lanes::Journeys* next, const int count, const float t_min) {
    using lanes::i16;
    const lanes::Journeys* const end = next + count;
    const float* const all_nodes = (const float*)bvh.nodes.data;
    const float* const all_leaves = (const float*)bvh.leaves.data;
    const float pad = BOX_PAD;
    const auto next_parting = [&](lanes::Lone& r) -> bool {
        const float limit = r.t_max * pad;
        if (limit < 0.0f) return false;
        const lanes::Partings& partings = r.group->partings;
        for (; r.left; r.left &= r.left - 1) {
            const int k = __builtin_ctzll(r.left);
            if (partings.begins[k][r.number] > limit) continue;
            r.current = partings.nodes[k];
            r.left &= r.left - 1;
            return true;
        }
        return false;
    };
    const auto start = [&](lanes::Lone& r) {
        r.number = -1;
        for (; next < end; ++next) {
            lanes::Rays& a = next->rays;
            lanes::Partings& partings = next->partings;
            r.group = next;
            for (; partings.some; partings.some &= partings.some - 1) {
                const int n = r.number = __builtin_ctz(partings.some);
                r.t_max = a.reach[n];
                r.hit_u = a.hit_us[n];
                r.hit_v = a.hit_vs[n];
                r.id_max = a.numbers[n];
                r.top = 0;
                const i16 own = (i16)(1 << n);
                r.left = 0;
                LANES_UNROLL for (int first = 0; first < lanes::MOST_PARTINGS; first += 16) {
                    const i16 parts = (*(const i16*)(partings.rays + first) & own) != 0;
                    r.left |= (unsigned long long)lanes::bits(parts) << first;
                }
                r.left &= ~0ull >> (64 - partings.count);
                if (next_parting(r)) {
                    partings.some &= partings.some - 1;
                    return;
                }
                r.number = -1;
            }
        }
    };
    const bool large = is_large(bvh);
    const int in_turn = large ? IN_TURN_IF_LARGE : IN_TURN;
    lanes::Lone rays[IN_TURN_IF_LARGE];
"""
    + PREFETCH
    + """
    // Those at nodes and those at leaves, so that nothing has to guess which a ray is at.
    int at[2][IN_TURN_IF_LARGE + 1], counts[2] = {0, 0};
    const auto wait = [&](const int i) __attribute__((always_inline)) {
        const int current = rays[i].current, is_leaf = current < 0, is_live = rays[i].number >= 0;
        prefetch(current, large ? 5 : 4);
        at[0][counts[0]] = i;
        counts[0] += is_live & !is_leaf;
        at[1][counts[1]] = i;
        counts[1] += is_live & is_leaf;
    };
    const auto go_on = [&](const int i) __attribute__((always_inline)) {
        lanes::Lone& r = rays[i];
        const float limit = r.t_max * pad;
        int limit_bits;
        memcpy(&limit_bits, &limit, 4);
        for (;;) {
            if (r.top > 0) {
                --r.top;
                if (r.begins[r.top] > limit_bits) continue;
                r.current = r.waiting[r.top];
            } else if (!next_parting(r)) {
                lanes::Rays& a = r.group->rays;
                const int n = r.number;
                a.reach[n] = r.t_max;
                a.hit_us[n] = r.hit_u;
                a.hit_vs[n] = r.hit_v;
                a.numbers[n] = r.id_max;
                start(r);
            }
            break;
        }
        wait(i);
    };
    for (int i = 0; i < in_turn; ++i) {
        rays[i].current = 0;
        start(rays[i]);
        wait(i);
    }
    #define OF_RAY(rows) {a.rows[0][n], a.rows[1][n], a.rows[2][n]}
    const auto step_each = [&](const int kind, const auto step) __attribute__((always_inline)) {
        const int count = counts[kind];
        counts[kind] = 0;
        _Pragma("clang loop unroll(disable)") for (int p = 0; p < count; ++p) {
            const int i = at[kind][p];
            step(rays[i], rays[i].group->rays, rays[i].number);
            go_on(i);
        }
    };
    while (counts[0] + counts[1] > 0) {
        step_each(0, [&](lanes::Lone& r, const lanes::Rays& a, const int n) __attribute__((always_inline)) {
            const float t_max = r.t_max;
            int& top = r.top;
            int *const begins = r.begins, *const waiting = r.waiting;
            const float inverse[3] = OF_RAY(inverses), near_shift[3] = OF_RAY(near_shifts);
            const float far_shift[3] = OF_RAY(far_shifts);
            const int near_row[3] = OF_RAY(near_rows), far_row[3] = OF_RAY(far_rows), flip = a.flips[n];
            const float* node = all_nodes + (size_t)r.current * 56;
            const int* children = (const int*)(node + 48);
"""
    + BOX_TEST
    + PUSH_CHILDREN
    + """
        });
        step_each(1, [&](lanes::Lone& r, const lanes::Rays& a, const int n) __attribute__((always_inline)) {
            float &t_max = r.t_max, &hit_u = r.hit_u, &hit_v = r.hit_v;
            int& id_max = r.id_max;
            const float origin[3] = OF_RAY(origins), shear[3] = OF_RAY(shears);
            const int kx = a.kxs[n], ky = a.kys[n], kz = a.kzs[n];
            const float* leaf = all_leaves + (size_t)(-1 - r.current) * (10 * LEAF_SIZE);
"""
    + _of_origin_in_order(TRIANGLE_TEST)
    + """
            if (any_hit && id_max != NOTHING_HIT) {
                r.top = 0;
                t_max = -1.0f;
            }
        });
    }
    #undef OF_RAY
}
"""
)

_FOLLOW_TOGETHER = (
    """
// Of rays of one octant, or of any (`octants`); of one main axis, or of any (`axes`).
template<bool any_hit, bool octants, bool axes>
LANES_CALLED void follow_together(const TREE_TYPE& bvh, lanes::Journeys& journeys, const float t_min) {
    lanes::Rays& a = journeys.rays;
    lanes::Partings& partings = journeys.partings;
    using lanes::f16; using lanes::i16; using lanes::b16;
    #define ROW(numbers) (*(f16*)a.numbers)
    #define INTEGER_ROW(numbers) (*(i16*)a.numbers)
    const float* const all_nodes = (const float*)bvh.nodes.data;
    const float* const all_leaves = (const float*)bvh.leaves.data;
    const float pad = BOX_PAD;
    constexpr int lone_rays = octants ? LONE_MIXED_RAYS : LONE_RAYS;
    alignas(64) float begins[STACK_SIZE][16];
    int waiting[STACK_SIZE], top = 1;
    waiting[0] = 0;
    *(f16*)begins[0] = (f16)t_min;
    const int one = __builtin_ctz(lanes::bits(ROW(reach) >= t_min) | 0x8000), flip = a.flips[one];
    const int near_row[3] = {a.near_rows[0][one], a.near_rows[1][one], a.near_rows[2][one]};
    const int far_row[3] = {a.far_rows[0][one], a.far_rows[1][one], a.far_rows[2][one]};
    b16 back[3];
    for (int k = 0; k < 3; ++k) back[k] = __builtin_convertvector(ROW(inverses[k]) < 0.0f, b16);
    while (top > 0) {
        --top;
        const int current = waiting[top];
        const f16 limit = ROW(reach);
        const i16 within = *(const f16*)begins[top] <= limit * pad;
        const unsigned rays = lanes::bits(within);
        if (__builtin_popcount(rays) <= lone_rays) {
            // Where no rays are left as well, so that one thing less is to be guessed.
            const int k = partings.count;
            *(f16*)partings.begins[k] = *(const f16*)begins[top];
            partings.nodes[k] = current;
            partings.rays[k] = rays;
            partings.some |= rays;
            partings.count = k + (rays != 0);
            if (partings.count == lanes::MOST_PARTINGS) {
                follow_alone<any_hit>(bvh, &journeys, 1, t_min);
                partings.count = 0;
            }
            continue;
        }
        if (current < 0) {
            const float* leaf = all_leaves + (size_t)(-1 - current) * (10 * LEAF_SIZE);
            const int* ids = (const int*)(leaf + 9 * LEAF_SIZE);
            // The axes of rays of any main axis are put in the order of the test.
            const i16 main_axis = INTEGER_ROW(kzs);
            const b16 is_x = __builtin_convertvector(main_axis == 0, b16);
            const b16 is_y = __builtin_convertvector(main_axis == 1, b16);
            const int kx = axes ? 0 : a.kxs[one], ky = axes ? 1 : a.kys[one], kz = axes ? 2 : a.kzs[one];
            const auto in_order = [&](int axis, f16 x, f16 y, f16 z) __attribute__((always_inline)) -> f16 {
                return axis == 0 ? (is_x ? y : (is_y ? z : x)) : axis == 1 ? (is_x ? z : (is_y ? x : y))
                                                               : (is_x ? x : (is_y ? y : z));
            };
            f16 origin[3], shear[3];
            for (int k = 0; k < 3; ++k) origin[k] = ROW(origins[k]), shear[k] = ROW(shears[k]);
            f16 best = limit, best_u = ROW(hit_us), best_v = ROW(hit_vs);
            i16 best_id = INTEGER_ROW(numbers);
            const auto corner = [&](int j, int vertex, int axis) __attribute__((always_inline)) -> f16 {
                const float* c = leaf + 3 * LEAF_SIZE * vertex + j;
                if (!axes) return (f16)c[LEAF_SIZE * axis];
                return in_order(axis, (f16)c[0], (f16)c[LEAF_SIZE], (f16)c[2 * LEAF_SIZE]);
            };
            #define VECTOR f16
            #define INTEGERS i16
            #define CORNER(vertex, axis) corner(j, vertex, axis)
            #define ANY(c) (lanes::bits(c) != 0)
"""
    + _of_origin_in_order(LEAF_TOGETHER)
    + """
            #undef ANY
            #undef CORNER
            #undef VECTOR
            #undef INTEGERS
            if (any_hit) best = best_id != NOTHING_HIT ? (f16)-1.0f : best;
            ROW(reach) = best;
            ROW(hit_us) = best_u;
            ROW(hit_vs) = best_v;
            INTEGER_ROW(numbers) = best_id;
            continue;
        }
        const float* node = all_nodes + (size_t)current * 56;
        const int* children = (const int*)(node + 48);
        const f16 still = within ? limit : (f16)-1.0f;
        _Pragma("clang loop unroll(disable)") for (int i = 0; i < 8; ++i) {
            const int k = i ^ flip;
            f16 nears[3], fars[3];
            for (int axis = 0; axis < 3; ++axis) {
                f16 near = (f16)node[near_row[axis] + k], far = (f16)node[far_row[axis] + k];
                if (octants) {
                    const f16 lower = (f16)node[8 * axis + k], upper = (f16)node[24 + 8 * axis + k];
                    near = back[axis] ? upper : lower;
                    far = back[axis] ? lower : upper;
                }
                nears[axis] = LESS(near, ROW(inverses[axis]), ROW(near_shifts[axis]));
                fars[axis] = LESS(far, ROW(inverses[axis]), ROW(far_shifts[axis]));
            }
            const f16 tn = MOST(MOST(nears[0], nears[1]), MOST(nears[2], (f16)t_min));
            const f16 tf = LEAST(LEAST(fars[0], fars[1]), LEAST(fars[2], still)) * pad;
            const i16 met = tn <= tf;
            *(f16*)begins[top] = met ? tn : (f16)__builtin_inff();
            waiting[top] = children[k];
            top += lanes::bits(met) != 0;
        }
    }
}
"""
)

_TRAVERSE = """
template<bool any_hit>
static void follow_any_together(
    const TREE_TYPE& bvh, lanes::Journeys& journeys, const float t_min, const bool octants, const bool axes) {
    if (octants) follow_together<any_hit, true, true>(bvh, journeys, t_min);
    else if (axes) follow_together<any_hit, false, true>(bvh, journeys, t_min);
    else follow_together<any_hit, false, false>(bvh, journeys, t_min);
}

// Go as far as the rays of `exec` go together.
LANES_CALLED void NAME_set_out(
    const TREE_TYPE& bvh, lanes::Journeys& journeys, const lanes::Vector<3, lanes::Floats>& origin_,
    const lanes::Vector<3, lanes::Floats>& direction_, const float t_min, const lanes::Floats t_max, const bool any_hit,
    const lanes::Mask exec) {
    using lanes::f16; using lanes::i16;
    lanes::Rays& a = journeys.rays;
    lanes::Partings& partings = journeys.partings;
    f16 origin[3], inverse[3], direction[3];
    i16 flip = 7;
    f16 shifts = 0.0f;
    LANES_UNROLL for (int k = 0; k < 3; ++k) {
        const f16 d = direction[k] = direction_.c[k].v, o = origin_.c[k].v;
RAY_SLAB
        const i16 backwards = inverse_d < 0.0f;
        inverse[k] = inverse_d;
        flip += backwards * (1 << k);
        shifts += shift + error;
        origin[k] = o;
        ROW(inverses[k]) = inverse_d;
        ROW(near_shifts[k]) = shift + error;
        ROW(far_shifts[k]) = shift - error;
        INTEGER_ROW(near_rows[k]) = (backwards & 24) + 8 * k;
        INTEGER_ROW(far_rows[k]) = (~backwards & 24) + 8 * k;
    }
    const f16 dx = SIZE(direction[0]), dy = SIZE(direction[1]), dz = SIZE(direction[2]), length = dx + dy + dz;
    const i16 kz = dx > dy ? (dx > dz ? (i16)0 : (i16)2) : (dy > dz ? (i16)1 : (i16)2);
    const i16 kx = kz == 2 ? (i16)0 : kz + 1, ky = kx == 2 ? (i16)0 : kx + 1;
    const auto along = [](i16 axis, const f16* v) { return axis == 0 ? v[0] : (axis == 1 ? v[1] : v[2]); };
    ROW(origins[0]) = along(kx, origin);
    ROW(origins[1]) = along(ky, origin);
    ROW(origins[2]) = along(kz, origin);
    const f16 inverse_z = along(kz, inverse);
    ROW(shears[0]) = along(kx, direction) * inverse_z;
    ROW(shears[1]) = along(ky, direction) * inverse_z;
    ROW(shears[2]) = inverse_z;
    INTEGER_ROW(kxs) = kx;
    INTEGER_ROW(kys) = ky;
    INTEGER_ROW(kzs) = kz;
    INTEGER_ROW(flips) = flip;
    const i16 can_hit = (length + 0.0f * (length + shifts) > 0.0f) & (t_max.v >= t_min);
    const unsigned runs = lanes::bits(can_hit) & lanes::bits(exec);
    ROW(reach) = lanes::of_bits(runs).v ? t_max.v : (f16)-1.0f;
    ROW(hit_us) = ROW(hit_vs) = (f16)0.0f;
    INTEGER_ROW(numbers) = (i16)NOTHING_HIT;

    const int few = is_large(bvh) ? FEW_RAYS_IF_LARGE : FEW_RAYS;
    partings.some = partings.count = 0;
    if (__builtin_popcount(runs) < few) {
        partings.count = 1;
        partings.some = partings.rays[0] = runs;
        partings.nodes[0] = 0;
        *(f16*)partings.begins[0] = (f16)t_min;
    } else {
        const int one = __builtin_ctz(runs);
        const bool octants = lanes::bits(flip != a.flips[one]) & runs, axes = lanes::bits(kz != a.kzs[one]) & runs;
        if (any_hit) follow_any_together<true>(bvh, journeys, t_min, octants, axes);
        else follow_any_together<false>(bvh, journeys, t_min, octants, axes);
    }
}

// What rays have met that have come to their ends.
LANES_CALLED lanes::Vector<4, lanes::Floats> NAME_found(const lanes::Journeys& journeys, const lanes::Floats t_max) {
    using lanes::f16; using lanes::i16;
    const lanes::Rays& a = journeys.rays;
    const i16 number = INTEGER_ROW(numbers);
    lanes::Vector<4, lanes::Floats> found;
    found.c[0].v = __builtin_bit_cast(f16, number == NOTHING_HIT ? (i16)-1 : number);
    found.c[1].v = number == NOTHING_HIT ? t_max.v : ROW(reach);
    found.c[2].v = ROW(hit_us);
    found.c[3].v = ROW(hit_vs);
    #undef ROW
    #undef INTEGER_ROW
    return found;
}

LANES_CALLED lanes::Vector<4, lanes::Floats> NAME(
    const TREE_TYPE& bvh, const lanes::Vector<3, lanes::Floats>& origin,
    const lanes::Vector<3, lanes::Floats>& direction, lanes::Floats t_min_, lanes::Floats t_max,
    lanes::Mask any_hit_, lanes::Mask exec) {
    const int some = __builtin_ctz(lanes::bits(exec) | 0x8000);
    const float t_min = t_min_.v[some];
    const bool any_hit = lanes::lane(any_hit_, some);
    lanes::Journeys journeys;
    NAME_set_out(bvh, journeys, origin, direction, t_min, t_max, any_hit, exec);
    if (journeys.partings.some) (any_hit ? follow_alone<true> : follow_alone<false>)(bvh, &journeys, 1, t_min);
    return NAME_found(journeys, t_max);
}
"""


def _with_constants(code: str) -> str:
    of_large = ("LARGE_TREE", "IN_TURN_IF_LARGE", "FEW_RAYS_IF_LARGE")
    for name in (*of_large, "IN_TURN", "LONE_MIXED_RAYS", "LONE_RAYS", "FEW_RAYS"):
        code = code.replace(name, str(globals()[name]))
    return code.replace("RAY_SLAB", RAY_SLAB.replace("NUMBER", "f16"))


# C++ at file level: `NAME` is that of the function, `TREE_TYPE` of the tree's struct.
RAYS = _TYPES + native_code(_with_constants(_FOLLOW_ALONE + _FOLLOW_TOGETHER + _TRAVERSE))
