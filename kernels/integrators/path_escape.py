"""Light that a ray finds where it meets no surface: the environment, suns, and lights that are shapes."""

from typing import NamedTuple

import warp as wp

from wrt.kernels.core.features import Features
from wrt.kernels.core.ray_tree import NO_HIT, Hit
from wrt.kernels.core.rays import Ray, Receiver
from wrt.kernels.core.scene_data import LightShape, SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.core.spmd_marks import inline_stage
from wrt.kernels.integrators.light_groups import GroupSums, add_to_group
from wrt.kernels.integrators.next_event import emitter_hit_weight
from wrt.kernels.integrators.path_state import PathSettings, PathState, pass_hidden_light, sees_no_lights
from wrt.kernels.lights.environment import ImagePoint, point_towards, radiance_at
from wrt.kernels.lights.lights import make_lights
from wrt.kernels.lights.shapes import make_light_model, shape_number


class MetLightWeights(NamedTuple):
    """The weights of light that a path finds without light sampling.

    Attributes:
        image: (scene, receiver, image point, scatter_pdf, strategy) -> float, of an environment's image.
        shape: (scene, light shape, receiver, direction, distance, scatter_pdf, strategy) -> float.
    """

    image: wp.Function
    shape: wp.Function


@specialised("light_shapes", *make_lights.fields)
def make_met_light_weights(features: Features) -> MetLightWeights:
    """Return the weights; a `scatter_pdf` of 0 means that no light was sampled for the direction."""
    lights, model = make_lights(features), make_light_model(features.light_shapes)

    @wp.func
    def image(scene: SceneData, receiver: Receiver, point: ImagePoint, scatter_pdf: float, strategy: int) -> float:
        light_pdf = float(0.0)
        if scatter_pdf > 0.0:
            light_pdf = lights.environment_light_pdf(scene, receiver, point)
        return emitter_hit_weight(strategy, scatter_pdf, light_pdf)

    @wp.func
    def shape(
        scene: SceneData,
        light: LightShape,
        receiver: Receiver,
        direction: wp.vec3,
        distance: float,
        scatter_pdf: float,
        strategy: int,
    ) -> float:
        light_pdf = float(0.0)
        if scatter_pdf > 0.0:
            light_pdf = model.pdf(light, receiver, direction, distance)
            light_pdf *= lights.choice_probability(scene, receiver, light.light)
        return emitter_hit_weight(strategy, scatter_pdf, light_pdf)

    return MetLightWeights(image, shape)


@specialised("environment", *make_met_light_weights.fields)
def make_add_lights_met(features: Features, *, by_group: bool = False) -> wp.Function:
    """Return the device function that adds to a path's radiance the light that its ray finds at no triangle.

    Its arguments are (scene, ray, hit, radiance, throughput, receiver, passed_distance, scatter_pdf, strategy); a
    `scatter_pdf` of 0 means that no light was sampled for that direction. `by_group`, the radiance is GroupSums.
    """
    model, weight_of = make_light_model(features.light_shapes), make_met_light_weights(features)
    Radiance = GroupSums if by_group else wp.vec3

    @wp.func
    def environment_emission(
        scene: SceneData, receiver: Receiver, direction: wp.vec3, scatter_pdf: float, strategy: int
    ) -> wp.vec3:
        if wp.static(features.environment == "image"):
            if scene.environment.width > 0:
                point = point_towards(scene.environment, direction)
                weight = weight_of.image(scene, receiver, point, scatter_pdf, strategy)
                return radiance_at(scene.environment, point.uv) * weight
        return scene.environment.radiance

    @wp.func
    def light_shape_emission(
        scene: SceneData, shape: int, receiver: Receiver, ray: Ray, distance: float, scatter_pdf: float, strategy: int
    ) -> wp.vec3:
        record = scene.light_shapes[shape]
        weight = weight_of.shape(scene, record, receiver, ray.direction, distance, scatter_pdf, strategy)
        return scene.lights[record.light].value * weight

    @wp.func
    def add_lights_met(
        scene: SceneData,
        ray: Ray,
        hit: Hit,
        radiance: Radiance,
        throughput: wp.vec3,
        receiver: Receiver,
        passed_distance: float,
        scatter_pdf: float,
        strategy: int,
    ) -> Radiance:
        total = radiance
        if hit.triangle == NO_HIT:
            if wp.static(features.environment != "none"):
                emission = environment_emission(scene, receiver, ray.direction, scatter_pdf, strategy)
                if wp.static(by_group):
                    total = add_to_group(scene, total, scene.lights.shape[0], wp.cw_mul(throughput, emission))
                else:
                    total += wp.cw_mul(throughput, emission)
            if wp.static(bool(features.light_shapes)):
                for i in range(scene.solid_light_shapes, scene.sun_light_shapes):
                    if model.covers(scene.light_shapes[i], ray.direction):
                        sun = light_shape_emission(scene, i, receiver, ray, 0.0, scatter_pdf, strategy)
                        if wp.static(by_group):
                            light_number = scene.light_shapes[i].light
                            total = add_to_group(scene, total, light_number, wp.cw_mul(throughput, sun))
                        else:
                            total += wp.cw_mul(throughput, sun)
        elif wp.static(bool(features.light_shapes)):
            number = shape_number(hit)
            shape = scene.light_shapes[number]
            if model.shines_back(scene.lights[shape.light], shape, ray):
                distance = passed_distance + hit.t
                light = light_shape_emission(scene, number, receiver, ray, distance, scatter_pdf, strategy)
                if wp.static(by_group):
                    total = add_to_group(scene, total, shape.light, wp.cw_mul(throughput, light))
                else:
                    total += wp.cw_mul(throughput, light)
        return total

    return add_lights_met


@specialised(*make_add_lights_met.fields, "light_groups")
def make_escape(features: Features) -> wp.Function:
    """Return the stage (scene, path, hit, settings) -> PathState for a hit that is no triangle.

    The path is done, unless it goes on behind a light that is hidden from the camera.
    """
    add_lights_met = make_add_lights_met(features)
    add_groups_met = make_add_lights_met(features, by_group=features.light_groups)

    @wp.func
    @inline_stage
    def escape(scene: SceneData, path: PathState, hit: Hit, settings: PathSettings) -> PathState:
        path.is_done = True
        if sees_no_lights(path, settings):
            if wp.static(bool(features.light_shapes)):
                if hit.triangle != NO_HIT:
                    path = pass_hidden_light(path, hit)
        else:
            path.radiance = add_lights_met(
                scene,
                path.ray,
                hit,
                path.radiance,
                path.throughput,
                path.receiver,
                path.passed_distance,
                path.scatter_pdf,
                settings.strategy,
            )
            if wp.static(features.light_groups):
                path.groups = add_groups_met(
                    scene,
                    path.ray,
                    hit,
                    path.groups,
                    path.throughput,
                    path.receiver,
                    path.passed_distance,
                    path.scatter_pdf,
                    settings.strategy,
                )
        return path

    return escape
