"""Rays through a tree that holds exact shapes besides triangles: spheres, or disks and cylinders, too.

They lie in leaves as triangles that no ray hits (`kernels/native/exact`). The vectors of disks and cylinders are not in
the tree: traversal reads them from the normals of the scene. Hits have no u and v: `kernels/geometry/spheres.py` and
`kernels/geometry/quadrics.py` find the point by the ray.
"""

import warp as wp

from wrt.kernels.accel.bvh import Bvh, Hit, _hit
from wrt.kernels.geometry.rays import Ray
from wrt.kernels.native import include
from wrt.kernels.scene.scene_data import SceneData
from wrt.kernels.specialise import specialised
from wrt.kernels.spmd_marks import ray_query

_LONGEST = wp.constant(3.0e38)


@specialised()
def make_exact_queries(quadrics: bool) -> tuple[wp.Function, wp.Function, wp.Function, wp.Function]:
    """Return the fields of an `Intersect` for scenes without instances, whose shapes may be disks and cylinders.

    The wide kernel knows its `traverse` by its name (`wrt/spmd/natives.py`).
    """
    header = include("exact/traversal_quadrics.h" if quadrics else "exact/traversal_spheres.h")
    tree = "wrt::with_axes(bvh, corners, normals)"

    @wp.func_native(f"return wrt::closest_hit({tree}, origin, direction, t_min, t_max, any_hit);")
    def traverse(
        bvh: Bvh,
        corners: wp.array(dtype=wp.vec3i),
        normals: wp.array(dtype=wp.vec3),
        origin: wp.vec3,
        direction: wp.vec3,
        t_min: float,
        t_max: float,
        any_hit: bool,
    ) -> wp.vec4:
        header()

    @wp.func_native(f"return wrt::next_hit({tree}, origin, direction, t_min, t_max, id_min);")
    def traverse_after(
        bvh: Bvh,
        corners: wp.array(dtype=wp.vec3i),
        normals: wp.array(dtype=wp.vec3),
        origin: wp.vec3,
        direction: wp.vec3,
        t_min: float,
        t_max: float,
        id_min: int,
    ) -> wp.vec4:
        header()

    @wp.func(name="closest_hit_before")
    def before(scene: SceneData, ray: Ray, distance: float) -> Hit:
        return _hit(traverse(scene.bvh, scene.corners, scene.normals, ray.origin, ray.direction, 0.0, distance, False))

    @wp.func(name="closest_hit")
    @ray_query
    def nearest(scene: SceneData, ray: Ray) -> Hit:
        return before(scene, ray, _LONGEST)

    @wp.func(name="next_hit")
    def following(scene: SceneData, ray: Ray, last: Hit, distance: float) -> Hit:
        found = traverse_after(
            scene.bvh, scene.corners, scene.normals, ray.origin, ray.direction, last.t, distance, last.triangle
        )
        return _hit(found)

    @wp.func(name="occluded")
    @ray_query
    def blocked(scene: SceneData, ray: Ray, distance: float) -> bool:
        found = traverse(scene.bvh, scene.corners, scene.normals, ray.origin, ray.direction, 0.0, distance, True)
        return wp.cast(found[0], wp.int32) >= 0

    return nearest, before, following, blocked
