"""Single-sided and unlit surfaces: which rays hit them, and which rays see their emission.

The camera sees through the back of a single-sided surface (back-face culling; glTF 2.0, section 3.9.6), also in smooth
mirrors and through clear glass. In this module a ray "looks" until a rough surface has scattered it; from then on it
carries light. Single-sided surfaces block light from both sides, so that rooms stay dark. Unlit surfaces emit only
towards rays that look. A single-sided unlit surface blocks only light that arrives at its front: objects cast shadows,
but an outline, which is a shell turned inside out, does not darken the object inside it.
"""

import warp as wp

from wrt.kernels.accel.intersect import make_intersect
from wrt.kernels.core.ray_tree import INFINITE_DISTANCE, Hit
from wrt.kernels.core.rays import Ray
from wrt.kernels.core.scene_data import NEEDS_SIDES, SceneData, ShapeRecord
from wrt.kernels.core.specialise import specialised
from wrt.kernels.core.spmd_marks import traces_alone
from wrt.kernels.geometry.surface import make_surface_at
from wrt.kernels.lights.shapes import make_light_shapes
from wrt.kernels.materials.choice import MOST_PASSED


@wp.func
def is_passed(shape: ShapeRecord, front: bool, looks: bool) -> bool:
    """Return whether a ray passes a shape whose `front` it meets; light goes against the ray that stands for it."""
    if shape.single_sided == 0:
        return False
    return wp.where(looks, not front, front and shape.unlit != 0)


@wp.func
def shines_for(shape: ShapeRecord, looks: bool) -> bool:
    """Return whether a ray that meets a shape finds emission, on the sides that emit."""
    return shape.first_light >= 0 or (looks and shape.unlit != 0)


@specialised()
def make_hit_shown(geometry: str, light_shapes: tuple[str, ...] = ()) -> wp.Function:
    """Return the device function (scene, ray, nearest, looks) -> the nearest hit, or the first that is not passed.

    See `Features` for `geometry` and `light_shapes`.
    """
    next_hit, surface_at = make_intersect(geometry).next_hit, make_surface_at(geometry)
    nearer_light_shape = make_light_shapes(light_shapes).nearer

    @wp.func
    @traces_alone
    def hit_shown(scene: SceneData, ray: Ray, nearest: Hit, looks: bool) -> Hit:
        hit = nearest
        passed = int(0)
        passes = scene.needs & NEEDS_SIDES != 0 and hit.triangle >= 0
        while passes:
            surface = surface_at(scene, ray, hit)
            passes = is_passed(scene.shapes[surface.shape], surface.front, looks)
            if passes:
                hit = next_hit(scene, ray, hit, INFINITE_DISTANCE)
                passed += 1
                passes = hit.triangle >= 0 and passed < MOST_PASSED
        if wp.static(bool(light_shapes)):
            if passed > 0:
                hit = nearer_light_shape(scene, ray, hit)
        return hit

    return hit_shown
