"""Triangles of the scene in world space at a time, and offsets for rays that leave them.

A point computed on a triangle is rounded, and lies on either side of its plane. A ray that leaves it must start on the
correct side: then the distance to the plane is at most 0, and the triangle's test, which ignores hits nearer than its
own error (`kernels/native/triangles.h`), does not find the surface again. The offset follows from the rounding errors
of the point (Pharr, Jakob and Humphreys, "Physically Based Rendering", 4th edition, section 6.8), so pictures do not
depend on the unit of length.
"""

import warp as wp

from wrt.kernels.core.motion import Placement, key_at
from wrt.kernels.core.ray_tree import InstanceRecord, make_instance_placement
from wrt.kernels.core.scene_data import SceneData
from wrt.kernels.core.specialise import specialised

# The number of roundings between a point of an instance's mesh and the same point in the world: five for the numbers
# of the map, their products and sums, in each direction; for rays, those of the way back count by the record's
# `round_trip`. The rest is for the triangle test.
_EPSILON = wp.constant(2.0**-24)
_ROUNDINGS = wp.constant(10.0)

# A point p0 + u e1 + v e2 is off by at most 2 |p0| + 4 |e1| + 3 |e2| roundings in each coordinate, as e1 and e2 are
# rounded themselves, and by one more for the sum that offsets it; the bound is three times that.
_CLEARANCE = wp.constant(16.0 * 2.0**-24)
# Added to each component of the normal: a triangle in a plane such as y = 0 has no error across it, but its normal has
# one.
_TILT = wp.constant(1.0 / 16.0)
WIDELY = wp.constant(16.0)
"""A point this many times its clearance off a surface can hit it, and a ray that ends there does not: more than the
error of a hit's distance."""


@wp.struct
class Triangle:
    """Corners p0, p0 + e1 and p0 + e2, in the world.

    `side` is −1 if the corners run clockwise seen from its front, as in mirrored meshes, else 1. `slack` is the
    distance by which rays may miss one of its points because an instance's map is rounded, metres.
    """

    p0: wp.vec3
    e1: wp.vec3
    e2: wp.vec3
    side: float
    slack: float


@wp.func
def edge_scale(e1: wp.vec3, e2: wp.vec3) -> float:
    """Return the factor of two edges that keeps the square of their product within float32: 1 for most."""
    size = wp.max(wp.max(wp.abs(e1)), wp.max(wp.abs(e2)))
    scale = float(1.0)
    if size > 1.0e7 or size < 1.0e-7:
        scale = 1.0 / wp.max(size, 1.0e-37)
    return scale


@wp.func
def triangle_normal(e1: wp.vec3, e2: wp.vec3) -> wp.vec3:
    """Return the unit normal of a triangle with two edges; 0 if it has no area."""
    scale = edge_scale(e1, e2)
    return wp.normalize(wp.cross(e1 * scale, e2 * scale))


@wp.func
def twice_area(e1: wp.vec3, e2: wp.vec3) -> float:
    """Return twice the area of a triangle with two edges, m²."""
    scale = edge_scale(e1, e2)
    return wp.length(wp.cross(e1 * scale, e2 * scale)) / (scale * scale)


@wp.func
def clearance(n: wp.vec3, sizes: wp.vec3, slack: float) -> float:
    """Return the offset along the normal n that puts a point of a surface on that side of it, metres.

    The coordinates of the terms that make up the point are at most `sizes`; for `slack` see `slack_of`.
    """
    return wp.dot(wp.abs(n) + wp.vec3(_TILT), sizes) * _CLEARANCE + slack


@wp.func
def slack_of(record: InstanceRecord, placement: Placement, sizes: wp.vec3) -> float:
    """Return the distance by which rays may miss points of an instance, whose coordinates are at most `sizes`."""
    size = float(0.0)
    if record.round_trip > 0.0:
        for k in range(3):
            size = wp.max(size, wp.dot(wp.abs(placement.linear[k]), sizes) + wp.abs(placement.offset[k]))
    return size * _EPSILON * _ROUNDINGS * (1.0 + record.round_trip)


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


@specialised()
def make_triangle_of(instances: str) -> wp.Function:
    """Return the device function (scene, triangle, instance, time) -> Triangle; see Features for `instances`."""
    if instances == "none":
        return triangle_of_one_tree
    deforming = instances == "deforming"
    instance_placement = make_instance_placement(instances)

    @wp.func
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
                first_share = 1.0 - at[1]
                p0 = scene.points[i0 + first] * first_share + scene.points[i0 + second] * at[1]
                p1 = scene.points[i1 + first] * first_share + scene.points[i1 + second] * at[1]
                p2 = scene.points[i2 + first] * first_share + scene.points[i2 + second] * at[1]
        placement = instance_placement(scene.placed, record, time)
        result = Triangle()
        result.p0 = placement.linear * p0 + placement.offset
        result.e1 = placement.linear * (p1 - p0)
        result.e2 = placement.linear * (p2 - p0)
        result.side = record.side
        result.slack = slack_of(record, placement, wp.max(wp.abs(p0), wp.max(wp.abs(p1), wp.abs(p2))))
        return result

    return triangle_of
