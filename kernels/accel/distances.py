"""Rays against shapes by distance functions, among all others.

The ray tree reports the box of such a shape as if its walls were the surface (`kernels/native/exact/quadrics.h`): hits
come in order of their distance, and for a box the ray is sphere-traced within it. It ends at the first surface that is
nearer than all boxes still to come. So a ray pays for the boxes that it meets on its way, and for no others.
"""

import warp as wp

from wrt.kernels.core.ray_tree import Hit, nowhere
from wrt.kernels.core.rays import Ray
from wrt.kernels.core.scene_data import SceneData
from wrt.kernels.geometry.distances import make_meet_volume, make_volume_of


def through_boxes(find: wp.Function, following: wp.Function, geometry: str, suffix: str) -> tuple[wp.Function, ...]:
    """Return `find` and `following` of `kernels/accel/intersect.py` that meet what is in the boxes these report."""
    volume_of, meet_volume = make_volume_of(geometry), make_meet_volume(geometry)

    @wp.func(name=f"find_surface{suffix}")
    def find_surface(scene: SceneData, ray: Ray, last: Hit, distance: float) -> Hit:
        """Return the nearest hit before `distance` that comes after `last`, which is NO_HIT for none."""
        nearest = nowhere()
        nearest.t = distance
        hit = find(scene, ray, distance, False)
        while hit.triangle >= 0:
            volume = volume_of(scene, hit.triangle, hit.instance, ray.time)
            if volume.model >= 0:
                after = float(0.0)
                if last.triangle >= 0:
                    after = last.t
                t = meet_volume(scene, volume, ray, after, nearest.t)
                if t > 0.0 and t < nearest.t:
                    nearest = hit
                    nearest.t = t
            elif last.triangle < 0 or hit.t > last.t:
                nearest = hit
                break
            elif hit.t == last.t:
                later = hit.triangle > last.triangle
                if hit.instance != last.instance:
                    later = hit.instance > last.instance
                if later:
                    nearest = hit
                    break
            hit = following(scene, ray, hit, nearest.t)
        return nearest

    @wp.func(name=f"find_hit_or_surface{suffix}")
    def find_any(scene: SceneData, ray: Ray, distance: float, any_hit: bool) -> Hit:
        return find_surface(scene, ray, nowhere(), distance)

    return find_any, find_surface
