"""Sampling the lights for next-event estimation."""

import functools

import warp as wp

from wrt.kernels.bvh import Hit
from wrt.kernels.environment import image_radiance, sample_image
from wrt.kernels.intersect import INFINITE_DISTANCE, NO_HIT
from wrt.kernels.scene_data import (
    LIGHT_DIRECTIONAL,
    LIGHT_ENVIRONMENT,
    LIGHT_POINT,
    LIGHT_TRIANGLE,
    LightRecord,
    SceneData,
)
from wrt.kernels.triangles import Triangle, leave_surface, make_triangle_of
from wrt.kernels.warps import sample_alias, square_to_triangle


@wp.struct
class LightSample:
    """A way to a light.

    `wi` is the unit vector from the surface, `distance` how far the way must be free, `radiance`
    what arrives divided by the probability of this choice: by `pdf` per solid angle for lights
    that have an extent, by the probability of the light alone where `delta`. `point` is where on a triangle
    it begins; its triangle is NO_HIT for other lights.
    """

    wi: wp.vec3
    distance: float
    radiance: wp.vec3
    pdf: float
    delta: bool
    point: Hit


@wp.func
def triangle_light_pdf(probability: float, cross_length: float, distance2: float, cos_light: float) -> float:
    """Return the density per solid angle of a point uniform on a triangle of area cross_length / 2."""
    return probability * 2.0 * distance2 / (cross_length * cos_light)


@wp.func
def sample_triangle_light(light: LightRecord, triangle: Triangle, position: wp.vec3, u: wp.vec2) -> LightSample:
    """Return a way from `position` to a point of a triangle that shines."""
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
    cos_light = wp.dot(normal, position - point)
    if cos_light < 0.0 and light.two_sided != 0:
        cos_light = -cos_light
        normal = -normal
    if cos_light > 0.0:
        way = leave_surface(point, normal, triangle.slack) - position
        distance2 = wp.dot(way, way)
        sample.distance = wp.sqrt(distance2)
        sample.wi = way / sample.distance
        cos_light = -wp.dot(sample.wi, normal)
        if cos_light > 0.0:
            sample.pdf = triangle_light_pdf(light.probability, cross_length, distance2, cos_light)
            sample.radiance = light.value / sample.pdf
    return sample


@functools.cache
def make_sample_one_light(instances: str) -> wp.Function:
    """Return the device function (scene, number, position, time, u, u_environment) -> LightSample.

    It is a way from `position` to a point of the light `number`, which was chosen with its own probability.
    """
    triangle_of = make_triangle_of(instances)

    @wp.func(name=f"sample_one_light_{instances}")
    def sample_one_light(
        scene: SceneData, number: int, position: wp.vec3, time: float, u: wp.vec2, u_environment: wp.vec4
    ) -> LightSample:
        light = scene.lights[number]
        if light.kind == LIGHT_TRIANGLE:
            triangle = triangle_of(scene, light.triangle, light.instance, time)
            return sample_triangle_light(light, triangle, position, u)
        sample = LightSample()
        sample.point.triangle = NO_HIT
        if light.kind == LIGHT_POINT:
            way = light.place - position
            distance2 = wp.dot(way, way)
            sample.distance = wp.sqrt(distance2)
            sample.delta = True
            if distance2 > 0.0:
                sample.wi = way / sample.distance
                sample.radiance = light.value / (distance2 * light.probability)
        elif light.kind == LIGHT_DIRECTIONAL:
            sample.wi = light.place
            sample.distance = INFINITE_DISTANCE
            sample.delta = True
            sample.radiance = light.value / light.probability
        elif light.kind == LIGHT_ENVIRONMENT:
            s = sample_image(scene.environment, u_environment)
            sample.wi = s.wi
            sample.distance = INFINITE_DISTANCE
            sample.pdf = s.pdf * light.probability
            if sample.pdf > 0.0:
                sample.radiance = image_radiance(scene.environment, s.wi) / sample.pdf
        return sample

    return sample_one_light


@functools.cache
def make_sample_light(instances: str) -> wp.Function:
    """Return the device function (scene, position, time, u, u_environment) -> LightSample; `instances` as in Features.

    It is a way from `position` to a light; its radiance is zero where nothing arrives. u[2] chooses the light, and what
    it leaves is the first coordinate of the point on it: so the points on a light of two triangles are as evenly spread
    as the pair u[2], u[3] is. u[0] has further digits of u[2].
    """
    sample_one_light = make_sample_one_light(instances)

    @wp.func(name=f"sample_light_{instances}")
    def sample_light(
        scene: SceneData, position: wp.vec3, time: float, u: wp.vec4, u_environment: wp.vec4
    ) -> LightSample:
        choice = sample_alias(scene.light_thresholds, scene.light_aliases, u[2], u[0])
        return sample_one_light(scene, choice.index, position, time, wp.vec2(choice.rest, u[3]), u_environment)

    return sample_light
