"""Sampling the lights for next-event estimation: choosing one, then a point on it.

The two are separate. `kernels/lights/choice.py` knows no kinds of lights; the functions by kind, here, know nothing of
the probability of the choice.
"""

from typing import NamedTuple

import warp as wp

from wrt.kernels.accel.bvh import Hit
from wrt.kernels.accel.intersect import INFINITE_DISTANCE, NO_HIT
from wrt.kernels.features import Features, has_quadrics, instances_of
from wrt.kernels.geometry.quadrics import (
    CYLINDER,
    DISK,
    NO_QUADRIC,
    Quadric,
    disk_area,
    front_of,
    make_quadric_of,
    point_of,
    quadric_coordinates,
    sizes_of,
)
from wrt.kernels.geometry.rays import Frame, Receiver
from wrt.kernels.geometry.spheres import Sphere, make_sphere_axes, make_sphere_of, sphere_coordinates
from wrt.kernels.geometry.surface import Surface, make_add_texture_coordinates
from wrt.kernels.geometry.triangles import Triangle, make_triangle_of, triangle_normal, twice_area
from wrt.kernels.lights.choice import make_light_choice
from wrt.kernels.lights.environment import ImagePoint, radiance_at
from wrt.kernels.lights.environment_sampling import image_pdf, sample_image
from wrt.kernels.lights.record import LightSample
from wrt.kernels.lights.shapes import are_textured, make_light_shapes
from wrt.kernels.lights.tree import NO_LIGHT
from wrt.kernels.math.trigonometry import sine_cosine
from wrt.kernels.sampling.cylinder import CylinderView, cylinder_pdf, place_on_cylinder, view_of_cylinder
from wrt.kernels.sampling.solid_angle import cone_pdf, sample_sphere, sphere_one_minus_cos
from wrt.kernels.sampling.warps import TWO_PI, square_to_triangle
from wrt.kernels.scene.scene_data import (
    LIGHT_DIRECTIONAL,
    LIGHT_ENVIRONMENT,
    LIGHT_POINT,
    LIGHT_TRIANGLE,
    LightRecord,
    SceneData,
    ShapeRecord,
)
from wrt.kernels.specialise import specialised
from wrt.kernels.textures.textures import make_slot_color, make_slot_value

# --- Triangles -------------------------------------------------------------------------------------


@wp.func
def triangle_light_pdf(double_area: float, distance2: float, cos_light: float) -> float:
    """Return the density per solid angle of a point uniform on a triangle of area double_area / 2."""
    return 2.0 * distance2 / (double_area * cos_light)


@wp.func
def hit_triangle_pdf(surface: Surface, direction: wp.vec3, distance: float) -> float:
    """Return the density of sampling a hit point, `distance` away, on its triangle."""
    cos_light = -wp.dot(surface.normal, direction)
    return triangle_light_pdf(twice_area(surface.e1, surface.e2), distance * distance, cos_light)


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
    normal = triangle_normal(triangle.e1, triangle.e2) * triangle.side
    point = triangle.p0 + triangle.e1 * b[0] + triangle.e2 * b[1]
    cos_light = wp.dot(normal, receiver.position - point)
    if cos_light < 0.0 and light.two_sided != 0:
        cos_light = -cos_light
        normal = -normal
    if cos_light > 0.0:
        off = wp.dot(wp.abs(point), wp.vec3(_OFF_TRIANGLE)) + triangle.slack
        way = point + normal * off - receiver.position
        distance2 = wp.dot(way, way)
        distance = wp.sqrt(distance2)
        sample.distance = distance * _BEFORE_TRIANGLE
        sample.wi = way / distance
        cos_light = -wp.dot(sample.wi, normal)
        if cos_light > 0.0:
            sample.pdf = triangle_light_pdf(twice_area(triangle.e1, triangle.e2), distance2, cos_light)
            sample.radiance = light.value
    return sample


# --- Spheres ---------------------------------------------------------------------------------------

_BEFORE_SPHERE = wp.constant(2.0**-20)
"""A bound on the error of a ray's direction and of a hit's distance, relative to the distance of the sphere."""


@wp.func
def sample_mesh_sphere(light: LightRecord, sphere: Sphere, axes: Frame, receiver: Receiver, u: wp.vec2) -> LightSample:
    """Return a sample of a sphere by solid angle, with the light's mean radiance; of pdf 0 from inside."""
    sample = LightSample()
    sample.point.triangle = light.triangle
    sample.point.instance = light.instance
    if sphere.side > 0.0 or light.two_sided != 0:
        way = sample_sphere(sphere.center, sphere.radius, receiver.position, u)
        if way.pdf > 0.0:
            sample.wi = way.wi
            sample.pdf = way.pdf
            sample.radiance = light.value
            sample.point.t = way.distance
            to_center = sphere.center - receiver.position
            out = wp.normalize(way.wi * way.distance - to_center)
            weights = sphere_coordinates(axes, out)
            sample.point.u = weights[0]
            sample.point.v = weights[1]
            # The shadow ray must not hit the sphere itself. Where it grazes, an error of the direction moves the hit by
            # more, at most by the half chord of a ray that deep below the limb.
            error = wp.length(to_center) * _BEFORE_SPHERE + sphere.slack
            half_chord = wp.max(wp.dot(to_center, way.wi) - way.distance, 0.0)
            margin = error * (1.0 + sphere.radius / wp.max(half_chord, wp.sqrt(error * sphere.radius)))
            sample.distance = wp.max(way.distance - 2.0 * margin, 0.0)
    return sample


# --- Disks and cylinders ---------------------------------------------------------------------------

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
        way = point + normal * off - receiver.position
        distance = wp.length(way)
        sample.wi = way / distance
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


# --- Surfaces of meshes ----------------------------------------------------------------------------


@specialised()
def make_sample_surface(geometry: str) -> wp.Function:
    """Return the device function (scene, light, receiver, u) -> LightSample of a triangle or a sphere of a mesh.

    See `Features.geometry`; there may be disks and cylinders, too.
    """
    triangle_of = make_triangle_of(instances_of(geometry))
    sphere_of, sphere_axes = make_sphere_of(geometry), make_sphere_axes(geometry)
    quadrics, quadric_of = has_quadrics(geometry), make_quadric_of(geometry)

    @wp.func
    def sample_surface(scene: SceneData, light: LightRecord, receiver: Receiver, u: wp.vec2) -> LightSample:
        sample = LightSample()
        if wp.static(quadrics):
            quadric = quadric_of(scene, light.triangle, light.instance, receiver.time)
            if quadric.kind != NO_QUADRIC:
                return sample_mesh_quadric(light, quadric, receiver, u)
        sphere = sphere_of(scene, light.triangle, light.instance, receiver.time)
        if sphere.radius > 0.0:
            axes = sphere_axes(scene, light.triangle, light.instance, receiver.time)
            sample = sample_mesh_sphere(light, sphere, axes, receiver, u)
        else:
            triangle = triangle_of(scene, light.triangle, light.instance, receiver.time)
            sample = sample_triangle(light, triangle, receiver, u)
        return sample

    return sample_surface


@specialised()
def make_hit_pdf(geometry: str) -> wp.Function:
    """Return the device function (scene, receiver, surface, hit, direction, distance) -> density of sampling a hit.

    It is for scenes with spheres; elsewhere `hit_triangle_pdf` serves.
    """
    sphere_of = make_sphere_of(geometry)
    quadrics, quadric_of = has_quadrics(geometry), make_quadric_of(geometry)

    @wp.func
    def hit_pdf(
        scene: SceneData, receiver: Receiver, surface: Surface, hit: Hit, direction: wp.vec3, distance: float
    ) -> float:
        if wp.static(quadrics):
            quadric = quadric_of(scene, hit.triangle, hit.instance, receiver.time)
            if quadric.kind != NO_QUADRIC:
                two_sided = scene.shapes[surface.shape].two_sided
                cos_light = -wp.dot(surface.normal, direction)
                return quadric_pdf(quadric, two_sided, receiver, direction, distance, cos_light)
        sphere = sphere_of(scene, hit.triangle, hit.instance, receiver.time)
        if sphere.radius > 0.0:
            return cone_pdf(sphere_one_minus_cos(sphere.center, sphere.radius, receiver.position))
        return hit_triangle_pdf(surface, direction, distance)

    return hit_pdf


@specialised()
def make_sides_of(geometry: str) -> wp.Function:
    """Return the device function (scene, light, receiver) -> how many walls of a light its samples are shared among.

    They are two for a cylinder that shines on both sides, from beyond its ends; see `Features.geometry`.
    """
    quadrics, quadric_of = has_quadrics(geometry), make_quadric_of(geometry)

    @wp.func
    def sides_of(scene: SceneData, light: LightRecord, receiver: Receiver) -> int:
        sides = int(1)
        if wp.static(quadrics):
            if light.kind == LIGHT_TRIANGLE:
                quadric = quadric_of(scene, light.triangle, light.instance, receiver.time)
                if quadric.kind == CYLINDER:
                    view = view_of_cylinder(quadric, light.two_sided, receiver.position)
                    sides = wp.where(view.near and view.far, 2, 1)
        return sides

    return sides_of


# --- All of them -----------------------------------------------------------------------------------


class Lights(NamedTuple):
    """Device functions for the lights of scenes with certain features.

    Attributes:
        sample_light: (scene, receiver, u vec4) -> LightSample of a light that it chooses.
        sample_one_light: (scene, number, probability, receiver, u vec2) -> LightSample of this light, which was chosen
            with that probability.
        choice_probability: (scene, receiver, light) -> the probability with which sample_light chooses this light.
        environment_light_pdf: (scene, receiver, point) -> the density with which sample_light samples the direction of
            a point in the environment's image.
        emission_at: (scene, shape record, surface) -> radiance of a triangle's surface, texture coordinates included.
    """

    sample_light: wp.Function
    sample_one_light: wp.Function
    choice_probability: wp.Function
    environment_light_pdf: wp.Function
    emission_at: wp.Function


@specialised()
def make_emission_at(textured: bool, uv2_alpha: bool, mipmapped: bool) -> wp.Function:
    """Return the device function `emission_at` of `Lights`; see Features."""
    slot_value = make_slot_value(uv2_alpha, mipmapped)

    @wp.func
    def emission_at(scene: SceneData, shape: ShapeRecord, surface: Surface) -> wp.vec3:
        if wp.static(textured):
            if shape.emission_slot >= 0:
                return slot_value(scene, shape.emission_slot, surface)
        return shape.emission

    return emission_at


@specialised("textured", "uv2_alpha", "mipmapped", "light_shapes", "instances", "exact", "light_tree")
def make_lights(features: Features) -> Lights:
    """Return the functions for scenes with these features."""
    textured, light_tree = features.textured, features.light_tree
    light_shapes = bool(features.light_shapes)
    textured_lights = textured and are_textured(features.light_shapes)
    sample_light_shape = make_light_shapes(features.light_shapes).sample
    choose_light, choice_probability = make_light_choice(light_tree)
    triangle_of = make_triangle_of(features.instances)
    exact = features.has_exact
    sample_surface = make_sample_surface(features.geometry)
    emission_at = make_emission_at(textured, features.uv2_alpha, features.mipmapped)
    slot_color = make_slot_color(features.mipmapped)
    add_texture_coordinates = make_add_texture_coordinates(features.uv2_alpha, features.has_exact)

    @wp.func
    def way_to_light(scene: SceneData, number: int, receiver: Receiver, u: wp.vec2) -> LightSample:
        light = scene.lights[number]
        sample = LightSample()
        sample.radiance = wp.vec3(0.0)
        sample.point.triangle = NO_HIT
        if light.kind == LIGHT_TRIANGLE:
            if wp.static(exact):
                sample = sample_surface(scene, light, receiver, u)
            else:
                triangle = triangle_of(scene, light.triangle, light.instance, receiver.time)
                sample = sample_triangle(light, triangle, receiver, u)
            if wp.static(textured):
                if sample.pdf > 0.0:
                    surface = Surface()
                    if wp.static(exact):
                        surface.uv = wp.vec2(sample.point.u, sample.point.v)
                    surface = add_texture_coordinates(scene, sample.point, surface)
                    shape = scene.shapes[light.shape]
                    sample.radiance = emission_at(scene, shape, surface)
        elif light.kind == LIGHT_POINT:
            way = light.place - receiver.position
            distance2 = wp.dot(way, way)
            sample.distance = wp.sqrt(distance2)
            sample.delta = True
            if distance2 > 0.0:
                sample.wi = way / sample.distance
                sample.radiance = light.value / distance2
        elif light.kind == LIGHT_DIRECTIONAL:
            sample.wi = light.place
            sample.distance = INFINITE_DISTANCE
            sample.delta = True
            sample.radiance = light.value
        elif light.kind == LIGHT_ENVIRONMENT:
            s = sample_image(scene.environment, receiver, u)
            sample.wi = s.wi
            sample.distance = INFINITE_DISTANCE
            sample.pdf = s.pdf
            if sample.pdf > 0.0:
                sample.radiance = radiance_at(scene.environment, s.point.uv)
        else:
            if wp.static(light_shapes):
                sample = sample_light_shape(scene, light, receiver, u)
                if wp.static(textured_lights):
                    slot = scene.light_shapes[light.shape].slot
                    if slot >= 0:
                        uv = wp.vec2(sample.point.u, sample.point.v)
                        texel = slot_color(scene, scene.slots[slot], uv, wp.vec4(), wp.vec3(1.0))
                        sample.radiance = wp.cw_mul(sample.radiance, texel)
        return sample

    @wp.func
    def sample_one_light(
        scene: SceneData, number: int, probability: float, receiver: Receiver, u: wp.vec2
    ) -> LightSample:
        sample = way_to_light(scene, number, receiver, u)
        sample.pdf = sample.pdf * probability
        density = sample.pdf
        if sample.delta:
            density = probability
        if density > 0.0:
            sample.radiance = sample.radiance / density
        else:
            sample.radiance = wp.vec3(0.0)
        return sample

    @wp.func
    def sample_light(scene: SceneData, receiver: Receiver, u: wp.vec4) -> LightSample:
        choice = choose_light(scene, receiver, u)
        if wp.static(light_tree):
            if choice.light == NO_LIGHT:
                nothing = LightSample()
                nothing.point.triangle = NO_HIT
                return nothing
        return sample_one_light(scene, choice.light, choice.probability, receiver, choice.u)

    @wp.func
    def environment_light_pdf(scene: SceneData, receiver: Receiver, point: ImagePoint) -> float:
        if scene.environment.light < 0:
            return 0.0
        probability = choice_probability(scene, receiver, scene.environment.light)
        return image_pdf(scene.environment, receiver, point) * probability

    return Lights(sample_light, sample_one_light, choice_probability, environment_light_pdf, emission_at)
