"""Rays against shapes by distance functions, among all others.

The ray tree has the box of such a shape, which hides nothing. Traversal finds the nearest hit on other shapes, and
which boxes a ray enters before that (`kernels/native/exact/entries.h`). There the ray is sphere-traced, box by box in
the order in which it enters them, until a surface is nearer than the next box. So a ray pays for the boxes that it
meets on its way, and for no others; and one that enters a single box goes through the tree once.
"""

from typing import NamedTuple

import warp as wp

from wrt.kernels.core.ray_tree import NO_HIT, Hit
from wrt.kernels.core.rays import Ray
from wrt.kernels.core.scene_data import SceneData
from wrt.kernels.geometry.distances import NO_MEETING, make_meet_volume, make_volume_of


@wp.struct
class Entered:
    """The nearest hit on shapes without a box, the first `box` that a ray enters, and the t at which it does the next.

    `box` is the hit of a triangle that stands for it, and `next_box` may be less than it is.
    """

    hit: Hit
    box: Hit
    next_box: float


class TreeWithBoxes(NamedTuple):
    """The device functions that trace rays through trees with boxes.

    Attributes:
        find: (scene, ray, distance, any_hit) -> Entered, before a distance.
        following: (scene, ray, last, distance) -> Entered; its hit comes after `last`.
        next_box: (scene, ray, last, distance) -> Entered; its box comes after `last`, and it has no hit.
    """

    find: wp.Function
    following: wp.Function
    next_box: wp.Function


def through_boxes(tree: TreeWithBoxes, geometry: str, suffix: str) -> tuple[wp.Function, ...]:
    """Return `find` and `following` of `kernels/accel/intersect.py` that meet what is in the boxes.

    The wide kernel knows `find_surface` (`wrt/spmd/path_object.py`).
    """
    volume_of, meet_volume = make_volume_of(geometry), make_meet_volume(geometry)

    @wp.func(name=f"find_surface{suffix}")
    def find_surface(scene: SceneData, ray: Ray, entered: Entered, after: float, any_hit: bool) -> Hit:
        """Return the nearest hit, in boxes only beyond `after`, where a surface was met if that is not 0."""
        nearest = entered.hit
        box = entered.box
        next_box = entered.next_box
        if any_hit and nearest.triangle >= 0:
            box.triangle = NO_HIT
        while box.triangle >= 0 and box.t < nearest.t:
            volume = volume_of(scene, box.triangle, box.instance, ray.time)
            met = meet_volume(scene, volume, ray, after, nearest.t)
            if met != NO_MEETING and wp.abs(met) < nearest.t:
                nearest = box
                nearest.t = wp.abs(met)
                nearest.u = wp.where(met > 0.0, 1.0, 0.0)  # whether the ray comes from outside
            is_done = any_hit and nearest.triangle >= 0
            if is_done or next_box >= nearest.t:
                box.triangle = NO_HIT
            else:
                more = tree.next_box(scene, ray, box, nearest.t)
                box = more.box
                next_box = more.next_box
        return nearest

    @wp.func(name=f"find_hit_or_surface{suffix}")
    def find(scene: SceneData, ray: Ray, distance: float, any_hit: bool) -> Hit:
        return find_surface(scene, ray, tree.find(scene, ray, distance, any_hit), 0.0, any_hit)

    @wp.func(name=f"next_hit_or_surface{suffix}")
    def following(scene: SceneData, ray: Ray, last: Hit, distance: float) -> Hit:
        entered = Entered()
        after = float(0.0)
        if last.triangle >= 0:
            entered = tree.following(scene, ray, last, distance)
            after = last.t
        else:
            entered = tree.find(scene, ray, distance, False)
        return find_surface(scene, ray, entered, after, False)

    return find, following
