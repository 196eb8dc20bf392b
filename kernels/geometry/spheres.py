"""Spheres of the scene in world space at a time, and points on them.

The host stores a sphere as a triangle (`wrt/scene/exact/spheres.py`): its corners are two opposite corners of the box
around it, the normals of its vertices are the sphere's axes, and its texture coordinates are (0, 0), (1, 0) and (0, 1).
So all that is interpolated over a triangle by u and v is interpolated over a sphere by the fraction of a turn about its
z axis and the angle from that axis over π.
"""

import warp as wp

from wrt.kernels.core.elementary import arc_tangent
from wrt.kernels.core.features import instances_of
from wrt.kernels.core.ray_tree import make_instance_placement
from wrt.kernels.core.rays import Frame, Ray, to_local, to_world
from wrt.kernels.core.scene_data import SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.geometry.triangles import clearance, slack_of
from wrt.kernels.sampling.warps import PI, TWO_PI

LEAST_CHORD = wp.constant(1.0e-5)
"""The least half chord, in radii, so that the viewer is never in the plane of the surface."""

NEARLY = wp.constant(1.0 + 2.0**-21)
"""More than the error of a distance: of a chord that short, rays from outside meet the near end."""

_LEAST_SINE = wp.constant(1.0e-4)
"""The least sine of the angle to the poles, where a turn has no length."""


@wp.struct
class Sphere:
    """A sphere in the world; its radius is 0 for a triangle.

    `side` is −1 if the front is the inside. `slack` is the distance by which rays may miss its points because an
    instance's map is rounded, metres.
    """

    center: wp.vec3
    radius: float
    side: float
    slack: float


@wp.struct
class SpherePoint:
    """A point on a sphere: the unit vector to it from the centre, and whether a ray comes to it from outside."""

    out: wp.vec3
    from_outside: bool


@wp.func
def sphere_of_one_tree(scene: SceneData, triangle: int, instance: int, time: float) -> Sphere:
    """Return a sphere of a scene without instances."""
    corners = scene.corners[triangle]
    low = scene.points[corners[0]]
    high = scene.points[corners[1]]
    last = scene.points[corners[2]]
    sphere = Sphere()
    if low[0] == last[0] and low[1] == last[1] and low[2] == last[2]:
        sphere.center = (low + high) * 0.5
        half = wp.abs(high - low) * 0.5
        sphere.radius = wp.min(half[0], wp.min(half[1], half[2]))
        sphere.side = wp.where(high[0] < low[0], -1.0, 1.0)
    return sphere


@specialised()
def make_sphere_of(geometry: str) -> wp.Function:
    """Return the device function (scene, triangle, instance, time) -> Sphere; see `Features.geometry`.

    The maps of instances of spheres are similarities.
    """
    if instances_of(geometry) == "none":
        return sphere_of_one_tree
    instance_placement = make_instance_placement(instances_of(geometry))

    @wp.func
    def sphere_of(scene: SceneData, triangle: int, instance: int, time: float) -> Sphere:
        sphere = sphere_of_one_tree(scene, triangle, instance, time)
        if sphere.radius > 0.0:
            record = scene.placed.instances[instance]
            placement = instance_placement(scene.placed, record, time)
            linear = placement.linear
            sphere.slack = slack_of(record, placement, wp.abs(sphere.center) + wp.vec3(sphere.radius))
            sphere.center = linear * sphere.center + placement.offset
            sphere.radius = sphere.radius * wp.length(wp.vec3(linear[0, 0], linear[1, 0], linear[2, 0]))
        return sphere

    return sphere_of


@specialised()
def make_sphere_axes(geometry: str) -> wp.Function:
    """Return the device function (scene, triangle, instance, time) -> Frame of a sphere's axes."""
    in_one_tree = instances_of(geometry) == "none"
    instance_placement = make_instance_placement("still" if in_one_tree else instances_of(geometry))

    @wp.func
    def sphere_axes(scene: SceneData, triangle: int, instance: int, time: float) -> Frame:
        corners = scene.corners[triangle]
        x = scene.normals[corners[0]]
        y = scene.normals[corners[1]]
        z = scene.normals[corners[2]]
        if wp.static(not in_one_tree):
            linear = instance_placement(scene.placed, scene.placed.instances[instance], time).linear
            x = linear * x
            y = linear * y
            z = linear * z
        axes = Frame()
        axes.s = wp.normalize(x)
        axes.t = wp.normalize(y)
        axes.n = wp.normalize(z)
        return axes

    return sphere_axes


@wp.func
def clearance_of_sphere(sphere: Sphere, n: wp.vec3) -> float:
    """Return the offset along the normal n that puts a point of a sphere on that side of it, metres."""
    return clearance(n, wp.abs(sphere.center) + wp.vec3(sphere.radius), sphere.slack)


@wp.func
def point_on_sphere(sphere: Sphere, ray: Ray, t: float) -> SpherePoint:
    """Return the point at which a ray meets a sphere, at the distance t or nearly so.

    It is found from the ray's line, since the error of t grows with the distance: from the point of the line that is
    nearest to the centre, half a chord back or on.
    """
    from_center = ray.origin - sphere.center
    middle = -wp.dot(from_center, ray.direction)
    nearest = (from_center + ray.direction * middle) / sphere.radius
    nearest = nearest - ray.direction * wp.dot(nearest, ray.direction)
    half_chord = wp.sqrt(wp.max(1.0 - wp.dot(nearest, nearest), 0.0))
    point = SpherePoint()
    begins_outside = wp.dot(from_center, from_center) > sphere.radius * sphere.radius
    point.from_outside = begins_outside and t <= middle * NEARLY
    step = wp.max(half_chord, LEAST_CHORD)
    point.out = wp.normalize(nearest + ray.direction * wp.where(point.from_outside, -step, step))
    return point


@wp.func
def turn_of(v: wp.vec3) -> float:
    """Return the fraction of a turn of a vector about z, from x."""
    turn = arc_tangent(v[1], v[0]) / TWO_PI
    return wp.where(turn < 0.0, turn + 1.0, turn)


@wp.func
def sphere_coordinates(axes: Frame, out: wp.vec3) -> wp.vec2:
    """Return the texture coordinates of the point of a sphere in a direction: fractions of a turn and of half a one."""
    local = to_local(axes, out)
    return wp.vec2(turn_of(local), arc_tangent(wp.sqrt(local[0] * local[0] + local[1] * local[1]), local[2]) / PI)


@wp.func
def along_turn(axes: Frame, out: wp.vec3, radius: float) -> wp.vec3:
    """Return the derivative of a point of a sphere by its first coordinate."""
    local = to_local(axes, out)
    sine = wp.sqrt(local[0] * local[0] + local[1] * local[1])
    around = wp.vec3(0.0, 1.0, 0.0)
    if sine > 0.0:
        around = wp.vec3(-local[1] / sine, local[0] / sine, 0.0)
    return to_world(axes, around) * (TWO_PI * radius * wp.max(sine, _LEAST_SINE))


@wp.func
def along_meridian(axes: Frame, out: wp.vec3, radius: float) -> wp.vec3:
    """Return the derivative of a point of a sphere by its second coordinate."""
    local = to_local(axes, out)
    sine = wp.sqrt(local[0] * local[0] + local[1] * local[1])
    down = wp.vec3(1.0, 0.0, 0.0)
    if sine > 0.0:
        down = wp.vec3(local[0] / sine * local[2], local[1] / sine * local[2], -sine)
    return to_world(axes, down) * (PI * radius)
