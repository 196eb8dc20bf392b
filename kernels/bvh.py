"""A tree of boxes eight wide, and rays through it.

A node is 56 floats: the lower x, y, z and the upper x, y, z of its eight boxes, then eight children
as integers. A child c ≥ 0 is a node, c < 0 the leaf −1 − c. A leaf is 40 floats: x, y, z of the
first, second and third corners of its four triangles, then their numbers. Unused slots of a node
hold an inverted box, unused triangles coincident corners; neither is ever hit.
"""

import warp as wp

from wrt.kernels.simd import box_distances, finite_mask, lowest_bit, nearest_triangle

NODE_FLOATS = 56
LEAF_FLOATS = 40
LEAF_SIZE = 4
WIDTH = 8

# Seven children wait on the stack for each level above the current node; the builder refuses to
# make a tree deeper than MAX_DEPTH levels.
MAX_DEPTH = 36
STACK_SIZE = 7 * MAX_DEPTH + 4
_stack_of_children = wp.types.vector(length=STACK_SIZE, dtype=int)
_stack_of_distances = wp.types.vector(length=STACK_SIZE, dtype=float)

_MIN_COMPONENT = wp.constant(1.0e-18)


@wp.struct
class Bvh:
    """The tree; node 0 is the root. `leaf_ids` is `leaves` seen as integers, `children` is `nodes`."""

    nodes: wp.array(dtype=float)
    children: wp.array(dtype=int)
    leaves: wp.array(dtype=float)
    leaf_ids: wp.array(dtype=int)


@wp.struct
class RayTest:
    """A ray prepared for boxes (`inverse`) and for triangles (`shear`, `axes`)."""

    origin: wp.vec3
    inverse: wp.vec3
    shear: wp.vec3
    axes: int


@wp.struct
class BvhHit:
    """A triangle's number (−1: none), distance, and weights of its second and third corner."""

    triangle: int
    t: float
    u: float
    v: float


@wp.func
def _safe_inverse(d: float) -> float:
    # Finite, so that a ray in the plane of a box side gives 0 and not 0 · ∞.
    return 1.0 / wp.where(wp.abs(d) < _MIN_COMPONENT, wp.where(d < 0.0, -_MIN_COMPONENT, _MIN_COMPONENT), d)


@wp.func
def prepare_ray(origin: wp.vec3, direction: wp.vec3) -> RayTest:
    """Return what the box and triangle tests need of a ray (Woop et al. 2013, section 3.1)."""
    ray = RayTest()
    ray.origin = origin
    ray.inverse = wp.vec3(_safe_inverse(direction[0]), _safe_inverse(direction[1]), _safe_inverse(direction[2]))
    a = wp.vec3(wp.abs(direction[0]), wp.abs(direction[1]), wp.abs(direction[2]))
    kz = int(2)
    if a[0] > a[1] and a[0] > a[2]:
        kz = 0
    elif a[1] > a[2]:
        kz = 1
    kx = (kz + 1) % 3
    ky = (kz + 2) % 3
    inverse_z = 1.0 / direction[kz]
    ray.shear = wp.vec3(direction[kx] * inverse_z, direction[ky] * inverse_z, inverse_z)
    ray.axes = kx | (ky << 2) | (kz << 4)
    return ray


@wp.func
def traverse(bvh: Bvh, ray: RayTest, t_min: float, t_max: float, any_hit: bool) -> BvhHit:
    """Return the nearest hit with t in [t_min, t_max], or with `any_hit` the first one found."""
    hit = BvhHit()
    hit.triangle = -1
    hit.t = t_max
    stack = _stack_of_children()
    distances = _stack_of_distances()
    top = int(0)
    current = int(0)
    while True:
        if current >= 0:
            # Push the children that the ray meets, the farthest first.
            t = box_distances(bvh.nodes, current, ray.origin, ray.inverse, hit.t)
            mask = finite_mask(t)
            bottom = top
            while mask != 0:
                k = lowest_bit(mask)
                mask = mask & (mask - 1)
                slot = top
                while slot > bottom and distances[slot - 1] < t[k]:
                    distances[slot] = distances[slot - 1]
                    stack[slot] = stack[slot - 1]
                    slot -= 1
                distances[slot] = t[k]
                stack[slot] = bvh.children[current * wp.static(NODE_FLOATS) + 48 + k]
                top += 1
        else:
            leaf = -1 - current
            found = nearest_triangle(
                bvh.leaves, leaf, ray.origin, ray.shear, ray.axes, t_min, hit.t, hit.triangle
            )
            if found[0] <= hit.t:
                hit.t = found[0]
                hit.u = found[1]
                hit.v = found[2]
                hit.triangle = bvh.leaf_ids[leaf * wp.static(LEAF_FLOATS) + 36 + int(found[3])]
                if any_hit:
                    return hit
        # Pop the nearest child that is still within reach.
        searching = bool(True)
        while searching and top > 0:
            top -= 1
            if distances[top] <= hit.t:
                current = stack[top]
                searching = False
        if searching:
            break
    return hit
