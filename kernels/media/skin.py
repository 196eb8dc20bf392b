"""Surfaces of a medium so near to a point inside that a ray from there would miss them.

A ray ignores hits nearer than the error of their distance (`kernels/native/triangles.h`), which for large triangles may
be a good part of a dense medium's mean free path. A path scattered there would leave without noticing. But it came from
that surface, or was on its way to it, so the surface is remembered and counts as hit even if the ray misses it.
"""

import warp as wp

from wrt.kernels.core.features import has_exact
from wrt.kernels.core.ray_tree import NO_HIT, Hit
from wrt.kernels.core.rays import Ray
from wrt.kernels.core.scene_data import SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.geometry.surface import make_surface_at

RELATIVE_ERROR = wp.constant(1.0e-5)
"""Error of a hit's distance, relative to the size of triangle and coordinates: several times the actual bound."""

_FARTHEST = wp.constant(20.0)


@wp.struct
class Skin:
    """A surface near a point in a medium, as a plane with an outward normal; `hit` is NO_HIT if there is none.

    Rays may miss it if it is nearer than `error`.
    """

    hit: Hit
    point: wp.vec3
    normal: wp.vec3
    error: float


@wp.func
def no_skin() -> Skin:
    """Return a Skin without a surface."""
    skin = Skin()
    skin.hit.triangle = NO_HIT
    return skin


@specialised()
def make_skin_near(geometry: str) -> wp.Function:
    """Return the device function (scene, ray, distance, ahead, previous) -> Skin of a point on a ray.

    `ahead` is the hit in front of the ray and `previous` the one that it left, or NO_HIT. See `Features.geometry`.
    """
    surface_at = make_surface_at(geometry)

    @wp.func
    def skin_near(scene: SceneData, ray: Ray, distance: float, ahead: Hit, previous: Hit) -> Skin:
        skin = no_skin()
        is_behind = previous.triangle >= 0 and (ahead.triangle < 0 or distance < ahead.t - distance)
        hit = ahead
        if is_behind:
            hit = previous
        if hit.triangle < 0:
            return skin
        line = ray
        line_hit = hit
        if wp.static(has_exact(geometry)):
            # The points of exact shapes are found from the ray: one behind by looking back from where it begins, or it
            # would be the far wall. Seen so, each normal faces the medium.
            if is_behind:
                line.direction = -ray.direction
                line_hit.t = 0.0
        surface = surface_at(scene, line, line_hit)
        skin.normal = -surface.normal
        if wp.static(not has_exact(geometry)):
            # Seen along the ray, normals face back: outwards behind, inwards ahead.
            if hit.triangle == previous.triangle and hit.t == previous.t:
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
def hit_or_skin(skin: Skin, ray: Ray, hit: Hit) -> Hit:
    """Return a ray's hit, or the skin if the ray leaves through it and the intersection test missed it."""
    out = wp.dot(ray.direction, skin.normal)
    if skin.hit.triangle < 0 or out <= 0.0:
        return hit
    t = wp.max(wp.dot(skin.point - ray.origin, skin.normal), 0.0) / out
    if t > _FARTHEST * skin.error or (hit.triangle != NO_HIT and hit.t <= t + 2.0 * skin.error):
        return hit
    found = skin.hit
    found.t = t
    return found
