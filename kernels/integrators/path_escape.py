"""The stage in which a path ends because its ray meets no surface: environment, suns, lights that are shapes."""

import warp as wp

from wrt.kernels.core.features import Features
from wrt.kernels.core.ray_tree import NO_HIT, Hit
from wrt.kernels.core.rays import Ray, Receiver
from wrt.kernels.core.scene_data import SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.core.spmd_marks import inline_stage
from wrt.kernels.integrators.next_event import emitter_hit_weight
from wrt.kernels.integrators.path_state import PathSettings, PathState, pass_hidden_light, sees_no_lights
from wrt.kernels.lights.environment import point_towards, radiance_at
from wrt.kernels.lights.lights import make_lights
from wrt.kernels.lights.shapes import make_light_shapes, shape_number


@specialised("environment", *make_lights.fields)
def make_environment_emission(features: Features) -> wp.Function:
    """Return (scene, receiver, direction, scatter_pdf, strategy) -> vec3, the environment's radiance by its weight."""
    image_environment = features.environment == "image"
    environment_light_pdf = make_lights(features).environment_light_pdf

    @wp.func
    def environment_emission(
        scene: SceneData, receiver: Receiver, direction: wp.vec3, scatter_pdf: float, strategy: int
    ) -> wp.vec3:
        if wp.static(image_environment):
            if scene.environment.width > 0:
                point = point_towards(scene.environment, direction)
                light_pdf = float(0.0)
                if scatter_pdf > 0.0:
                    light_pdf = environment_light_pdf(scene, receiver, point)
                return radiance_at(scene.environment, point.uv) * emitter_hit_weight(strategy, scatter_pdf, light_pdf)
        return scene.environment.radiance

    return environment_emission


@specialised("light_shapes", *make_lights.fields)
def make_light_shape_emission(features: Features) -> wp.Function:
    """Return (scene, shape, receiver, ray, distance, scatter_pdf, strategy) -> vec3, the same of a light shape."""
    light_shape_pdf = make_light_shapes(features.light_shapes).pdf
    choice_probability = make_lights(features).choice_probability

    @wp.func
    def light_shape_emission(
        scene: SceneData, shape: int, receiver: Receiver, ray: Ray, distance: float, scatter_pdf: float, strategy: int
    ) -> wp.vec3:
        record = scene.light_shapes[shape]
        light_pdf = float(0.0)
        if scatter_pdf > 0.0:
            light_pdf = light_shape_pdf(record, receiver, ray.direction, distance)
            light_pdf *= choice_probability(scene, receiver, record.light)
        return scene.lights[record.light].value * emitter_hit_weight(strategy, scatter_pdf, light_pdf)

    return light_shape_emission


@specialised(*make_environment_emission.fields, *make_light_shape_emission.fields)
def make_escape(features: Features) -> wp.Function:
    """Return the stage (scene, path, hit, settings) -> PathState for a hit that is no triangle.

    The path is done, unless it goes on behind a light that is hidden from the camera.
    """
    has_environment = features.environment != "none"
    has_light_shapes = bool(features.light_shapes)
    shapes = make_light_shapes(features.light_shapes)
    shines_back, sun_covers = shapes.shines_back, shapes.covers
    environment_emission = make_environment_emission(features)
    light_shape_emission = make_light_shape_emission(features)

    @wp.func
    @inline_stage
    def escape(scene: SceneData, path: PathState, hit: Hit, settings: PathSettings) -> PathState:
        ray = path.ray
        strategy = settings.strategy
        path.is_done = True
        if sees_no_lights(path, settings):
            if wp.static(has_light_shapes):
                if hit.triangle != NO_HIT:
                    path = pass_hidden_light(path, hit)
        elif hit.triangle == NO_HIT:
            if wp.static(has_environment):
                radiance = environment_emission(scene, path.receiver, ray.direction, path.scatter_pdf, strategy)
                path.radiance += wp.cw_mul(path.throughput, radiance)
            if wp.static(has_light_shapes):
                for i in range(scene.solid_light_shapes, scene.sun_light_shapes):
                    if sun_covers(scene.light_shapes[i], ray.direction):
                        sun = light_shape_emission(scene, i, path.receiver, ray, 0.0, path.scatter_pdf, strategy)
                        path.radiance += wp.cw_mul(path.throughput, sun)
        elif wp.static(has_light_shapes):
            number = shape_number(hit)
            if shines_back(scene, scene.light_shapes[number], ray):
                distance = path.passed_distance + hit.t
                light = light_shape_emission(scene, number, path.receiver, ray, distance, path.scatter_pdf, strategy)
                path.radiance += wp.cw_mul(path.throughput, light)
        return path

    return escape
