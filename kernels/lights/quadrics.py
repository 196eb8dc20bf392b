"""Disks and cylinders of meshes that shine: points of disks by area, points of cylinders by angle and height.

From a point outside, a cylinder fills an angle about the parallel to its axis through the point; from a point inside, a
whole turn. That angle α is sampled uniformly, and so is the height h along the axis. In a direction that makes the
angle γ with the axis, dα dh is the solid angle sin²γ / r dα dh at the distance r. The density has no cosine at the
light, and no sample is wasted on what the point cannot see.
"""

import warp as wp

from wrt.kernels.geometry.quadrics import (
    DISK,
    Quadric,
    disk_area,
    front_of,
    in_unit_shape,
    point_of,
    quadric_coordinates,
    sizes_of,
)
from wrt.kernels.geometry.rays import Receiver
from wrt.kernels.lights.record import BEFORE_SURFACE, LightSample
from wrt.kernels.math.trigonometry import arc_tangent, sine_cosine
from wrt.kernels.sampling.solid_angle import finite_density
from wrt.kernels.sampling.warps import TWO_PI
from wrt.kernels.scene.scene_data import LightRecord

_OFF_QUADRIC = wp.constant(2.0**-19)
"""A shadow ray ends this far off the light, relative to the sizes of the terms that make up its points."""


@wp.struct
class CylinderView:
    """What a point may see shine of a cylinder, in the plane across its axis, in radii.

    The point is at `distance` from the axis, in the direction `towards`. The cylinder fills the angle `width` there,
    radians. A line from the point meets the wall twice: whether the `near` and the `far` meeting count.
    """

    towards: wp.vec2
    distance: float
    width: float
    near: bool
    far: bool


@wp.func
def view_of_cylinder(quadric: Quadric, two_sided: int, position: wp.vec3) -> CylinderView:
    """Return what a point sees.

    The far wall from outside is seen through an end alone, so from none of the places beside the cylinder.
    """
    view = CylinderView()
    place = in_unit_shape(quadric, position - quadric.center)
    view.towards = wp.vec2(1.0, 0.0)
    view.distance = wp.sqrt(place[0] * place[0] + place[1] * place[1])
    if view.distance > 0.0:
        view.towards = wp.vec2(place[0] / view.distance, place[1] / view.distance)
    outside = view.distance > 1.0
    view.width = TWO_PI
    if outside:
        view.width = 2.0 * arc_tangent(1.0, wp.sqrt((view.distance - 1.0) * (view.distance + 1.0)))
    view.near = outside and (two_sided != 0 or quadric.side > 0.0)
    beside = outside and wp.abs(place[2]) <= 0.5
    view.far = not beside and (two_sided != 0 or quadric.side < 0.0)
    return view


@wp.func
def place_on_cylinder(view: CylinderView, u: wp.vec2) -> wp.vec3:
    """Return a place on the unit cylinder; u = 0 is the nearest one of the circle in the middle."""
    share = u[0]
    near = view.near
    if view.near and view.far:
        near = u[0] < 0.5
        share = wp.where(near, 2.0 * u[0], 2.0 * u[0] - 1.0)
    turned = sine_cosine(view.width * wp.where(share < 0.5, share, share - 1.0))
    off_axis = view.distance * turned[0]
    half_chord = wp.sqrt(wp.max(1.0 - off_axis * off_axis, 0.0))
    half_chord = wp.where(near, half_chord, -half_chord)
    # Along `towards`, and across it
    x = off_axis * turned[0] + half_chord * turned[1]
    y = off_axis * turned[1] - half_chord * turned[0]
    scale = 1.0 / wp.sqrt(x * x + y * y)
    x = x * scale
    y = y * scale
    height = wp.where(u[1] < 0.5, u[1], u[1] - 1.0)
    return wp.vec3(x * view.towards[0] - y * view.towards[1], x * view.towards[1] + y * view.towards[0], height)


@wp.func
def cylinder_pdf(quadric: Quadric, view: CylinderView, direction: wp.vec3, distance: float) -> float:
    """Return the density per solid angle of `place_on_cylinder` in a direction that meets it at a distance."""
    sides = wp.where(view.near, 1.0, 0.0) + wp.where(view.far, 1.0, 0.0)
    length = wp.length(quadric.z)
    sine2 = wp.length_sq(wp.cross(direction, quadric.z / length))
    if sides == 0.0 or sine2 == 0.0:
        return 0.0
    return finite_density(distance / (sides * sine2 * view.width * length))


@wp.func
def place_on_disk(u: wp.vec2) -> wp.vec3:
    """Return a place on the unit disk, uniform by area; u = 0 is the middle."""
    around = sine_cosine(TWO_PI * u[1])
    r = wp.sqrt(u[0])
    return wp.vec3(r * around[1], r * around[0], 0.0)


@wp.func
def disk_pdf_by_area(quadric: Quadric, distance: float, cos_light: float) -> float:
    """Return the density per solid angle of a point that is uniform on a disk."""
    return distance * distance / (disk_area(quadric) * cos_light)


@wp.func
def sample_mesh_quadric(light: LightRecord, quadric: Quadric, receiver: Receiver, u: wp.vec2) -> LightSample:
    """Return a sample of a disk or cylinder with the light's mean radiance; of pdf 0 where its back is seen."""
    sample = LightSample()
    sample.point.triangle = light.triangle
    sample.point.instance = light.instance
    view = CylinderView()
    place = place_on_disk(u)
    if quadric.kind != DISK:
        view = view_of_cylinder(quadric, light.two_sided, receiver.position)
        place = place_on_cylinder(view, u)
    weights = quadric_coordinates(quadric, place)
    sample.point.u = weights[0]
    sample.point.v = weights[1]
    point = point_of(quadric, place)
    normal = front_of(quadric, place)
    if wp.dot(normal, receiver.position - point) < 0.0 and light.two_sided != 0:
        normal = -normal
    if wp.dot(normal, receiver.position - point) > 0.0:
        off = wp.dot(sizes_of(quadric), wp.vec3(_OFF_QUADRIC)) + quadric.slack
        way = point + normal * off - receiver.position
        distance = wp.length(way)
        sample.wi = way / distance
        sample.point.t = distance
        sample.distance = distance * BEFORE_SURFACE
        cos_light = -wp.dot(sample.wi, normal)
        if cos_light > 0.0:
            if quadric.kind == DISK:
                sample.pdf = disk_pdf_by_area(quadric, distance, cos_light)
            else:
                sample.pdf = cylinder_pdf(quadric, view, sample.wi, distance)
            sample.radiance = light.value
    return sample


@wp.func
def quadric_pdf(
    quadric: Quadric, two_sided: int, receiver: Receiver, direction: wp.vec3, distance: float, cos_light: float
) -> float:
    """Return the density per solid angle with which `sample_mesh_quadric` samples a hit."""
    if quadric.kind == DISK:
        return disk_pdf_by_area(quadric, distance, cos_light)
    return cylinder_pdf(quadric, view_of_cylinder(quadric, two_sided, receiver.position), direction, distance)
