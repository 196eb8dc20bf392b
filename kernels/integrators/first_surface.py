"""What a camera ray sees first, as a path does: behind what lets it pass, with its normal map."""

import warp as wp

from wrt.kernels.accel.bvh import Hit
from wrt.kernels.accel.intersect import NO_HIT, make_intersect
from wrt.kernels.features import Features
from wrt.kernels.geometry.rays import Ray
from wrt.kernels.geometry.surface import Surface, align_tangents, leave, make_add_texture_coordinates, make_surface_at
from wrt.kernels.sampling.sampler import Sampler, make_sample_4d, passed_block
from wrt.kernels.scene.materials import MOST_PASSED, PASSED_THROUGH, make_choose_material, material_of_side
from wrt.kernels.scene.scene_data import SceneData
from wrt.kernels.specialise import specialised
from wrt.kernels.textures.footprint import sample_footprint
from wrt.kernels.textures.normal_maps import apply_normal_map


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


@specialised(
    "sampler",
    "instances",
    "exact",
    "textured",
    "uv2_alpha",
    "mipmapped",
    "opacity",
    "composite",
    "tangents",
)
def make_first_surface(features: Features) -> wp.Function:
    """Return the device function (scene, camera_ray, pixel_footprint, sampler) -> FirstSurface.

    Whether a surface lets the ray pass, and which part of a mixture answers, is decided by the random numbers by which
    a path decides it, so that both see the same.
    """
    sample_4d = make_sample_4d(features.sampler)
    closest_hit = make_intersect(features.geometry).closest_hit
    surface_at = make_surface_at(features.geometry)
    choose_material = make_choose_material(features.uv2_alpha, features.mipmapped)
    add_texture_coordinates = make_add_texture_coordinates(features.uv2_alpha, features.has_exact)
    textured = features.textured
    opacity, sides, mixed = features.opacity, features.composite == "sides", features.mixed
    tangents = features.tangents
    mipmapped = features.mipmapped

    @wp.func
    def first_surface(scene: SceneData, camera_ray: Ray, pixel_footprint: wp.vec2, sampler: Sampler) -> FirstSurface:
        ray = camera_ray
        first = FirstSurface()
        first.distance = 0.0
        first.rays = 0
        first.material = PASSED_THROUGH
        while first.material == PASSED_THROUGH and first.rays <= MOST_PASSED:
            hit = closest_hit(scene, ray)
            first.hit = hit
            first.rays = first.rays + 1
            if hit.triangle == NO_HIT:
                return first
            surface = surface_at(scene, ray, hit)
            if wp.static(textured or tangents):
                surface = add_texture_coordinates(scene, hit, surface)
            if wp.static(mipmapped):
                width = pixel_footprint[0] + pixel_footprint[1] * (first.distance + hit.t)
                surface.footprint = sample_footprint(scene, hit, surface, ray.direction, width, sampler.index)
            first.material = scene.shapes[surface.shape].material
            if wp.static(sides):
                first.material = material_of_side(scene, first.material, surface)
            if wp.static(mixed):
                u = sample_4d(sampler, passed_block(1, first.rays - 1))
                first.material = choose_material(scene, first.material, surface, u[0])
            if wp.static(opacity):
                if first.material == PASSED_THROUGH:
                    beyond = leave(surface, -1.0)
                    first.distance = first.distance + wp.length(beyond - ray.origin)
                    ray.origin = beyond
                    continue
            first.distance = first.distance + hit.t
            if wp.static(tangents):
                width = pixel_footprint[0] + pixel_footprint[1] * first.distance
                surface = align_tangents(scene, hit, surface)
                surface = apply_normal_map(scene, first.material, hit, surface, ray.direction, width)
            first.surface = surface
            return first
        first.hit.triangle = NO_HIT
        return first

    return first_surface
