"""Disks and open cylinders of the scene in world space at a time, and points on them.

The host stores them as it does spheres (`wrt/scene/exact/quadrics.py`). The vectors of a shape, which are the normals
of its three vertices, map the unit shape to it: x and y are two radii, z is the normal of a disk, or the axis of a
cylinder from end to end. Texture coordinates are Mitsuba's: of a disk, the distance from the middle in radii and the
fraction of a turn from x; of a cylinder, the fraction of a turn and the height in its length.
"""

import warp as wp

from wrt.kernels.core.features import instances_of
from wrt.kernels.core.ray_tree import make_instance_placement
from wrt.kernels.core.rays import Ray
from wrt.kernels.core.scene_data import SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.geometry.spheres import LEAST_CHORD, NEARLY, turn_of
from wrt.kernels.geometry.triangles import clearance, slack_of
from wrt.kernels.sampling.warps import PI, TWO_PI

NO_QUADRIC = wp.constant(0)
DISK = wp.constant(1)
CYLINDER = wp.constant(2)

_LEAST_SHARE = wp.constant(1.0e-4)
"""The least distance from the middle of a disk, in radii, for the length of a turn."""


@wp.struct
class Quadric:
    """A disk or a cylinder in the world; its kind is NO_QUADRIC for triangles and spheres.

    `side` is −1 if the front is the other one: the back of a disk, the inside of a cylinder. `slack` is the distance by
    which rays may miss its points because an instance's map is rounded, metres.
    """

    kind: int
    center: wp.vec3
    x: wp.vec3
    y: wp.vec3
    z: wp.vec3
    side: float
    slack: float


@wp.func
def quadric_of_one_tree(scene: SceneData, triangle: int, instance: int, time: float) -> Quadric:
    """Return a disk or cylinder of a scene without instances."""
    corners = scene.corners[triangle]
    low = scene.points[corners[0]]
    high = scene.points[corners[1]]
    last = scene.points[corners[2]]
    quadric = Quadric()
    rises = low[0] < high[0]
    if low[0] == last[0] and low[1] == last[1] and low[2] == last[2] and rises != (low[1] < high[1]):
        quadric.kind = wp.where(rises == (low[2] < high[2]), DISK, CYLINDER)
        quadric.center = (low + high) * 0.5
        quadric.x = scene.normals[corners[0]]
        quadric.y = scene.normals[corners[1]]
        quadric.z = scene.normals[corners[2]]
        quadric.side = wp.where(rises, 1.0, -1.0)
    return quadric


@wp.func
def sizes_of(quadric: Quadric) -> wp.vec3:
    """Return a bound on the coordinates of the terms that make up points of a disk or cylinder."""
    sizes = wp.abs(quadric.center) + wp.abs(quadric.x) + wp.abs(quadric.y)
    if quadric.kind == CYLINDER:
        sizes += wp.abs(quadric.z) * 0.5
    return sizes


@specialised()
def make_quadric_of(geometry: str) -> wp.Function:
    """Return the device function (scene, triangle, instance, time) -> Quadric; see `Features.geometry`.

    The maps of instances leave cylinders round and straight; those of disks are any.
    """
    if instances_of(geometry) == "none":
        return quadric_of_one_tree
    instance_placement = make_instance_placement(instances_of(geometry))

    @wp.func
    def quadric_of(scene: SceneData, triangle: int, instance: int, time: float) -> Quadric:
        quadric = quadric_of_one_tree(scene, triangle, instance, time)
        if quadric.kind != NO_QUADRIC:
            record = scene.placed.instances[instance]
            placement = instance_placement(scene.placed, record, time)
            quadric.slack = slack_of(record, placement, sizes_of(quadric))
            quadric.center = placement.linear * quadric.center + placement.offset
            quadric.x = placement.linear * quadric.x
            quadric.y = placement.linear * quadric.y
            quadric.z = placement.linear * quadric.z
        return quadric

    return quadric_of


@wp.func
def scale_of(v: wp.vec3) -> float:
    """Return the power of two that brings a vector's largest coordinate to [1, 2); scaling by it rounds nothing."""
    largest = wp.max(wp.abs(v))
    return wp.cast(0x7F000000 - (wp.cast(largest, wp.int32) & 0x7F800000), wp.float32)


@wp.func
def in_unit_shape(quadric: Quadric, v: wp.vec3) -> wp.vec3:
    """Return the vector that the shape's own vectors map to v, by their cofactors, scaled so that none overflows."""
    scales = wp.vec3(scale_of(quadric.x), scale_of(quadric.y), scale_of(quadric.z))
    x = quadric.x * scales[0]
    y = quadric.y * scales[1]
    z = quadric.z * scales[2]
    yz = wp.cross(y, z)
    inverse = 1.0 / wp.dot(x, yz)
    mapped = wp.vec3(wp.dot(yz, v), wp.dot(wp.cross(z, x), v), wp.dot(wp.cross(x, y), v))
    return wp.cw_mul(mapped * inverse, scales)


@wp.func
def point_of(quadric: Quadric, place: wp.vec3) -> wp.vec3:
    """Return a point of the shape in the world by its place on the unit shape, whose middle is 0."""
    return quadric.center + quadric.x * place[0] + quadric.y * place[1] + quadric.z * place[2]


@wp.func
def front_of(quadric: Quadric, place: wp.vec3) -> wp.vec3:
    """Return the unit normal at a place of the unit shape, towards the front."""
    n = quadric.x * place[0] + quadric.y * place[1]
    if quadric.kind == DISK:
        n = wp.cross(quadric.x * scale_of(quadric.x), quadric.y * scale_of(quadric.y))
        if wp.dot(n, quadric.z) < 0.0:
            n = -n
    return wp.normalize(n) * quadric.side


@wp.func
def disk_area(quadric: Quadric) -> float:
    """Return the area of one side of a disk, square metres."""
    along_x = scale_of(quadric.x)
    along_y = scale_of(quadric.y)
    return PI * wp.length(wp.cross(quadric.x * along_x, quadric.y * along_y)) / (along_x * along_y)


@wp.func
def clearance_of_quadric(quadric: Quadric, n: wp.vec3) -> float:
    """Return the offset along the normal n that puts a point on that side of the shape, metres."""
    return clearance(n, sizes_of(quadric), quadric.slack)


@wp.struct
class QuadricPoint:
    """A place on the unit shape, whose middle is 0, and whether a ray comes to it from the front."""

    place: wp.vec3
    front: bool


@wp.func
def point_on_quadric(quadric: Quadric, ray: Ray, t: float) -> QuadricPoint:
    """Return the point at which a ray meets a shape, at the distance t or nearly so.

    On a cylinder it is found from the ray's line, as on a sphere: from the point of the line that is nearest to the
    axis, half a chord back or on.
    """
    point = QuadricPoint()
    o = in_unit_shape(quadric, ray.origin - quadric.center)
    d = in_unit_shape(quadric, ray.direction)
    if quadric.kind == DISK:
        s = -o[2] / d[2]
        point.place = wp.vec3(o[0] + d[0] * s, o[1] + d[1] * s, 0.0)
        point.front = wp.dot(front_of(quadric, point.place), ray.direction) < 0.0
    else:
        across = wp.max(d[0] * d[0] + d[1] * d[1], 1.0e-30)
        middle = -(o[0] * d[0] + o[1] * d[1]) / across
        x = o[0] + d[0] * middle
        y = o[1] + d[1] * middle
        error = (x * d[0] + y * d[1]) / across
        x -= d[0] * error
        y -= d[1] * error
        begins_outside = o[0] * o[0] + o[1] * o[1] > 1.0
        from_outside = begins_outside and t <= middle * NEARLY
        step = wp.max(wp.sqrt(wp.max(1.0 - (x * x + y * y), 0.0)), LEAST_CHORD) / wp.sqrt(across)
        step = wp.where(from_outside, -step, step)
        x += d[0] * step
        y += d[1] * step
        scale = 1.0 / wp.sqrt(x * x + y * y)
        z = wp.clamp(o[2] + d[2] * (middle + step), -0.5, 0.5)
        point.place = wp.vec3(x * scale, y * scale, z)
        point.front = from_outside == (quadric.side > 0.0)
    return point


@wp.func
def quadric_coordinates(quadric: Quadric, place: wp.vec3) -> wp.vec2:
    """Return the texture coordinates of a place on the unit shape."""
    if quadric.kind == DISK:
        return wp.vec2(wp.sqrt(place[0] * place[0] + place[1] * place[1]), turn_of(place))
    return wp.vec2(turn_of(place), place[2] + 0.5)


@wp.func
def by_coordinate(quadric: Quadric, place: wp.vec3, which: int) -> wp.vec3:
    """Return the derivative of a point by its first (0) or second (1) texture coordinate."""
    r = wp.sqrt(place[0] * place[0] + place[1] * place[1])
    c = float(1.0)
    s = float(0.0)
    if r > 0.0:
        c = place[0] / r
        s = place[1] / r
    along = quadric.x * c + quadric.y * s
    around = (quadric.y * c - quadric.x * s) * TWO_PI
    if quadric.kind == DISK:
        return wp.where(which == 0, along, around * wp.max(r, _LEAST_SHARE))
    return wp.where(which == 0, around, quadric.z)
