"""What a camera ray sees first, as a path does: behind what lets it pass, with its normal map.

The guides of a denoiser follow the ray further, in mirrors and through glass. Smooth surfaces have no texture of their
own. A denoiser keeps the edges that albedo and normals show, so these must be those of what is seen in the surface
(Open Image Denoise, documentation, "Albedos" and "Normals").
"""

import warp as wp

from wrt.kernels.accel.intersect import make_intersect
from wrt.kernels.bsdf import make_bsdf, make_receives_light
from wrt.kernels.core.features import Features
from wrt.kernels.core.ray_tree import NO_HIT, Hit
from wrt.kernels.core.rays import Ray, to_local, to_world
from wrt.kernels.core.scene_data import SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.geometry.surface import (
    Surface,
    align_tangents,
    leave,
    leave_in_front,
    make_add_texture_coordinates,
    make_surface_at,
)
from wrt.kernels.integrators.sides import make_hit_shown
from wrt.kernels.materials.choice import MOST_PASSED, PASSED_THROUGH, make_choose_material, material_of_side
from wrt.kernels.materials.values import disperses, make_bsdf_at, make_with_throughput
from wrt.kernels.sampling.sampler import BLOCK_BSDF, Sampler, make_sample_4d, passed_block, vertex_block
from wrt.kernels.textures.footprint import sample_footprint
from wrt.kernels.textures.normal_maps import apply_normal_map
from wrt.kernels.textures.textures import VALUES


@wp.struct
class FirstSurface:
    """The first surface on a camera ray; `hit.triangle` is NO_HIT where there is none.

    `distance` is from the ray's origin, `rays` how many it took.
    """

    hit: Hit
    surface: Surface
    material: int
    distance: float
    rays: int


@specialised(*("sampler", "instances", "exact", *VALUES, "composite", "tangents", "single_sided"))
def make_first_surface(features: Features) -> wp.Function:
    """Return the device function (scene, camera_ray, pixel_footprint, sampler) -> FirstSurface.

    The random numbers of a path decide whether a surface lets the ray pass, and which part of a mixture it meets, so
    that both see the same.
    """
    sample_4d = make_sample_4d(features.sampler)
    closest_hit, surface_at = make_intersect(features.geometry).closest_hit, make_surface_at(features.geometry)
    hit_shown = make_hit_shown(features.geometry)
    choose_material = make_choose_material(features.uv2_alpha, features.mipmapped, features.procedures)
    add_texture_coordinates = make_add_texture_coordinates(features.uv2_alpha, features.has_exact)

    @wp.func
    def first_surface(scene: SceneData, camera_ray: Ray, pixel_footprint: wp.vec2, sampler: Sampler) -> FirstSurface:
        ray = camera_ray
        first = FirstSurface()
        first.material = PASSED_THROUGH
        while first.material == PASSED_THROUGH and first.rays <= MOST_PASSED:
            hit = closest_hit(scene, ray)
            if wp.static(features.single_sided):
                hit = hit_shown(scene, ray, hit, True)
            first.hit = hit
            first.rays = first.rays + 1
            if hit.triangle == NO_HIT:
                return first
            surface = surface_at(scene, ray, hit)
            if wp.static(features.textured or features.tangents):
                surface = add_texture_coordinates(scene, hit, surface)
            if wp.static(features.mipmapped):
                width = pixel_footprint[0] + pixel_footprint[1] * (first.distance + hit.t)
                surface.footprint = sample_footprint(scene, hit, surface, ray.direction, width, sampler.index)
            first.material = scene.shapes[surface.shape].material
            if wp.static(features.composite == "sides"):
                first.material = material_of_side(scene, first.material, surface)
            if wp.static(features.mixed):
                u = sample_4d(sampler, passed_block(1, first.rays - 1))
                first.material = choose_material(scene, first.material, surface, u[0])
            if wp.static(features.has_holes):
                if first.material == PASSED_THROUGH:
                    beyond = leave(surface, -1.0)
                    first.distance = first.distance + wp.length(beyond - ray.origin)
                    ray.origin = beyond
                    continue
            first.distance = first.distance + hit.t
            if wp.static(features.tangents):
                width = pixel_footprint[0] + pixel_footprint[1] * first.distance
                surface = align_tangents(scene, hit, surface)
                surface = apply_normal_map(scene, first.material, hit, surface, ray.direction, width)
            first.surface = surface
            return first
        first.hit.triangle = NO_HIT
        return first

    return first_surface


MOST_BOUNCES = wp.constant(8)
"""Smooth surfaces on a camera ray; what is behind more of them counts as nothing."""


@wp.struct
class SpecularChain:
    """The first surface that is not smooth, from which direction it is seen, and how the smooth ones colour it."""

    first: FirstSurface
    direction: wp.vec3
    tint: wp.vec3


@specialised(*make_first_surface.fields, "models", *make_bsdf_at.fields)
def make_follow_specular(features: Features) -> wp.Function:
    """Return the device function (scene, first, camera_ray, sampler) -> SpecularChain; `first` is on the camera ray.

    At each smooth surface one direction is chosen at random, as by a path.
    """
    first_surface, sample_4d = make_first_surface(features), make_sample_4d(features.sampler)
    bsdf_at, bsdf_sample = make_bsdf_at(features), make_bsdf(features.models).sample
    receives_light, with_throughput = make_receives_light(features.models), make_with_throughput(features.models)

    @wp.func
    def follow_specular(scene: SceneData, begin: FirstSurface, camera_ray: Ray, sampler: Sampler) -> SpecularChain:
        chain = SpecularChain()
        chain.first = begin
        chain.direction = camera_ray.direction
        origin = camera_ray.origin
        chain.tint = wp.vec3(1.0)
        rays = int(begin.rays)
        bounces = int(0)
        following = bool(True)
        while following:
            following = False
            if chain.first.hit.triangle != NO_HIT:
                surface = chain.first.surface
                bsdf = bsdf_at(scene, chain.first.material, surface)
                if wp.static(disperses(features.models)):
                    bsdf = with_throughput(bsdf, chain.tint)
                if not receives_light(bsdf):
                    u = sample_4d(sampler, vertex_block(bounces + 1, BLOCK_BSDF))
                    s = bsdf_sample(bsdf, to_local(surface.frame, -chain.direction), wp.vec2(u[0], u[1]), u[2])
                    bounces += 1
                    chain.tint = wp.cw_mul(chain.tint, s.weight * (s.eta * s.eta))
                    following = bounces <= MOST_BOUNCES and wp.max(chain.tint) > 0.0
                    chain.first.hit.triangle = NO_HIT
                    if following:
                        ray = Ray()
                        ray.origin = leave(surface, -1.0)
                        if s.wi[2] > 0.0:
                            ray.origin = leave_in_front(surface, origin, chain.direction)
                        ray.direction = wp.normalize(to_world(surface.frame, s.wi))
                        ray.time = camera_ray.time
                        chain.direction = ray.direction
                        origin = ray.origin
                        chain.first = first_surface(scene, ray, wp.vec2(0.0), sampler)
                        rays += chain.first.rays
        chain.first.rays = rays
        return chain

    return follow_specular
