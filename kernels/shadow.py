"""How much of a light is seen from a point: shadow rays."""

import functools

import warp as wp

from wrt.kernels.features import Features
from wrt.kernels.geometry import Ray, offset_from_surface
from wrt.kernels.intersect import NO_HIT, closest_hit_before, occluded
from wrt.kernels.materials import transmittance_of
from wrt.kernels.scene_data import SceneData
from wrt.kernels.surface import add_texture_coordinates, surface_at


@functools.cache
def make_visibility(features: Features) -> wp.Function:
    """Return the device function (scene, ray, distance) -> share of light that comes through, 0 to 1."""
    textured = features.textured

    @wp.func
    def through_opacity(scene: SceneData, ray: Ray, distance: float) -> float:
        share = float(1.0)
        rest = Ray()
        rest.origin = ray.origin
        rest.direction = ray.direction
        left = float(distance)
        while share > 0.0:
            hit = closest_hit_before(scene, rest, left)
            if hit.triangle == NO_HIT:
                return share
            surface = surface_at(scene, rest, hit)
            if wp.static(textured):
                surface = add_texture_coordinates(scene, hit, surface)
            share *= transmittance_of(scene, scene.shapes[surface.shape].material, surface)
            rest.origin = offset_from_surface(surface.position, -surface.normal)
            left = distance - wp.dot(rest.origin - ray.origin, ray.direction)
        return 0.0

    @wp.func
    def unblocked(scene: SceneData, ray: Ray, distance: float) -> float:
        return wp.where(occluded(scene, ray, distance), 0.0, 1.0)

    return through_opacity if features.layered else unblocked
