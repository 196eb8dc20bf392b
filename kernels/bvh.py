"""A tree of boxes eight wide, and rays through it.

A node is 56 floats: the lower x, y, z and the upper x, y, z of its eight boxes, then eight children
as integers. A child c ≥ 0 is a node, c < 0 the leaf −1 − c. A leaf is ten floats for each of its
triangles, one beside the other: x, y, z of the first, second and third corners, then their numbers.
Unused places of a node hold inverted boxes, unused triangles coincident corners; no ray hits either.
"""

import warp as wp

from wrt.kernels.simd import BOX_TEST, PUSH_CHILDREN, TRIANGLE_TEST, TRIANGLE_TEST_AFTER, with_vectors

WIDTH = 8
NODE_FLOATS = 56
LEAF_SIZE = 8
LEAF_FLOATS = 10 * LEAF_SIZE

# Seven children wait on the stack for each level above the current node; the builder refuses to
# make a tree deeper than MAX_DEPTH levels, so the stack cannot overflow.
MAX_DEPTH = 36
STACK_SIZE = 7 * MAX_DEPTH + 8


@wp.struct
class Bvh:
    """The tree; node 0 is the root."""

    nodes: wp.array(dtype=float)
    leaves: wp.array(dtype=float)


# The loop is C++: written in Python with the two tests as intrinsics it reaches 80 to 85 % of this
# (Warp clears the stack for each ray and copies it about). It comes in two pieces, which
# kernels for many rays and for instances use as well.

# What the slab test needs of a ray. Finite where a coordinate of the direction is 0: a ray in the plane of a box side
# would give 0 times infinity. Such a ray meets the boxes on both sides of the plane, hence the larger error.
#   in:  d, o: NUMBER, a coordinate of the direction and of the origin
#   out: inverse_d, shift, error: NUMBER
RAY_SLAB = """
    const NUMBER least = 1e-20f, inverse_d = 1.0f / ((SIZE(d) >= least) ? d : ((d < 0.0f) ? -least : least));
    const NUMBER shift = o * inverse_d;
    const NUMBER error = SIZE(shift) * 2.4e-7f + ((SIZE(d) >= least) ? (NUMBER)0.0f : (NUMBER)1e9f);
"""

#   in:  origin, direction: three floats
#   out: what BOX_TEST and TRIANGLE_TEST of `kernels/simd.py` need of a ray; runs, whether it can hit anything
RAY_SETUP = (
    """
#if VECTOR_CODE
    {
        const f4 d = {direction[0], direction[1], direction[2], 1.0f}, o = {origin[0], origin[1], origin[2], 0.0f};
"""
    + RAY_SLAB.replace("NUMBER", "f4")
    + """
        const i4 backwards = inverse_d < 0.0f, rows = {0, 8, 16, 0};
        *(f4*)inverse = inverse_d;
        *(f4*)near_shift = shift + error;
        *(f4*)far_shift = shift - error;
        *(i4*)near_row = rows + (backwards & 24);
        *(i4*)far_row = rows + (~backwards & 24);
        flip = 7 + backwards[0] + 2 * backwards[1] + 4 * backwards[2];
    }
#else
    flip = 7;
    for (int k = 0; k < 3; ++k) {
        const float d = direction[k], o = origin[k];
"""
    + RAY_SLAB.replace("NUMBER", "float")
    + """
        inverse[k] = inverse_d;
        near_shift[k] = shift + error;
        far_shift[k] = shift - error;
        flip ^= inverse[k] < 0.0f ? 1 << k : 0;
        near_row[k] = (inverse[k] < 0.0f ? 24 : 0) + 8 * k;
        far_row[k] = (inverse[k] < 0.0f ? 0 : 24) + 8 * k;
    }
#endif
    // The axis along which the ray runs fastest becomes z (Woop et al. 2013, section 3.1).
    const float dx = fabsf(direction[0]), dy = fabsf(direction[1]), dz = fabsf(direction[2]);
    kz = dx > dy ? (dx > dz ? 0 : 2) : (dy > dz ? 1 : 2);
    kx = kz == 2 ? 0 : kz + 1;
    ky = kx == 2 ? 0 : kx + 1;
    shear[0] = direction[kx] * inverse[kz];
    shear[1] = direction[ky] * inverse[kz];
    shear[2] = inverse[kz];
    // A ray with NaN or infinite numbers would meet all boxes, those of unused places too; times 0 they give NaN.
    const float length = dx + dy + dz;
    const bool runs = length + 0.0f * (length + near_shift[0] + near_shift[1] + near_shift[2]) > 0.0f;
"""
)


NODE_IN_PLACE = """
            const float* node = all_nodes + (size_t)current * 56;
"""


def follow_ray(visit_leaf: str, node: str = NODE_IN_PLACE) -> str:
    """Return the loop that follows one ray down a tree.

    `visit_leaf` is what it does at `current` < 0, `node` gets the boxes of the node `current`.

      in:  current, the node to start at; t_max, id_max = NOTHING_HIT; any_hit
      out: t_max, id_max, hit_u, hit_v
    """
    return (
        """
    int begins[STACK_SIZE + 8], waiting[STACK_SIZE + 8], top = 0;
    for (;;) {
        if (current >= 0) {
"""
        + node
        + """
            const int* children = (const int*)(all_nodes + (size_t)current * 56 + 48);
"""
        + BOX_TEST
        + """
"""
        + PUSH_CHILDREN
        + """
        } else {
"""
        + visit_leaf
        + """
            if (any_hit && id_max != NOTHING_HIT) break;
        }
        // The nearest waiting child that is still within reach.
        for (;;) {
            if (top == 0) goto done;
            --top;
            float begins_at;
            memcpy(&begins_at, &begins[top], 4);
            if (begins_at <= t_max * pad) {
                current = waiting[top];
                break;
            }
        }
    }
done:;
"""
    )


_FIND_LEAF = "const float* leaf = all_leaves + (size_t)(-1 - current) * (10 * LEAF_SIZE);"
FOLLOW_RAY = follow_ray(_FIND_LEAF + TRIANGLE_TEST)

_ONE_RAY = (
    """
    const float* const all_nodes = (const float*)bvh.nodes.data;
    const float* const all_leaves = (const float*)bvh.leaves.data;
    const float pad = BOX_PAD;
    float inverse[4], near_shift[4], far_shift[4], shear[3];
    int near_row[4], far_row[4], kx, ky, kz, flip;
"""
    + RAY_SETUP
    + """
    float hit_u = 0.0f, hit_v = 0.0f;
    int id_max = NOTHING_HIT, current = 0;
    if (runs) {
        FOLLOW_THE_RAY
    }
    const int triangle = id_max == NOTHING_HIT ? -1 : id_max;
    float as_float;
    memcpy(&as_float, &triangle, 4);
    return wp::vec_t<4, float>(as_float, t_max, hit_u, hit_v);
"""
)


def native_code(code: str) -> str:
    """Return C++ with this file's constants and the vector types filled in."""
    code = code.replace("STACK_SIZE", str(STACK_SIZE)).replace("NOTHING_HIT", "0x7fffffff")
    return with_vectors(code.replace("BOX_PAD", "1.00002f"), LEAF_SIZE)


_TRAVERSE = _ONE_RAY.replace("FOLLOW_THE_RAY", FOLLOW_RAY)


@wp.func_native(native_code(_TRAVERSE))
def _traverse(bvh: Bvh, origin: wp.vec3, direction: wp.vec3, t_min: float, t_max: float, any_hit: bool) -> wp.vec4: ...


@wp.func_native(
    native_code(
        "const bool any_hit = false;" + _ONE_RAY.replace("FOLLOW_THE_RAY", follow_ray(_FIND_LEAF + TRIANGLE_TEST_AFTER))
    )
)
def _traverse_after(
    bvh: Bvh, origin: wp.vec3, direction: wp.vec3, t_min: float, t_max: float, id_min: int
) -> wp.vec4: ...


@wp.struct
class Hit:
    """Where a ray meets triangle (v0, v1, v2): at (1 − u − v) v0 + u v1 + v v2, after distance t.

    `triangle` is −1 where nothing is hit; t is then what the ray could have reached. `instance` is where the triangle
    stands, in scenes with instances.
    """

    triangle: int
    instance: int
    t: float
    u: float
    v: float


@wp.func
def _hit(found: wp.vec4) -> Hit:
    hit = Hit()
    hit.triangle = wp.cast(found[0], wp.int32)
    hit.t = found[1]
    hit.u = found[2]
    hit.v = found[3]
    return hit


@wp.func
def bvh_hit(bvh: Bvh, origin: wp.vec3, direction: wp.vec3, t_min: float, t_max: float, any_hit: bool) -> Hit:
    """Return the nearest hit with t in [t_min, t_max], among equals the lowest triangle number; or some hit.

    t_min must not be negative; a `direction` of any length but zero will do, t is in its units.
    """
    return _hit(_traverse(bvh, origin, direction, t_min, t_max, any_hit))


@wp.func
def bvh_closest_hit(bvh: Bvh, origin: wp.vec3, direction: wp.vec3, t_min: float, t_max: float) -> Hit:
    """Return the nearest hit with t in [t_min, t_max]; among equals the lowest triangle number."""
    return bvh_hit(bvh, origin, direction, t_min, t_max, False)


@wp.func
def bvh_next_hit(bvh: Bvh, origin: wp.vec3, direction: wp.vec3, last: Hit, t_max: float) -> Hit:
    """Return the hit that follows `last` up to t_max, which is farther away, or as far and of a higher number.

    So the surfaces that a ray meets are found one by one, those that lie in the same place too.
    """
    return _hit(_traverse_after(bvh, origin, direction, last.t, t_max, last.triangle))


@wp.func
def bvh_any_hit(bvh: Bvh, origin: wp.vec3, direction: wp.vec3, t_min: float, t_max: float) -> bool:
    """Return whether there is a hit with t in [t_min, t_max]."""
    found = _traverse(bvh, origin, direction, t_min, t_max, True)
    return wp.cast(found[0], wp.int32) >= 0
