"""Integrators of your own: a heat map of bounces, ambient occlusion that fades, and a drawing with outlines.

wrt render still-life --integrator toon --with scripts/sketches.py
"""

from dataclasses import dataclass
from typing import Any

import warp as wp

import wrt
from wrt.kernels.integrators.toolbox import (
    BLOCK_BSDF,
    PathResult,
    PathSettings,
    Ray,
    Sampler,
    SceneData,
    Tools,
    make_frame,
    square_to_cosine_hemisphere,
    to_world,
    vertex_block,
)
from wrt.scene.description import Color, Positive


@dataclass(frozen=True)
class HeatMap(wrt.Integrator):
    """How often paths are scattered until they leave: from black by red and yellow to white, after `most` times."""

    most: int = 12

    type_name = "heat-map"

    @staticmethod
    def make_trace(tools: Tools) -> Any:
        """Return the device function."""

        @wp.func
        def trace(
            scene: SceneData,
            ray: Ray,
            footprint: wp.vec2,
            sampler: Sampler,
            settings: PathSettings,
            numbers: tools.Numbers,
        ) -> PathResult:
            next_ray = ray
            bounces = int(0)
            found = tools.first(scene, ray, footprint, sampler)
            while found.vertex.hit.triangle >= 0 and bounces < numbers.most:
                v = found.vertex
                bounces += 1
                u = tools.random(sampler, vertex_block(bounces, BLOCK_BSDF))
                s = tools.sample(v.bsdf, v.wo, wp.vec2(u[0], u[1]), u[2])
                if wp.max(s.weight) <= 0.0:
                    break
                next_ray.direction = wp.normalize(to_world(v.surface.frame, s.wi))
                next_ray.origin = wp.where(s.wi[2] > 0.0, v.origin_in_front, v.origin_behind)
                found = tools.find(scene, next_ray, wp.vec2(0.0), sampler, bounces + 1, wp.vec3(1.0), False)
            heat = 3.0 * float(bounces) / float(numbers.most)
            result = PathResult()
            result.rays = bounces + 1
            result.radiance = wp.vec3(
                wp.clamp(heat, 0.0, 1.0), wp.clamp(heat - 1.0, 0.0, 1.0), wp.clamp(heat - 2.0, 0.0, 1.0)
            )
            return result

        return trace


@dataclass(frozen=True)
class DepthCue(wrt.Integrator):
    """Ambient occlusion by what is within `reach` that fades `into` a colour with the distance, both in metres."""

    reach: Positive = 1.0
    fade: Positive = 10.0
    into: Color = (0.6, 0.7, 0.8)

    type_name = "depth-cue"

    @staticmethod
    def make_trace(tools: Tools) -> Any:
        """Return the device function."""

        @wp.func
        def trace(
            scene: SceneData,
            ray: Ray,
            footprint: wp.vec2,
            sampler: Sampler,
            settings: PathSettings,
            numbers: tools.Numbers,
        ) -> PathResult:
            result = PathResult()
            result.radiance = numbers.into
            found = tools.first(scene, ray, footprint, sampler)
            v = found.vertex
            if v.hit.triangle >= 0:
                u = tools.random(sampler, vertex_block(1, BLOCK_BSDF))
                to_sky = Ray()
                to_sky.origin = v.origin_in_front
                to_sky.direction = to_world(v.surface.frame, square_to_cosine_hemisphere(wp.vec2(u[0], u[1])))
                to_sky.time = ray.time
                clear = wp.exp(-found.distance / numbers.fade)
                result.radiance = numbers.into * (1.0 - clear)
                rises = wp.dot(to_sky.direction, v.surface.normal) > 0.0
                if rises and not tools.occluded(scene, to_sky, numbers.reach):
                    result.radiance += wp.vec3(clear)
            result.rays = 2
            return result

        return trace


@dataclass(frozen=True)
class Toon(wrt.Integrator):
    """Materials in `bands` of the light of a lamp at the eye, with black outlines.

    These are `width` pixels wide, and where the cosine between normals beside each other is less than `bend`.
    """

    bands: int = 3
    width: Positive = 1.0
    bend: float = 0.5

    type_name = "toon"

    @staticmethod
    def make_trace(tools: Tools) -> Any:
        """Return the device function."""

        @wp.func
        def trace(
            scene: SceneData,
            ray: Ray,
            footprint: wp.vec2,
            sampler: Sampler,
            settings: PathSettings,
            numbers: tools.Numbers,
        ) -> PathResult:
            result = PathResult()
            result.rays = 5
            result.radiance = wp.vec3(1.0)
            found = tools.first(scene, ray, footprint, sampler)
            v = found.vertex
            is_there = v.hit.triangle >= 0
            if is_there:
                light = wp.ceil(v.wo[2] * float(numbers.bands)) / float(numbers.bands)
                paint = tools.evaluate(v.bsdf, v.wo, v.wo) * (wp.pi / v.wo[2])
                if wp.max(paint) == 0.0:
                    paint = wp.vec3(0.9)  # glass and mirrors send nothing back
                result.radiance = paint * light
            frame = make_frame(ray.direction)
            beside = ray
            for k in range(4):
                turn = 0.5 * wp.pi * (float(k) + 0.5)
                aside = (frame.s * wp.cos(turn) + frame.t * wp.sin(turn)) * (footprint[1] * numbers.width)
                beside.direction = wp.normalize(ray.direction + aside)
                hit = tools.closest_hit(scene, beside)
                if is_there != (hit.triangle >= 0):
                    result.radiance = wp.vec3(0.0)
                elif is_there:
                    other = tools.surface_at(scene, beside, hit)
                    bend = wp.dot(other.frame.n, v.surface.frame.n)
                    if other.shape != v.surface.shape or bend < numbers.bend:
                        result.radiance = wp.vec3(0.0)
            return result

        return trace


for each in (HeatMap, DepthCue, Toon):
    wrt.register_integrator(each)

if __name__ == "__main__":
    wrt.save_image("toon.png", wrt.render("still-life", integrator=Toon(bands=4), width=512, height=384, spp=16))
