"""Sampling the lights for next-event estimation: choosing one, then a point on it.

The two are separate: `kernels/lights/choice.py` knows no kinds of lights, and `sample_direction` no probability of the
choice.
"""

from typing import NamedTuple

import warp as wp

from wrt.kernels.core.features import Features
from wrt.kernels.core.ray_tree import INFINITE_DISTANCE, NO_HIT
from wrt.kernels.core.rays import Receiver
from wrt.kernels.core.scene_data import (
    LIGHT_DIRECTIONAL,
    LIGHT_ENVIRONMENT,
    LIGHT_POINT,
    LIGHT_TRIANGLE,
    SceneData,
    ShapeRecord,
)
from wrt.kernels.core.specialise import specialised
from wrt.kernels.geometry.surface import Surface, make_add_texture_coordinates
from wrt.kernels.lights.choice import NO_LIGHT, make_light_choice
from wrt.kernels.lights.environment import ImagePoint, image_pdf, radiance_at, sample_image
from wrt.kernels.lights.mesh_lights import make_sample_surface
from wrt.kernels.lights.record import LightSample
from wrt.kernels.lights.shapes import are_textured, make_light_shapes
from wrt.kernels.lights.spot import sample_point
from wrt.kernels.textures.textures import make_slot_color, make_slot_value


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


@specialised("textured", "uv2_alpha", "mipmapped", "light_shapes", "instances", "exact", "light_tree")
def make_lights(features: Features) -> Lights:
    """Return the functions for scenes with these features."""
    textured_lights = features.textured and are_textured(features.light_shapes)
    choose_light, choice_probability = make_light_choice(features.light_tree)
    sample_surface = make_sample_surface(features.geometry)
    sample_light_shape = make_light_shapes(features.light_shapes).sample
    slot_color, slot_value = (
        make_slot_color(features.mipmapped),
        make_slot_value(features.uv2_alpha, features.mipmapped, ()),
    )
    add_texture_coordinates = make_add_texture_coordinates(features.uv2_alpha, features.has_exact)

    @wp.func
    def emission_at(scene: SceneData, shape: ShapeRecord, surface: Surface) -> wp.vec3:
        if wp.static(features.textured):
            if shape.emission_slot >= 0:
                return slot_value(scene, shape.emission_slot, surface)
        return shape.emission

    @wp.func
    def sample_direction(scene: SceneData, number: int, receiver: Receiver, u: wp.vec2) -> LightSample:
        light = scene.lights[number]
        sample = LightSample()
        sample.point.triangle = NO_HIT
        if light.kind == LIGHT_TRIANGLE:
            sample = sample_surface(scene, light, receiver, u)
            if wp.static(features.textured):
                if sample.pdf > 0.0:
                    surface = Surface()
                    if wp.static(features.has_exact):
                        surface.uv = wp.vec2(sample.point.u, sample.point.v)
                    surface = add_texture_coordinates(scene, sample.point, surface)
                    sample.radiance = emission_at(scene, scene.shapes[light.shape], surface)
        elif light.kind == LIGHT_POINT:
            sample = sample_point(light, receiver)
            sample.point.triangle = NO_HIT
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
            if wp.static(bool(features.light_shapes)):
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
        sample = sample_direction(scene, number, receiver, u)
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
        if wp.static(features.light_tree):
            if choice.light == NO_LIGHT:
                sample = LightSample()
                sample.point.triangle = NO_HIT
                return sample
        return sample_one_light(scene, choice.light, choice.probability, receiver, choice.u)

    @wp.func
    def environment_light_pdf(scene: SceneData, receiver: Receiver, point: ImagePoint) -> float:
        if scene.environment.light < 0:
            return 0.0
        probability = choice_probability(scene, receiver, scene.environment.light)
        return image_pdf(scene.environment, receiver, point) * probability

    return Lights(sample_light, sample_one_light, choice_probability, environment_light_pdf, emission_at)
