"""The ray tree: a bounding volume hierarchy with eight children per node, and single rays through it.

A node is 56 floats: lower x, y, z and upper x, y, z of its eight boxes, then eight children as integers. A child
c ≥ 0 is a node, c < 0 the leaf −1 − c. A leaf is ten floats for each of its triangles, interleaved: x, y, z of the
first, second and third corners, then the triangle numbers. Unused children have inverted boxes, unused triangles
coincident corners; no ray hits either.

Traversal is C++ (`kernels/native/traversal.h`): in Warp's Python, with the two tests as intrinsics, it reaches 80 to
85 % of the speed, as Warp clears and copies the stack for each ray.
"""

import warp as wp

from wrt.kernels.native import include

traversal_h = include("traversal.h")


@wp.struct
class Bvh:
    """The tree; node 0 is the root."""

    nodes: wp.array(dtype=float)
    leaves: wp.array(dtype=float)


@wp.func_native("return wrt::closest_hit(bvh, origin, direction, t_min, t_max, any_hit);")
def _traverse(bvh: Bvh, origin: wp.vec3, direction: wp.vec3, t_min: float, t_max: float, any_hit: bool) -> wp.vec4:
    traversal_h()


@wp.func_native("return wrt::next_hit(bvh, origin, direction, t_min, t_max, id_min);")
def _traverse_after(bvh: Bvh, origin: wp.vec3, direction: wp.vec3, t_min: float, t_max: float, id_min: int) -> wp.vec4:
    traversal_h()


@wp.struct
class Hit:
    """The point where a ray hits triangle (v0, v1, v2), (1 − u − v) v0 + u v1 + v v2, at distance t.

    For a miss `triangle` is −1 and t is the end of the ray. `instance` is the number of the instance hit, in scenes
    with instances.
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
    """Return the nearest hit with t in [t_min, t_max], of equal ones that with the lowest triangle number, or any hit.

    t_min must not be negative. `direction` may have any length but zero; t is in units of it.
    """
    return _hit(_traverse(bvh, origin, direction, t_min, t_max, any_hit))


@wp.func
def bvh_closest_hit(bvh: Bvh, origin: wp.vec3, direction: wp.vec3, t_min: float, t_max: float) -> Hit:
    """Return the nearest hit with t in [t_min, t_max], of equal ones that with the lowest triangle number."""
    return bvh_hit(bvh, origin, direction, t_min, t_max, False)


@wp.func
def bvh_next_hit(bvh: Bvh, origin: wp.vec3, direction: wp.vec3, last: Hit, t_max: float) -> Hit:
    """Return the hit up to t_max that follows `last`: farther away, or as far with a higher triangle number.

    This enumerates the surfaces along a ray one by one, coincident ones included.
    """
    return _hit(_traverse_after(bvh, origin, direction, last.t, t_max, last.triangle))


@wp.func
def bvh_any_hit(bvh: Bvh, origin: wp.vec3, direction: wp.vec3, t_min: float, t_max: float) -> bool:
    """Return whether there is a hit with t in [t_min, t_max]."""
    found = _traverse(bvh, origin, direction, t_min, t_max, True)
    return wp.cast(found[0], wp.int32) >= 0
