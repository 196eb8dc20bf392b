"""Sampling emissive triangles, exact spheres, disks and cylinders.

From a point outside, a cylinder fills an angle about the parallel to its axis through the point; from a point inside, a
whole turn. That angle α is sampled uniformly, and so is the height h along the axis. In a direction that makes the
angle γ with the axis, dα dh is the solid angle sin²γ / r dα dh at the distance r. The density has no cosine at the
light, and no sample is wasted on what the point cannot see.
"""

import warp as wp

from wrt.kernels.core.elementary import arc_tangent, sine_cosine
from wrt.kernels.core.features import distances_of, has_exact, has_quadrics, instances_of
from wrt.kernels.core.ray_tree import NO_HIT, Hit
from wrt.kernels.core.rays import Frame, Receiver
from wrt.kernels.core.scene_data import LIGHT_TRIANGLE, LightRecord, SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.geometry.distances import make_volume_of
from wrt.kernels.geometry.quadrics import (
    CYLINDER,
    DISK,
    NO_QUADRIC,
    Quadric,
    disk_area,
    front_of,
    in_unit_shape,
    make_quadric_of,
    point_of,
    quadric_coordinates,
    sizes_of,
)
from wrt.kernels.geometry.spheres import Sphere, make_sphere_axes, make_sphere_of, sphere_coordinates
from wrt.kernels.geometry.surface import Surface
from wrt.kernels.geometry.triangles import Triangle, edge_scale, make_triangle_of, twice_area
from wrt.kernels.lights.record import LightSample
from wrt.kernels.sampling.solid_angle import cone_pdf, finite_density, sample_sphere, sphere_one_minus_cos
from wrt.kernels.sampling.warps import TWO_PI, square_to_triangle


@wp.struct
class CylinderView:
    """The lit part of a cylinder that a point may see, in the plane across its axis, in radii.

    The point is at `distance` from the axis, in the direction `towards`. The cylinder fills the angle `width` there,
    radians. A line from the point meets the wall twice; `near` and `far` are true for the meetings that count.
    """

    towards: wp.vec2
    distance: float
    width: float
    near: bool
    far: bool


@wp.func
def view_of_cylinder(quadric: Quadric, two_sided: int, position: wp.vec3) -> CylinderView:
    """Return what a point sees; from outside, it sees the far wall through an end only, not from beside it."""
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
    is_beside = outside and wp.abs(place[2]) <= 0.5
    view.far = not is_beside and (two_sided != 0 or quadric.side < 0.0)
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
def triangle_light_pdf(double_area: float, distance2: float, cos_light: float) -> float:
    """Return the density per solid angle of a point uniform on a triangle of area double_area / 2."""
    return 2.0 * distance2 / (double_area * cos_light)


_OFF_TRIANGLE = wp.constant(2.0**-17)


_BEFORE_TRIANGLE = wp.constant(1.0 - 2.0**-18)
"""A shadow ray ends this far off an emissive triangle, relative to the coordinates there, and this share of its length
before it: more than the error of a hit's distance, near and far, or it would hit the triangle."""


@wp.func
def sample_triangle(light: LightRecord, triangle: Triangle, receiver: Receiver, u: wp.vec2) -> LightSample:
    """Return a sample of a point uniform on a triangle, with the light's mean radiance."""
    sample = LightSample()
    b = square_to_triangle(u)
    sample.point.triangle = light.triangle
    sample.point.instance = light.instance
    sample.point.u = b[0]
    sample.point.v = b[1]
    scale = edge_scale(triangle.e1, triangle.e2)
    cross = wp.cross(triangle.e1 * scale, triangle.e2 * scale)
    normal = wp.normalize(cross) * triangle.side
    point = triangle.p0 + triangle.e1 * b[0] + triangle.e2 * b[1]
    cos_light = wp.dot(normal, receiver.position - point)
    if cos_light < 0.0 and light.two_sided != 0:
        cos_light = -cos_light
        normal = -normal
    if cos_light > 0.0:
        off = wp.dot(wp.abs(point), wp.vec3(_OFF_TRIANGLE)) + triangle.slack
        to_light = point + normal * off - receiver.position
        distance2 = wp.dot(to_light, to_light)
        distance = wp.sqrt(distance2)
        sample.distance = distance * _BEFORE_TRIANGLE
        sample.wi = to_light / distance
        cos_light = -wp.dot(sample.wi, normal)
        if cos_light > 0.0:
            sample.pdf = triangle_light_pdf(wp.length(cross) / (scale * scale), distance2, cos_light)
            sample.radiance = light.value
    return sample


_BEFORE_SPHERE = wp.constant(2.0**-20)
"""A bound on the error of a ray's direction and of a hit's distance, relative to the distance of the sphere."""


@wp.func
def sample_mesh_sphere(light: LightRecord, sphere: Sphere, axes: Frame, receiver: Receiver, u: wp.vec2) -> LightSample:
    """Return a sample of a sphere by solid angle, with the light's mean radiance; of pdf 0 from inside."""
    sample = LightSample()
    sample.point.triangle = light.triangle
    sample.point.instance = light.instance
    if sphere.side > 0.0 or light.two_sided != 0:
        found = sample_sphere(sphere.center, sphere.radius, receiver.position, u)
        if found.pdf > 0.0:
            sample.wi = found.wi
            sample.pdf = found.pdf
            sample.radiance = light.value
            sample.point.t = found.distance
            to_center = sphere.center - receiver.position
            out = wp.normalize(found.wi * found.distance - to_center)
            weights = sphere_coordinates(axes, out)
            sample.point.u = weights[0]
            sample.point.v = weights[1]
            # The shadow ray must not hit the sphere itself. Where it grazes, an error of the direction moves the hit by
            # more, at most by the half chord of a ray that deep below the limb.
            error = wp.length(to_center) * _BEFORE_SPHERE + sphere.slack
            half_chord = wp.max(wp.dot(to_center, found.wi) - found.distance, 0.0)
            margin = error * (1.0 + sphere.radius / wp.max(half_chord, wp.sqrt(error * sphere.radius)))
            sample.distance = wp.max(found.distance - 2.0 * margin, 0.0)
    return sample


_OFF_QUADRIC = wp.constant(2.0**-19)
"""A shadow ray ends this far off the light, relative to the sizes of the terms that make up its points."""


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
        to_light = point + normal * off - receiver.position
        distance = wp.length(to_light)
        sample.wi = to_light / distance
        sample.point.t = distance
        sample.distance = distance * _BEFORE_TRIANGLE
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


@specialised()
def make_sample_surface(geometry: str) -> wp.Function:
    """Return the device function (scene, light, receiver, u) -> LightSample of a triangle or exact shape of a mesh."""
    triangle_of, quadric_of = make_triangle_of(instances_of(geometry)), make_quadric_of(geometry)
    sphere_of, sphere_axes = make_sphere_of(geometry), make_sphere_axes(geometry)
    volume_of = make_volume_of(geometry)

    @wp.func
    def sample_surface(scene: SceneData, light: LightRecord, receiver: Receiver, u: wp.vec2) -> LightSample:
        if wp.static(bool(distances_of(geometry))):
            if volume_of(scene, light.triangle, light.instance, receiver.time).model >= 0:
                nothing = LightSample()  # rays find its light by chance alone
                nothing.point.triangle = NO_HIT
                return nothing
        if wp.static(has_quadrics(geometry)):
            quadric = quadric_of(scene, light.triangle, light.instance, receiver.time)
            if quadric.kind != NO_QUADRIC:
                return sample_mesh_quadric(light, quadric, receiver, u)
        if wp.static(has_exact(geometry)):
            sphere = sphere_of(scene, light.triangle, light.instance, receiver.time)
            if sphere.radius > 0.0:
                axes = sphere_axes(scene, light.triangle, light.instance, receiver.time)
                return sample_mesh_sphere(light, sphere, axes, receiver, u)
        return sample_triangle(light, triangle_of(scene, light.triangle, light.instance, receiver.time), receiver, u)

    return sample_surface


@specialised()
def make_hit_pdf(geometry: str) -> wp.Function:
    """Return the device function (scene, receiver, surface, hit, direction, distance) -> density of sampling a hit."""
    sphere_of, quadric_of = make_sphere_of(geometry), make_quadric_of(geometry)
    volume_of = make_volume_of(geometry)

    @wp.func
    def hit_pdf(
        scene: SceneData, receiver: Receiver, surface: Surface, hit: Hit, direction: wp.vec3, distance: float
    ) -> float:
        if wp.static(bool(distances_of(geometry))):
            if volume_of(scene, hit.triangle, hit.instance, receiver.time).model >= 0:
                return 0.0
        if wp.static(has_quadrics(geometry)):
            quadric = quadric_of(scene, hit.triangle, hit.instance, receiver.time)
            if quadric.kind != NO_QUADRIC:
                two_sided = scene.shapes[surface.shape].two_sided
                cos_light = -wp.dot(surface.normal, direction)
                return quadric_pdf(quadric, two_sided, receiver, direction, distance, cos_light)
        if wp.static(has_exact(geometry)):
            sphere = sphere_of(scene, hit.triangle, hit.instance, receiver.time)
            if sphere.radius > 0.0:
                return cone_pdf(sphere_one_minus_cos(sphere.center, sphere.radius, receiver.position))
        cos_light = -wp.dot(surface.normal, direction)
        return triangle_light_pdf(twice_area(surface.e1, surface.e2), distance * distance, cos_light)

    return hit_pdf


@specialised()
def make_sides_of(geometry: str) -> wp.Function:
    """Return the device function (scene, light, receiver) -> the number of walls of a light that share its samples.

    They are two for a cylinder that emits on both sides, from beyond its ends; see `Features.geometry`.
    """
    quadric_of = make_quadric_of(geometry)

    @wp.func
    def sides_of(scene: SceneData, light: LightRecord, receiver: Receiver) -> int:
        sides = int(1)
        if wp.static(has_quadrics(geometry)):
            if light.kind == LIGHT_TRIANGLE:
                quadric = quadric_of(scene, light.triangle, light.instance, receiver.time)
                if quadric.kind == CYLINDER:
                    view = view_of_cylinder(quadric, light.two_sided, receiver.position)
                    sides = wp.where(view.near and view.far, 2, 1)
        return sides

    return sides_of
