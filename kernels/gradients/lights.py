"""Derivatives by what lights emit: where a path meets them, and where it samples them.

Each contribution is linear in one light's value, or in the texels around one point.
"""

from typing import NamedTuple

import warp as wp

from wrt.kernels.core.features import Features
from wrt.kernels.core.ray_tree import NO_HIT, Hit
from wrt.kernels.core.rays import Ray, Receiver
from wrt.kernels.core.scene_data import (
    LIGHT_ENVIRONMENT,
    LIGHT_TRIANGLE,
    WRAP_CLAMP,
    WRAP_REPEAT,
    EnvironmentData,
    SceneData,
)
from wrt.kernels.core.specialise import specialised
from wrt.kernels.geometry.surface import Surface, make_add_texture_coordinates
from wrt.kernels.gradients.sums import GradientSums, add_color
from wrt.kernels.gradients.values import add_bilinear, make_add_to_slot
from wrt.kernels.integrators.path_escape import make_met_light_weights
from wrt.kernels.lights.choice import NO_LIGHT, make_light_choice
from wrt.kernels.lights.environment import point_towards
from wrt.kernels.lights.record import LightSample
from wrt.kernels.lights.shapes import are_textured, make_light_model, shape_number
from wrt.kernels.sampling.warps import PI, TWO_PI
from wrt.kernels.textures.textures import bilinear, make_slot_color, neighbors


@wp.func
def add_to_environment_texels(sums: GradientSums, scene: SceneData, direction: wp.vec3, gradient: wp.vec3):
    """Add to the four texels around a direction; the adjoint of `radiance_at` in `kernels/lights/environment.py`."""
    environment = scene.environment
    uv = point_towards(environment, direction).uv
    x = uv[0] * float(environment.width) - 0.5
    y = uv[1] * float(environment.height) - 0.5
    column = wp.floor(x)
    row = wp.floor(y)
    columns = neighbors(int(column), environment.width, WRAP_REPEAT)
    rows = neighbors(int(row), environment.height, WRAP_CLAMP)
    share = wp.vec2(x - column, y - row)
    add_bilinear(sums.environment_texels, 0, environment.width, columns, rows, share, gradient)


@wp.func
def environment_change(environment: EnvironmentData, direction: wp.vec3, change: wp.vec3) -> wp.vec3:
    """Return the derivative of the radiance in a direction by what `change` is the derivative of the direction by."""
    local = environment.rotation * direction
    turn = environment.rotation * change
    point = point_towards(environment, direction)
    sine = wp.max(point.sine, 1.0e-6)
    by_sine = (local[0] * turn[0] + local[2] * turn[2]) / sine
    u = (local[0] * turn[2] - local[2] * turn[0]) / (sine * sine * TWO_PI)
    v = (local[1] * by_sine - sine * turn[1]) / PI
    x = point.uv[0] * float(environment.width) - 0.5
    y = point.uv[1] * float(environment.height) - 0.5
    column = wp.floor(x)
    row = wp.floor(y)
    columns = neighbors(int(column), environment.width, WRAP_REPEAT)
    rows = neighbors(int(row), environment.height, WRAP_CLAMP)
    found = wp.vec3(0.0)
    for k in range(2):
        # The interpolation is linear along each axis, so differences of its ends are exact.
        end = float(k)
        sign = 2.0 * end - 1.0
        across = bilinear(environment.texels, 0, environment.width, columns, rows, wp.vec2(end, y - row))
        down = bilinear(environment.texels, 0, environment.width, columns, rows, wp.vec2(x - column, end))
        found += across * (sign * u * float(environment.width)) + down * (sign * v * float(environment.height))
    return found


class LightGradients(NamedTuple):
    """Functions that add to `sums`; `gradient` is the derivative of the loss by the radiance of the light.

    Attributes:
        escaped: (sums, scene, ray, hit, upstream, receiver, passed_distance, scatter_pdf, strategy), where the ray of a
            path meets no triangle; `upstream` is times the throughput.
        emitted: (sums, scene, surface, gradient), where a ray meets a triangle.
        sampled: (sums, scene, receiver, u_light, sample, gradient), by what a vertex receives from a sampled light.
    """

    escaped: wp.Function
    emitted: wp.Function
    sampled: wp.Function


@specialised("environment", "single_sided", *make_met_light_weights.fields)
def make_light_gradients(features: Features) -> LightGradients:
    """Return the functions for scenes with these features."""
    weight_of, model = make_met_light_weights(features), make_light_model(features.light_shapes)
    add_to_slot = make_add_to_slot(features)
    choose_light, slot_color = make_light_choice(features.light_tree).choose_light, make_slot_color(features.mipmapped)
    add_texture_coordinates = make_add_texture_coordinates(features.uv2_alpha, features.has_exact)
    textured_lights = features.textured and are_textured(features.light_shapes)

    @wp.func
    def escaped(
        sums: GradientSums,
        scene: SceneData,
        ray: Ray,
        hit: Hit,
        gradient: wp.vec3,
        receiver: Receiver,
        passed_distance: float,
        scatter_pdf: float,
        strategy: int,
    ):
        direction = ray.direction
        if hit.triangle == NO_HIT:
            if wp.static(features.environment == "image"):
                if scene.environment.width > 0:
                    point = point_towards(scene.environment, direction)
                    weight = weight_of.image(scene, receiver, point, scatter_pdf, strategy)
                    add_to_environment_texels(sums, scene, direction, gradient * weight)
                else:
                    add_color(sums.environment, 0, gradient)
            elif wp.static(features.environment == "constant"):
                add_color(sums.environment, 0, gradient)
            if wp.static(bool(features.light_shapes)):
                for i in range(scene.solid_light_shapes, scene.sun_light_shapes):
                    sun = scene.light_shapes[i]
                    if model.covers(sun, direction):
                        weight = weight_of.shape(scene, sun, receiver, direction, 0.0, scatter_pdf, strategy)
                        add_color(sums.lights, sun.light, gradient * weight)
        elif wp.static(bool(features.light_shapes)):
            shape = scene.light_shapes[shape_number(hit)]
            if model.shines_back(scene.lights[shape.light], shape, ray):
                distance = passed_distance + hit.t
                weight = weight_of.shape(scene, shape, receiver, direction, distance, scatter_pdf, strategy)
                add_color(sums.lights, shape.light, gradient * weight)

    @wp.func
    def add_to_surface(sums: GradientSums, scene: SceneData, number: int, surface: Surface, gradient: wp.vec3):
        slot = scene.shapes[number].emission_slot
        if wp.static(features.textured):
            if slot >= 0:
                add_to_slot(sums, scene, slot, surface, gradient)
                return
        add_color(sums.emission, number, gradient)

    @wp.func
    def emitted(sums: GradientSums, scene: SceneData, surface: Surface, gradient: wp.vec3):
        add_to_surface(sums, scene, surface.shape, surface, gradient)

    @wp.func
    def sampled(
        sums: GradientSums,
        scene: SceneData,
        receiver: Receiver,
        u_light: wp.vec4,
        sample: LightSample,
        gradient: wp.vec3,
    ):
        number = choose_light(scene, receiver, u_light).light
        if number != NO_LIGHT:
            record = scene.lights[number]
            if record.kind == LIGHT_TRIANGLE:
                surface = Surface()
                if wp.static(features.textured):
                    if wp.static(features.has_exact):
                        surface.uv = wp.vec2(sample.point.u, sample.point.v)
                    surface = add_texture_coordinates(scene, sample.point, surface)
                add_to_surface(sums, scene, record.shape, surface, gradient / sample.pdf)
            elif record.kind == LIGHT_ENVIRONMENT:
                add_to_environment_texels(sums, scene, sample.wi, gradient / sample.pdf)
            else:
                texel = wp.vec3(1.0)
                slot = int(-1)
                surface = Surface()
                if wp.static(textured_lights):
                    slot = scene.light_shapes[record.shape].slot
                    if slot >= 0:
                        surface.uv = wp.vec2(sample.point.u, sample.point.v)
                        surface.color = wp.vec3(1.0)
                        texel = slot_color(scene, scene.slots[slot], surface.uv, wp.vec4(), wp.vec3(1.0))
                # The radiance of a sample is the light's value times the texel times a number.
                value = wp.cw_mul(record.value, texel)
                factor = float(0.0)
                if wp.max(value) > 0.0:
                    factor = wp.max(sample.radiance) / wp.max(value)
                if not sample.delta:
                    factor = 1.0 / sample.pdf
                add_color(sums.lights, number, wp.cw_mul(gradient, texel) * factor)
                if wp.static(textured_lights):
                    if slot >= 0:
                        add_to_slot(sums, scene, slot, surface, wp.cw_mul(gradient, record.value) * factor)

    return LightGradients(escaped, emitted, sampled)
