"""The surface of a medium so near to a point inside that a ray from there would miss it.

A ray overlooks what is nearer than the error of its distance (`kernels/simd.py`), which for large triangles may be a
good part of a dense medium's mean free path. A path that is scattered there would leave without noticing. But it came
from that surface, or was on its way to it; so it is remembered, and met even where the ray misses it.
"""

import functools

import warp as wp

from wrt.kernels.bvh import Hit
from wrt.kernels.geometry import Ray
from wrt.kernels.intersect import NO_HIT
from wrt.kernels.scene_data import SceneData
from wrt.kernels.surface import make_surface_at

RELATIVE_ERROR = wp.constant(1.0e-5)
"""Of a hit's distance, over the size of the triangle and of coordinates: some times what it can be."""

_FARTHEST = wp.constant(20.0)


@wp.struct
class Skin:
    """A surface near a point in a medium, as a plane with its normal outwards; `hit` is NO_HIT where none is near.

    `error` is how near it must be to be missed.
    """

    hit: Hit
    point: wp.vec3
    normal: wp.vec3
    error: float


@wp.func
def no_skin() -> Skin:
    """Return that no surface is near."""
    skin = Skin()
    skin.hit.triangle = NO_HIT
    return skin


@functools.cache
def make_skin_near(instances: str) -> wp.Function:
    """Return the device function (scene, ray, distance, ahead, behind) -> Skin of the point so far along a ray.

    `ahead` is what the ray would have met and `behind` what it has left, or NO_HIT; `instances` as in Features.
    """
    surface_at = make_surface_at(instances)

    @wp.func(name=f"skin_near_{instances}")
    def skin_near(scene: SceneData, ray: Ray, distance: float, ahead: Hit, behind: Hit) -> Skin:
        skin = no_skin()
        hit = ahead
        if behind.triangle >= 0 and (ahead.triangle < 0 or distance < ahead.t - distance):
            hit = behind
        if hit.triangle < 0:
            return skin
        surface = surface_at(scene, ray, hit)
        # Seen along the ray a surface's normal faces back: outwards behind, inwards ahead.
        skin.normal = -surface.normal
        if hit.triangle == behind.triangle and hit.t == behind.t:
            skin.normal = surface.normal
        skin.point = surface.position
        size = wp.max(wp.abs(surface.position)) + wp.length(surface.e1) + wp.length(surface.e2)
        skin.error = size * RELATIVE_ERROR
        point = ray.origin + ray.direction * distance
        if wp.abs(wp.dot(skin.point - point, skin.normal)) < skin.error:
            skin.hit = hit
        return skin

    return skin_near


@wp.func
def or_skin(skin: Skin, ray: Ray, hit: Hit) -> Hit:
    """Return what a ray from a point with this skin meets: the skin, where it goes out there and missed it."""
    out = wp.dot(ray.direction, skin.normal)
    if skin.hit.triangle < 0 or out <= 0.0:
        return hit
    t = wp.max(wp.dot(skin.point - ray.origin, skin.normal), 0.0) / out
    if t > _FARTHEST * skin.error or (hit.triangle != NO_HIT and hit.t <= t + 2.0 * skin.error):
        return hit
    found = skin.hit
    found.t = t
    return found
