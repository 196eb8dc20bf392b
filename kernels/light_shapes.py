"""Lights that are exact shapes and no triangles: rays that meet them, and what of them is seen.

There are few, so a loop over all of them follows the walk down the tree; nothing else about them is there in scenes
without. A hit names one by a triangle number below NO_HIT.
"""

import warp as wp

from wrt.kernels.bvh import Hit
from wrt.kernels.geometry import Ray
from wrt.kernels.scene_data import (
    FALLOFF_GLTF,
    FALLOFF_LINEAR,
    LIGHT_DISK,
    LIGHT_RECTANGLE,
    LightShape,
    SceneData,
)

NO_MEETING = wp.constant(-1.0)

_FIRST = wp.constant(-2)


@wp.func
def hit_number(shape: int) -> int:
    """Return the number that stands in a Hit for a light shape in place of a triangle's."""
    return _FIRST - shape


@wp.func
def shape_number(hit: Hit) -> int:
    """Return the number in `light_shapes` that was hit; negative where it was a triangle or nothing."""
    return _FIRST - hit.triangle


# --- Rays ------------------------------------------------------------------------------------------


@wp.func
def meet_sphere(center: wp.vec3, radius: float, ray: Ray) -> float:
    """Return the nearest distance above 0 at which a ray meets a sphere, or NO_MEETING.

    Haines, Günther and Akenine-Möller, Ray Tracing Gems (2019), chapter 7: the discriminant from the distance of the
    centre to the line, and the nearer root from the farther one's product with it.
    """
    to_origin = ray.origin - center
    b = -wp.dot(to_origin, ray.direction)
    from_center = to_origin + ray.direction * b
    discriminant = radius * radius - wp.dot(from_center, from_center)
    if discriminant < 0.0:
        return NO_MEETING
    length = wp.length(to_origin)
    c = (length - radius) * (length + radius)
    q = b + wp.where(b < 0.0, -1.0, 1.0) * wp.sqrt(discriminant)
    if q == 0.0:
        return NO_MEETING
    near = wp.min(q, c / q)
    far = wp.max(q, c / q)
    return wp.where(near > 0.0, near, wp.where(far > 0.0, far, NO_MEETING))


@wp.func
def meet(shape: LightShape, ray: Ray) -> float:
    """Return the distance at which a ray meets a rectangle, disk or sphere, or NO_MEETING."""
    if shape.kind != LIGHT_RECTANGLE and shape.kind != LIGHT_DISK:
        return meet_sphere(shape.place, shape.size[0], ray)
    toward = wp.dot(ray.direction, shape.normal)
    if toward == 0.0:
        return NO_MEETING
    t = wp.dot(shape.place - ray.origin, shape.normal) / toward
    if not (t > 0.0):
        return NO_MEETING
    p = ray.origin - shape.place + ray.direction * t
    inside = wp.dot(p, p) <= shape.size[0] * shape.size[0]
    if shape.kind == LIGHT_RECTANGLE:
        x = wp.dot(p, shape.x)
        y = wp.dot(p, shape.y)
        inside = x >= 0.0 and x <= shape.size[0] and y >= 0.0 and y <= shape.size[1]
    return wp.where(inside, t, NO_MEETING)


@wp.func
def nearer_light_shape(scene: SceneData, ray: Ray, hit: Hit, distance: float) -> Hit:
    """Return the nearest light shape on a ray before `distance`, or else `hit`."""
    nearest = float(distance)
    for i in range(scene.solid_light_shapes):
        t = meet(scene.light_shapes[i], ray)
        if t > 0.0 and t < nearest:
            nearest = t
            hit.t = t
            hit.triangle = hit_number(i)
    return hit


@wp.func
def light_shape_blocks(scene: SceneData, ray: Ray, distance: float, aim: Hit) -> bool:
    """Return whether any light shape but the one aimed at lies on a ray before `distance`."""
    blocked = bool(False)
    for i in range(scene.solid_light_shapes):
        t = meet(scene.light_shapes[i], ray)
        if t > 0.0 and t < distance and hit_number(i) != aim.triangle:
            blocked = True
    return blocked


@wp.func
def sun_covers(shape: LightShape, direction: wp.vec3) -> bool:
    """Return whether a direction lies within a sun's disk, by the sine: the cosine of so small an angle is no use."""
    across = wp.cross(shape.normal, direction)
    return wp.dot(across, across) < shape.size[1] and wp.dot(shape.normal, direction) > 0.0


# --- What they give off ----------------------------------------------------------------------------


@wp.func
def shines_back(scene: SceneData, shape: LightShape, ray: Ray) -> bool:
    """Return whether a light shape that a ray meets gives light back along it: a sphere does on its outside."""
    if shape.kind != LIGHT_RECTANGLE and shape.kind != LIGHT_DISK:
        return wp.length(ray.origin - shape.place) > shape.size[0]
    return wp.dot(ray.direction, shape.normal) < 0.0 or scene.lights[shape.light].two_sided != 0


@wp.func
def spot_factor(shape: LightShape, cosine: float) -> float:
    """Return the share of a spot's intensity at an angle to its axis, by the cosine (formulas: wrt/lights.py)."""
    inner = shape.size[0]
    outer = shape.size[1]
    if cosine >= inner:
        return 1.0
    if cosine <= outer:
        return 0.0
    if shape.falloff == FALLOFF_LINEAR:
        return (wp.acos(outer) - wp.acos(cosine)) / (wp.acos(outer) - wp.acos(inner))
    x = (cosine - outer) / (inner - outer)
    if shape.falloff == FALLOFF_GLTF:
        return x * x
    return x * x * (3.0 - 2.0 * x)
