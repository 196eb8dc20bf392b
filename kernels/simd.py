"""The tests of eight boxes and of eight triangles at once: vector code on the CPU, loops on CUDA.

Each piece of C++ is written twice, for clang's vector types and as a plain loop; both compute the
same. They are joined to the traversal in `kernels/bvh.py`.
"""

import warp as wp

vec8 = wp.types.vector(length=8, dtype=float)

# Where both branches begin: one test decides between vectors and loops.
VECTOR_CODE = "defined(__clang__) && !defined(__CUDA_ARCH__)"

# Slab test (Kay and Kajiya 1986) as t = b · (1/d) − o · (1/d). The product o · (1/d) is rounded, so
# `near_shift` and `far_shift` hold it moved outwards by that error; the factor `pad` covers the
# rounding of the two t themselves (after Ize 2013). It is larger than that takes, so that of triangles
# at one distance all are seen: rounding may put the t of a large triangle a little before its box.
#   in:  node, t_max; inverse, near_shift, far_shift: float[3]; near_row, far_row: int[3]
#   out: begin: float[8], mask: unsigned, bit k set where box k is hit
BOX_TEST = """
#if VECTOR_CODE
    const f8 near_x = LESS(LOAD8(node + near_row[0]), inverse[0], near_shift[0]);
    const f8 near_y = LESS(LOAD8(node + near_row[1]), inverse[1], near_shift[1]);
    const f8 near_z = LESS(LOAD8(node + near_row[2]), inverse[2], near_shift[2]);
    const f8 far_x = LESS(LOAD8(node + far_row[0]), inverse[0], far_shift[0]);
    const f8 far_y = LESS(LOAD8(node + far_row[1]), inverse[1], far_shift[1]);
    const f8 far_z = LESS(LOAD8(node + far_row[2]), inverse[2], far_shift[2]);
    const f8 tn = MOST(MOST(near_x, near_y), MOST(near_z, (f8)t_min));
    const f8 tf = LEAST(LEAST(far_x, far_y), LEAST(far_z, (f8)t_max)) * pad;
    const unsigned mask = __builtin_bit_cast(unsigned char, __builtin_convertvector(tn <= tf, b8));
    alignas(32) float begin[8];
    *(f8*)begin = tn;
#else
    unsigned mask = 0;
    float begin[8];
    for (int k = 0; k < 8; ++k) {
        begin[k] = fmaxf(fmaxf(node[near_row[0] + k] * inverse[0] - near_shift[0],
                               node[near_row[1] + k] * inverse[1] - near_shift[1]),
                         fmaxf(node[near_row[2] + k] * inverse[2] - near_shift[2], t_min));
        const float end = fminf(fminf(node[far_row[0] + k] * inverse[0] - far_shift[0],
                                      node[far_row[1] + k] * inverse[1] - far_shift[1]),
                                fminf(node[far_row[2] + k] * inverse[2] - far_shift[2], t_max)) * pad;
        mask |= (unsigned)(begin[k] <= end) << k;
    }
#endif
"""

# Put the children that the ray meets on its stack, the one it comes to first on top. The builder lays
# the children of a node out by octant (Ylitie et al. 2017, section 3.2): place p is towards the corner
# of the node that the bits of p name. So the order in which a ray comes to them is known from the signs
# of its direction, near enough, and nothing is sorted: `flip` turns places into that order, and what the
# ray misses is left out. Without the instruction for that, they are sorted by distance.
#   in:  what BOX_TEST leaves; children: int[8]; flip; begins, waiting: int[], top
#   out: begins, waiting, top; a begin is a float's bits, whose order is that of the distances (floats
#        that are not negative sort like their bits)
PUSH_CHILDREN = """
#if defined(__AVX2__) && VECTOR_CODE
    {
        const i8 order = (i8){0, 1, 2, 3, 4, 5, 6, 7} ^ flip;
        const i8 begins_in_order = PERMUTE(__builtin_bit_cast(i8, tn), order);
        const i8 ends_in_order = PERMUTE(__builtin_bit_cast(i8, tf), order);
        const i8 children_in_order = PERMUTE(*(const i8*)children, order);
        const unsigned char met = __builtin_bit_cast(unsigned char, __builtin_convertvector(
            __builtin_bit_cast(f8, begins_in_order) <= __builtin_bit_cast(f8, ends_in_order), b8));
        *(i8*)(begins + top) = COMPRESS(begins_in_order, met);
        *(i8*)(waiting + top) = COMPRESS(children_in_order, met);
        top += __builtin_popcount(met);
    }
#else
    {
        const int bottom = top;
        for (unsigned rest = mask; rest; rest &= rest - 1) {
            const int k = LOWEST_BIT(rest);
            int bits;
            memcpy(&bits, &begin[k], 4);
            int place = top++;
            for (; place > bottom && begins[place - 1] < bits; --place) {
                begins[place] = begins[place - 1];
                waiting[place] = waiting[place - 1];
            }
            begins[place] = bits;
            waiting[place] = children[k];
        }
    }
#endif
"""

# Woop, Benthin and Wald (2013). Every vertex is moved and sheared by arithmetic of its own, so
# triangles that share an edge see the same numbers; and products of the edge functions are rounded before they
# are subtracted (MUL is never contracted), so the sign of an edge function may vanish but is never
# wrong. A vanishing one counts as inside on both sides: nothing slips between two triangles.
#   in:  CORNER(vertex, axis), origin, shear: vectors or numbers; kx, ky, kz
#   out of the first part: u, v, w: VECTOR; inside: INTEGERS, 0 where the line misses the triangle
#   out of the second: t, inverse_det: VECTOR; meets: INTEGERS, not 0 where the line meets it
WOOP_EDGES = """
    const VECTOR az = CORNER(0, kz) - origin[kz], bz = CORNER(1, kz) - origin[kz], cz = CORNER(2, kz) - origin[kz];
    const VECTOR ax = MINUS(CORNER(0, kx) - origin[kx], shear[0], az);
    const VECTOR ay = MINUS(CORNER(0, ky) - origin[ky], shear[1], az);
    const VECTOR bx = MINUS(CORNER(1, kx) - origin[kx], shear[0], bz);
    const VECTOR by = MINUS(CORNER(1, ky) - origin[ky], shear[1], bz);
    const VECTOR cx = MINUS(CORNER(2, kx) - origin[kx], shear[0], cz);
    const VECTOR cy = MINUS(CORNER(2, ky) - origin[ky], shear[1], cz);
    const VECTOR u = MUL(cx, by) - MUL(cy, bx), v = MUL(ax, cy) - MUL(ay, cx), w = MUL(bx, ay) - MUL(by, ax);
    const INTEGERS inside = (LEAST(LEAST(u, v), w) >= 0.0f) | (MOST(MOST(u, v), w) <= 0.0f);
"""
WOOP_DISTANCE = """
    const VECTOR det = (u + v) + w;
    const INTEGERS meets = inside & (SIZE(det) > 1e-28f);
    const VECTOR inverse_det = 1.0f / det;
    const VECTOR t = MUL(MUL((MUL(u, az) + MUL(v, bz)) + MUL(w, cz), shear[2]), inverse_det);
"""
WOOP_TEST = WOOP_EDGES + WOOP_DISTANCE

# A bound on the error of t: a nearer hit cannot be told from the surface that the ray leaves, and a ray that
# leaves a needle would hit that needle. The error of the edge functions is that of Pharr, Jakob and Humphreys
# ("Physically Based Rendering", 3rd edition, section 3.9.6; gamma(n) = n eps / (1 - n eps) with eps = 2^-24).
# Theirs of t also grows with the distance from a thin triangle, and would hide needles far away. But t is a
# mean of the corners' z: errors of its weights count only as far as those are apart, and not at all where
# the whole triangle lies before the ray. The first term is gamma(18) most_z, for all other roundings.
#   in:  what WOOP_TEST leaves
#   out: clear: INTEGERS, not 0 where t is greater than its error
WOOP_ERROR = """
    const VECTOR most_x = MOST(MOST(SIZE(ax), SIZE(bx)), SIZE(cx)), most_y = MOST(MOST(SIZE(ay), SIZE(by)), SIZE(cy));
    const VECTOR most_z = MOST(MOST(SIZE(az), SIZE(bz)), SIZE(cz));
    const VECTOR error_x = 2.9802325e-7f * (most_x + most_z), error_y = 2.9802325e-7f * (most_y + most_z);
    const VECTOR error_e = 2.0f * (1.1920930e-7f * most_x * most_y + error_y * most_x + error_x * most_y);
    const VECTOR spread = MOST(MOST(az, bz), cz) - LEAST(LEAST(az, bz), cz), error_z = 1.0728836e-6f * most_z;
    const VECTOR error_t = SIZE(shear[2]) * (error_z + 3.0f * spread * (error_e * SIZE(inverse_det)));
    const INTEGERS clear = (t > error_t) | ((most_z - spread > error_z) & (t > 0.0f));
"""

# A leaf's triangles, all at once.
#   in:  leaf, t_min, t_max, id_max; origin, shear: float[3]; kx, ky, kz
#   out: t_max, hit_u, hit_v, id_max of the nearest hit so far; of equal t the lowest id wins
_TRIANGLE_TEST = (
    """
    float ts[LEAF_SIZE], us[LEAF_SIZE], vs[LEAF_SIZE];
    unsigned hits = 0;
    const int* ids = (const int*)(leaf + 9 * LEAF_SIZE);
#if VECTOR_CODE
    {
    #pragma clang fp contract(off)
    #define VECTOR fL
    #define INTEGERS iL
    #define CORNER(vertex, axis) (*(const fL*)(leaf + 3 * LEAF_SIZE * (vertex) + LEAF_SIZE * (axis)))
"""
    + WOOP_TEST
    + """
    const iL hit = meets & (t >= t_min) & (t <= t_max);
    hits = LEAF_MASK(hit);
    if (hits) {
"""
    + WOOP_ERROR
    + """
        hits &= LEAF_MASK(clear);
        const fL tu = v * inverse_det, tv = w * inverse_det;
        __builtin_memcpy(ts, &t, sizeof ts);
        __builtin_memcpy(us, &tu, sizeof us);
        __builtin_memcpy(vs, &tv, sizeof vs);
    }
    #undef CORNER
    #undef VECTOR
    #undef INTEGERS
    }
#else
    for (int k = 0; k < LEAF_SIZE; ++k) {
        #define VECTOR float
        #define INTEGERS int
        #define CORNER(vertex, axis) leaf[3 * LEAF_SIZE * (vertex) + LEAF_SIZE * (axis) + k]
"""
    + WOOP_TEST
    + """
        if (!(meets & (t >= t_min) & (t <= t_max))) continue;
"""
    + WOOP_ERROR
    + """
        #undef CORNER
        #undef VECTOR
        #undef INTEGERS
        ts[k] = t;
        us[k] = v * inverse_det;
        vs[k] = w * inverse_det;
        hits |= (unsigned)(clear != 0) << k;
    }
#endif
    for (; hits; hits &= hits - 1) {
        const int k = LOWEST_BIT(hits);
        SKIPPED
        if (ts[k] < t_max || (ts[k] == t_max && ids[k] < id_max)) {
            t_max = ts[k];
            hit_u = us[k];
            hit_v = vs[k];
            id_max = ids[k];
        }
    }
"""
)
TRIANGLE_TEST = _TRIANGLE_TEST.replace("SKIPPED", "")

# The same, without the hits that come before (t_min, id_min) or are it, in the order of distance, then number.
TRIANGLE_TEST_AFTER = _TRIANGLE_TEST.replace("SKIPPED", "if (ts[k] == t_min && ids[k] <= id_min) continue;")

# A leaf's triangles, one after the other, against several rays at once. First which of them the line of any ray
# meets, without a guess at each; then these up to their ends, though their edges are computed once more.
#   in:  leaf; ids: int*; t_min; within: INTEGERS, not 0 for rays that come to the leaf; VECTOR, INTEGERS;
#        CORNER(vertex, axis) of triangle j; ANY(INTEGERS); origin, shear; kx, ky, kz
#   out: best, best_u, best_v: VECTOR, best_id: INTEGERS, the nearest hits so far; of equal t the lowest id wins
LEAF_TOGETHER = (
    """
    unsigned some = 0;
    _Pragma("clang loop unroll(disable)") for (int j = 0; j < LEAF_SIZE; ++j) {
        #pragma clang fp contract(off)
        if (j > 0 && ids[j] == ids[j - 1]) continue;  // unused, or another piece of it
"""
    + WOOP_EDGES
    + """
        some |= (unsigned)ANY(inside & within) << j;
    }
    for (; some; some &= some - 1) {
        #pragma clang fp contract(off)
        const int j = LOWEST_BIT(some);
"""
    + WOOP_EDGES
    + WOOP_DISTANCE
    + WOOP_ERROR
    + """
        const INTEGERS nearer = meets & (t >= t_min) & ((t < best) | ((t == best) & (ids[j] < best_id))) & within;
        const INTEGERS better = nearer & clear;
        best = better ? t : best;
        best_u = better ? v * inverse_det : best_u;
        best_v = better ? w * inverse_det : best_v;
        best_id = better ? (INTEGERS)ids[j] : best_id;
    }
"""
)

# Have a node or a leaf brought nearer, for a visit that is not yet. A leaf is of five cache lines, a node of four.
#   in:  all_nodes, all_leaves
PREFETCH = """
    const auto prefetch = [&](int item, int lines = 5) {
#if VECTOR_CODE
        const char* place = item >= 0 ? (const char*)(all_nodes + (size_t)item * 56)
                                      : (const char*)(all_leaves + (size_t)(-1 - item) * (10 * LEAF_SIZE));
        for (int line = 0; line < lines; ++line) __builtin_prefetch(place + 64 * line);
#endif
    };
"""

VECTOR_TYPES = """
#if VECTOR_CODE
    typedef float f8 __attribute__((ext_vector_type(8), aligned(4)));
    typedef bool b8 __attribute__((ext_vector_type(8)));
    typedef int i8 __attribute__((ext_vector_type(8), aligned(4)));
    typedef float f4 __attribute__((ext_vector_type(4), aligned(4)));
    typedef int i4 __attribute__((ext_vector_type(4), aligned(4)));
#endif
"""

_PRELUDE = (
    VECTOR_TYPES
    + """
#if VECTOR_CODE
    typedef float fL __attribute__((ext_vector_type(LEAF_SIZE), aligned(4)));
    typedef int iL __attribute__((ext_vector_type(LEAF_SIZE)));
    #define LOAD8(p) (*(const f8*)(p))
    #define LOWEST_BIT(m) __builtin_ctz(m)
    #define MUL(a, b) ((a) * (b))
    // a * b - c and a - b * c, rounded once where that is one instruction.
#if defined(__FMA__)
    #define LESS(a, b, c) __builtin_elementwise_fma(a, (decltype(a))(b), -(decltype(a))(c))
    #define MINUS(a, b, c) __builtin_elementwise_fma(-(VECTOR)(b), c, a)
#else
    #define LESS(a, b, c) ((a) * (b) - (c))
    #define MINUS(a, b, c) ((a) - (b) * (c))
#endif
    // One instruction each; clang's own functions take three, to ignore NaN, of which there is none that counts.
    #define LEAST(a, b) least_of(a, b)
    #define MOST(a, b) most_of(a, b)
    const auto least_of = [](auto a, auto b) { return a < b ? a : b; };
    const auto most_of = [](auto a, auto b) { return a > b ? a : b; };
    #define SIZE(a) __builtin_elementwise_abs(a)
    #define PERMUTE(a, places) __builtin_ia32_permvarsi256(a, places)
#if defined(__AVX512VL__)
    // The elements of which bits are set in m, one after the other.
    #define COMPRESS(a, m) __builtin_ia32_compresssi256_mask(a, (i8)0, m)
#else
    typedef unsigned char u8 __attribute__((ext_vector_type(8), aligned(1)));
    static const unsigned char set_bits[2048] = {SET_BITS};
    #define COMPRESS(a, m) PERMUTE(a, __builtin_convertvector(*(const u8*)(set_bits + 8 * (m)), i8))
#endif
#if LEAF_SIZE == 8
    #define LEAF_MASK(m) __builtin_bit_cast(unsigned char, __builtin_convertvector(m, b8))
#else
    typedef bool b4 __attribute__((ext_vector_type(4)));
    #define LEAF_MASK(m) __builtin_bit_cast(unsigned char, __builtin_convertvector( \\
        __builtin_shufflevector((iL)(m), (iL)0, 0, 1, 2, 3, 4, 5, 6, 7), b8))
#endif
#else
    #define LOWEST_BIT(m) (__ffs(m) - 1)
    #define MUL(a, b) __fmul_rn(a, b)
    #define MINUS(a, b, c) fmaf(-(b), c, a)
    #define LEAST(a, b) fminf(a, b)
    #define MOST(a, b) fmaxf(a, b)
    #define SIZE(a) fabsf(a)
#endif
"""
)

_POSTLUDE = """
#undef LOAD8
#undef LOWEST_BIT
#undef LEAF_MASK
#undef MUL
#undef LESS
#undef MINUS
#undef LEAST
#undef MOST
#undef SIZE
#undef PERMUTE
#undef COMPRESS
"""


def _set_bits() -> str:
    """Return for each number of eight bits the places of those that are set, padded to eight by zeros."""
    rows = [[k for k in range(8) if m >> k & 1] for m in range(256)]
    return ", ".join(str(place) for row in rows for place in row + [0] * (8 - len(row)))


def with_vectors(code: str, leaf_size: int) -> str:
    """Return a body of C++ with the vector types and macros of this file around it."""
    code = (_PRELUDE + code + _POSTLUDE).replace("SET_BITS", _set_bits())
    return code.replace("VECTOR_CODE", VECTOR_CODE).replace("LEAF_SIZE", str(leaf_size))
