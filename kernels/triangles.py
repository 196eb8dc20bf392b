"""A triangle of the scene where it is in the world, at a time, and leaving it.

A point of a triangle is rounded, and lies on either side of its plane. A ray that leaves it has to start on the right
side: then it is at a distance of at most 0 from the plane, and the triangle's test, which counts nothing nearer than
its own error (`kernels/simd.py`), does not find the surface again. How far off that is follows from how the point was
computed (Pharr, Jakob and Humphreys, "Physically Based Rendering", 4th edition, section 6.8), so that pictures do not
depend on the unit of length.
"""

import functools

import warp as wp

from wrt.kernels.instances import make_instance_placement
from wrt.kernels.motion import key_at
from wrt.kernels.scene_data import SceneData

# How many roundings lie between a point of an instance's mesh and the same point of the world: five for the numbers
# of the map, their products and sums, on the way there and, for rays, back, where they count by the record's
# `round_trip`; the rest is for the test of a triangle.
_EPSILON = wp.constant(2.0**-24)
_ROUNDINGS = wp.constant(10.0)

# A point p0 + u e1 + v e2 is off by at most 2 |p0| + 4 |e1| + 3 |e2| roundings in each coordinate, e1 and e2 being
# rounded themselves, and by one more of the sum where it is moved; three times that.
_CLEARANCE = wp.constant(16.0 * 2.0**-24)
# So much more counts as every component of the normal: where a triangle lies in a plane such as y = 0, there is no
# error across it, but there is one in its normal.
_TILT = wp.constant(1.0 / 16.0)
WIDELY = wp.constant(16.0)
"""How many times its clearance off a surface a point must be for that surface to be hit from there, or not to be hit
by a ray that ends there: more than the error of a hit's distance."""


@wp.struct
class Triangle:
    """Corners p0, p0 + e1 and p0 + e2, in the world.

    `side` is −1 where its front is the side from which they run clockwise, as in mirror images of meshes, else 1.
    `slack` is by how much rays may miss a point of it because of the rounding of an instance's map, metres.
    """

    p0: wp.vec3
    e1: wp.vec3
    e2: wp.vec3
    side: float
    slack: float


@wp.func
def clearance_of(triangle: Triangle, n: wp.vec3) -> float:
    """Return how far along its normal n a point of a triangle is moved to be on that side of it, metres."""
    sizes = wp.abs(triangle.p0) + wp.abs(triangle.e1) + wp.abs(triangle.e2)
    return wp.dot(wp.abs(n) + wp.vec3(_TILT), sizes) * _CLEARANCE + triangle.slack


@wp.func
def triangle_of_one_tree(scene: SceneData, triangle: int, instance: int, time: float) -> Triangle:
    """Return a triangle of a scene without instances."""
    result = Triangle()
    corners = scene.corners[triangle]
    result.p0 = scene.points[corners[0]]
    result.e1 = scene.points[corners[1]] - result.p0
    result.e2 = scene.points[corners[2]] - result.p0
    result.side = 1.0
    return result


@functools.cache
def make_triangle_of(instances: str) -> wp.Function:
    """Return the device function (scene, triangle, instance, time) -> Triangle; `instances` as in Features."""
    if instances == "none":
        return triangle_of_one_tree
    deforming = instances == "deforming"
    instance_placement = make_instance_placement(instances)

    @wp.func(name=f"triangle_of_{instances}")
    def triangle_of(scene: SceneData, triangle: int, instance: int, time: float) -> Triangle:
        record = scene.placed.instances[instance]
        corners = scene.corners[triangle]
        i0 = corners[0]
        i1 = corners[1]
        i2 = corners[2]
        p0 = scene.points[i0]
        p1 = scene.points[i1]
        p2 = scene.points[i2]
        if wp.static(deforming):
            mesh = scene.placed.meshes[record.mesh]
            if mesh.keys > 1:
                at = key_at(scene.placed.key_times, mesh.first_time, mesh.keys, time)
                first = int(at[0]) * mesh.vertex_stride
                second = wp.min(first + mesh.vertex_stride, (mesh.keys - 1) * mesh.vertex_stride)
                rest = 1.0 - at[1]
                p0 = scene.points[i0 + first] * rest + scene.points[i0 + second] * at[1]
                p1 = scene.points[i1 + first] * rest + scene.points[i1 + second] * at[1]
                p2 = scene.points[i2 + first] * rest + scene.points[i2 + second] * at[1]
        placement = instance_placement(scene.placed, record, time)
        result = Triangle()
        result.p0 = placement.linear * p0 + placement.offset
        result.e1 = placement.linear * (p1 - p0)
        result.e2 = placement.linear * (p2 - p0)
        result.side = record.side
        # The largest coordinate that is rounded on the way.
        size = float(0.0)
        for k in range(3):
            products = wp.max(wp.abs(p0), wp.max(wp.abs(p1), wp.abs(p2)))
            size = wp.max(size, wp.dot(wp.abs(placement.linear[k]), products) + wp.abs(placement.offset[k]))
        if record.round_trip > 0.0:
            result.slack = size * _EPSILON * _ROUNDINGS * (1.0 + record.round_trip)
        return result

    return triangle_of
