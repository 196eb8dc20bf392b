"""Sampling the lights for next-event estimation: choosing one, then a way to a point of it.

The two are kept apart. `kernels/light_choice.py` knows nothing of what a light is; the functions by kind, here, know
nothing of how often it is chosen.
"""

import functools
from typing import NamedTuple

import warp as wp

from wrt.kernels.bvh import Hit
from wrt.kernels.environment import ImagePoint, radiance_at
from wrt.kernels.environment_sampling import image_pdf, sample_image
from wrt.kernels.features import Features
from wrt.kernels.geometry import Receiver
from wrt.kernels.intersect import INFINITE_DISTANCE, NO_HIT
from wrt.kernels.light_choice import make_light_choice
from wrt.kernels.light_shapes import hit_number, spot_factor
from wrt.kernels.light_tree import NO_LIGHT
from wrt.kernels.scene_data import (
    LIGHT_DIRECTIONAL,
    LIGHT_ENVIRONMENT,
    LIGHT_POINT,
    LIGHT_RECTANGLE,
    LIGHT_SPHERE,
    LIGHT_SPOT,
    LIGHT_SUN,
    LIGHT_TRIANGLE,
    LightRecord,
    LightShape,
    SceneData,
    ShapeRecord,
)
from wrt.kernels.solid_angle import (
    cone_pdf,
    disk_cone,
    disk_pdf,
    rectangle_from,
    rectangle_pdf,
    sample_cone,
    sample_disk,
    sample_rectangle,
    sample_sphere,
    sphere_one_minus_cos,
)
from wrt.kernels.surface import Surface, make_add_texture_coordinates
from wrt.kernels.textures import make_slot_value
from wrt.kernels.triangles import Triangle, make_triangle_of
from wrt.kernels.warps import square_to_triangle


@wp.struct
class LightSample:
    """A way to a light.

    `wi` is the unit vector from the surface, `distance` how far the way must be free, `radiance`
    what arrives divided by the probability of this choice: by `pdf` per solid angle for lights
    that have an extent, by the probability of the light alone where `delta`. `point` is where on a triangle
    it begins, or which light shape it is; its triangle is NO_HIT for other lights.
    """

    wi: wp.vec3
    distance: float
    radiance: wp.vec3
    pdf: float
    delta: bool
    point: Hit


# --- Triangles -------------------------------------------------------------------------------------


@wp.func
def triangle_light_pdf(cross_length: float, distance2: float, cos_light: float) -> float:
    """Return the density per solid angle of a point uniform on a triangle of area cross_length / 2."""
    return 2.0 * distance2 / (cross_length * cos_light)


@wp.func
def hit_triangle_pdf(surface: Surface, direction: wp.vec3, distance: float) -> float:
    """Return the density with which a point that was hit, `distance` away, is drawn on its triangle."""
    cos_light = -wp.dot(surface.normal, direction)
    return triangle_light_pdf(wp.length(wp.cross(surface.e1, surface.e2)), distance * distance, cos_light)


_OFF_TRIANGLE = wp.constant(2.0**-17)
_BEFORE_TRIANGLE = wp.constant(1.0 - 2.0**-18)
"""A shadow ray ends so far off a triangle that shines, as a share of the coordinates there, and by this share of its
length before: from near and from afar, more than the error of a hit's distance, or it would meet the triangle."""


@wp.func
def sample_triangle(light: LightRecord, triangle: Triangle, receiver: Receiver, u: wp.vec2) -> LightSample:
    """Return a way to a point uniform on a triangle, and the light's mean radiance."""
    sample = LightSample()
    b = square_to_triangle(u)
    sample.point.triangle = light.triangle
    sample.point.instance = light.instance
    sample.point.u = b[0]
    sample.point.v = b[1]
    normal = wp.cross(triangle.e1, triangle.e2)
    cross_length = wp.length(normal)
    normal = normal / cross_length * triangle.side
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
            sample.pdf = triangle_light_pdf(cross_length, distance2, cos_light)
            sample.radiance = light.value
    return sample


# --- Light shapes ----------------------------------------------------------------------------------

_BEFORE = wp.constant(1.0 - 2.0**-20)
"""A shadow ray ends this share before its light, which itself is left out of it: something may lie just behind."""


@wp.func
def sample_light_shape(scene: SceneData, light: LightRecord, receiver: Receiver, u: wp.vec2) -> LightSample:
    """Return a way to a rectangle, disk, sphere or sun; pdf 0 where it turns its dark side."""
    shape = scene.light_shapes[light.shape]
    sample = LightSample()
    sample.point.triangle = NO_HIT
    if light.kind == LIGHT_SUN:
        sample.wi = sample_cone(shape.normal, shape.size[0], u)
        sample.distance = INFINITE_DISTANCE
        sample.pdf = cone_pdf(shape.size[0])
        sample.radiance = light.value
        return sample
    sample.point.triangle = hit_number(light.shape)
    if light.kind == LIGHT_SPHERE:
        way = sample_sphere(shape.place, shape.size[0], receiver.position, u)
        sample.wi = way.wi
        sample.distance = way.distance * _BEFORE
        sample.pdf = way.pdf
        sample.radiance = light.value
        return sample
    ahead = wp.dot(shape.place - receiver.position, shape.normal)
    if ahead >= 0.0 and light.two_sided == 0:
        return sample
    if light.kind == LIGHT_RECTANGLE:
        r = rectangle_from(shape.place, shape.x, shape.y, shape.size, receiver.position)
        xy = sample_rectangle(r, u)
        way_there = shape.x * xy[0] + shape.y * xy[1] + shape.normal * ahead
        distance = wp.length(way_there)
        if distance > 0.0:
            sample.wi = way_there / distance
            sample.pdf = rectangle_pdf(r, distance)
            sample.distance = distance * _BEFORE
    else:
        way = sample_disk(disk_cone(shape.place, shape.normal, shape.size[0], receiver.position), u)
        sample.wi = way.wi
        sample.pdf = way.pdf
        if way.pdf > 0.0:
            # Towards the rim, rounding may turn a way parallel to the plane: no light there goes beyond its reach.
            reach = wp.length(shape.place - receiver.position) + shape.size[0]
            sample.distance = wp.min(ahead / wp.dot(way.wi, shape.normal), reach) * _BEFORE
            if not (sample.distance > 0.0):
                sample.distance = reach * _BEFORE
    sample.radiance = light.value
    return sample


@wp.func
def light_shape_pdf(shape: LightShape, receiver: Receiver, direction: wp.vec3, distance: float) -> float:
    """Return the density with which `sample_light_shape` draws a direction that meets a light shape."""
    if shape.kind == LIGHT_SUN:
        return cone_pdf(shape.size[0])
    if shape.kind == LIGHT_SPHERE:
        return cone_pdf(sphere_one_minus_cos(shape.place, shape.size[0], receiver.position))
    if shape.kind == LIGHT_RECTANGLE:
        return rectangle_pdf(
            rectangle_from(shape.place, shape.x, shape.y, shape.size, receiver.position),
            distance,
        )
    return disk_pdf(disk_cone(shape.place, shape.normal, shape.size[0], receiver.position), direction)


# --- All of them -----------------------------------------------------------------------------------


class Lights(NamedTuple):
    """Device functions for the lights of scenes with certain features.

    Attributes:
        sample_light: (scene, receiver, u vec4) -> LightSample: chooses a light and a way to it.
        sample_one_light: (scene, number, probability, receiver, u vec2) -> LightSample: a way to
            this light, which was chosen with that probability.
        choice_probability: (scene, receiver, light) -> the probability with which sample_light chooses this light.
        environment_light_pdf: (scene, receiver, point) -> the density with which sample_light draws the direction that
            looks at a point of the environment's image.
        emission_at: (scene, shape record, surface) -> radiance of a triangle's surface, texture coordinates included.
    """

    sample_light: wp.Function
    sample_one_light: wp.Function
    choice_probability: wp.Function
    environment_light_pdf: wp.Function
    emission_at: wp.Function


@functools.cache
def make_lights(features: Features) -> Lights:
    """Return the functions for scenes with these features."""
    textured, extras = features.textured, features.extras
    return _make_lights(
        textured, extras, features.mipmapped, features.light_shapes, features.instances, features.light_tree
    )


@functools.cache
def _make_lights(
    textured: bool, extras: bool, mipmapped: bool, light_shapes: bool, instances: str, light_tree: bool
) -> Lights:
    choose_light, choice_probability = make_light_choice(light_tree)
    triangle_of = make_triangle_of(instances)
    slot_value = make_slot_value(extras, mipmapped)
    add_texture_coordinates = make_add_texture_coordinates(extras)
    parts = ["textured" if textured else "plain", *["shapes"] * light_shapes, instances, *["tree"] * light_tree]
    parts += ["extras"] * extras + ["mipmapped"] * mipmapped
    name = "_".join(parts)

    @wp.func(name=f"emission_at_{name}")
    def emission_at(scene: SceneData, shape: ShapeRecord, surface: Surface) -> wp.vec3:
        if wp.static(textured):
            if shape.emission_slot >= 0:
                return slot_value(scene, shape.emission_slot, surface)
        return shape.emission

    @wp.func(name=f"way_to_light_{name}")
    def way_to_light(scene: SceneData, number: int, receiver: Receiver, u: wp.vec2) -> LightSample:
        light = scene.lights[number]
        sample = LightSample()
        sample.radiance = wp.vec3(0.0)
        sample.point.triangle = NO_HIT
        if light.kind == LIGHT_TRIANGLE:
            triangle = triangle_of(scene, light.triangle, light.instance, receiver.time)
            sample = sample_triangle(light, triangle, receiver, u)
            if wp.static(textured):
                if sample.pdf > 0.0:
                    surface = add_texture_coordinates(scene, sample.point, Surface())
                    shape = scene.shapes[light.shape]
                    sample.radiance = emission_at(scene, shape, surface)
        elif light.kind == LIGHT_POINT or light.kind == LIGHT_SPOT:
            way = light.place - receiver.position
            distance2 = wp.dot(way, way)
            sample.distance = wp.sqrt(distance2)
            sample.delta = True
            if distance2 > 0.0:
                sample.wi = way / sample.distance
                sample.radiance = light.value / distance2
                if wp.static(light_shapes):
                    if light.kind == LIGHT_SPOT:
                        spot = scene.light_shapes[light.shape]
                        sample.radiance *= spot_factor(spot, -wp.dot(sample.wi, spot.normal))
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
        return sample

    @wp.func(name=f"sample_one_light_{name}")
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

    @wp.func(name=f"sample_light_{name}")
    def sample_light(scene: SceneData, receiver: Receiver, u: wp.vec4) -> LightSample:
        choice = choose_light(scene, receiver, u)
        if wp.static(light_tree):
            if choice.light == NO_LIGHT:
                nothing = LightSample()
                nothing.point.triangle = NO_HIT
                return nothing
        return sample_one_light(scene, choice.light, choice.probability, receiver, choice.u)

    @wp.func(name=f"environment_light_pdf_{name}")
    def environment_light_pdf(scene: SceneData, receiver: Receiver, point: ImagePoint) -> float:
        if scene.environment.light < 0:
            return 0.0
        probability = choice_probability(scene, receiver, scene.environment.light)
        return image_pdf(scene.environment, receiver, point) * probability

    return Lights(sample_light, sample_one_light, choice_probability, environment_light_pdf, emission_at)
