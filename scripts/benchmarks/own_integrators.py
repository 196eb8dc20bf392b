"""Integrators as a user writes them: a copy of `ao`, and a path tracer."""

from dataclasses import dataclass
from typing import Any, ClassVar

import warp as wp

import wrt
from wrt.kernels.integrators.toolbox import (
    BLOCK_BSDF,
    BLOCK_LIGHT,
    INFINITE_DISTANCE,
    RECEIVES_FRONT,
    PathResult,
    PathSettings,
    Ray,
    Receiver,
    Sampler,
    SceneData,
    Tools,
    nowhere,
    square_to_cosine_hemisphere,
    to_local,
    to_world,
    vertex_block,
)


@dataclass(frozen=True)
class OwnOcclusion(wrt.Integrator):
    """A copy of the integrator `ao`, with its distance as a number of its own."""

    reach: float = INFINITE_DISTANCE

    type_name: ClassVar[str] = "own-ao"

    @staticmethod
    def make_trace(tools: Tools) -> Any:
        """Return the device function, which does what `kernels/integrators/ambient_occlusion.py` does."""

        @wp.func
        def trace(
            scene: SceneData,
            camera_ray: Ray,
            footprint: wp.vec2,
            sampler: Sampler,
            settings: PathSettings,
            numbers: tools.Numbers,
        ) -> PathResult:
            found = tools.first(scene, camera_ray, footprint, sampler)
            v = found.vertex
            result = PathResult()
            result.rays = found.rays
            result.radiance = wp.vec3(1.0)
            if v.hit.triangle < 0:
                if settings.hides_lights != 0:
                    result.radiance = wp.vec3(0.0)
                return result
            result.radiance = wp.vec3(0.0)
            u = tools.random(sampler, vertex_block(1, BLOCK_BSDF))
            ray = Ray()
            ray.direction = to_world(v.surface.frame, square_to_cosine_hemisphere(wp.vec2(u[0], u[1])))
            if wp.dot(ray.direction, v.surface.normal) > 0.0:
                ray.origin = v.origin_in_front
                ray.time = camera_ray.time
                result.radiance = tools.visibility(scene, ray, numbers.reach, nowhere(), u)
                result.rays = result.rays + 1
            return result

        return trace


@dataclass(frozen=True)
class PlainPaths(wrt.Integrator):
    """Paths with next-event estimation, weighted by the power heuristic, without roulette."""

    type_name: ClassVar[str] = "plain-paths"

    @staticmethod
    def make_trace(tools: Tools) -> Any:
        """Return the device function."""

        @wp.func
        def trace(
            scene: SceneData,
            camera_ray: Ray,
            footprint: wp.vec2,
            sampler: Sampler,
            settings: PathSettings,
            numbers: tools.Numbers,
        ) -> PathResult:
            result = PathResult()
            ray = camera_ray
            cone = footprint
            throughput = wp.vec3(1.0)
            receiver = Receiver()
            receiver.time = ray.time
            pdf = float(0.0)
            number = int(1)
            while number <= settings.max_depth:
                found = tools.find(scene, ray, cone, sampler, number, throughput, number == 1)
                found = tools.meet_lights(scene, ray, found)
                result.rays += found.rays
                emission = tools.emission(scene, ray, found, receiver, pdf, settings)
                result.radiance += wp.cw_mul(throughput, emission)
                v = found.vertex
                if v.hit.triangle < 0 or number == settings.max_depth:
                    break
                u_light = tools.random(sampler, vertex_block(number, BLOCK_LIGHT))
                receiver.position = v.origin_in_front
                receiver.normal = v.surface.frame.n
                receiver.receives = RECEIVES_FRONT
                light = tools.sample_light(scene, receiver, u_light)
                wi = to_local(v.surface.frame, light.wi)
                if wi[2] > 0.0 and wp.dot(light.wi, v.surface.normal) > 0.0:
                    arriving = wp.cw_mul(tools.evaluate(v.bsdf, v.wo, wi), light.radiance)
                    arriving = arriving * tools.light_weight(light, tools.pdf(v.bsdf, v.wo, wi), settings)
                    if wp.max(arriving) > 0.0:
                        shadow_ray = Ray()
                        shadow_ray.origin = v.origin_in_front
                        shadow_ray.direction = light.wi
                        shadow_ray.time = ray.time
                        share = tools.visibility(scene, shadow_ray, light.distance, light.point, u_light)
                        result.rays += 1
                        result.radiance += wp.cw_mul(throughput, wp.cw_mul(arriving, share))
                u = tools.random(sampler, vertex_block(number, BLOCK_BSDF))
                s = tools.sample(v.bsdf, v.wo, wp.vec2(u[0], u[1]), u[2])
                throughput = wp.cw_mul(throughput, s.weight)
                direction = to_world(v.surface.frame, s.wi)
                if wp.max(throughput) <= 0.0 or wp.dot(direction, v.surface.normal) * s.wi[2] <= 0.0:
                    break
                ray.direction = wp.normalize(direction)
                ray.origin = wp.where(s.wi[2] > 0.0, v.origin_in_front, v.origin_behind)
                cone = wp.vec2(0.0)
                pdf = s.pdf
                number += 1
            return result

        return trace
