"""Rays against the scene: the nearest hit, and occlusion.

Traversal is C++ (`kernels/native/traversal.h`): in Warp's Python, with the two tests as intrinsics, it reaches 80 to
85 % of the speed, as Warp clears and copies the stack for each ray.

Exact shapes, spheres or disks and cylinders, too, lie in leaves as triangles that no ray hits (`kernels/native/exact`).
The vectors of disks and cylinders are not in the tree: traversal reads them from the scene's normals, and others leave
these alone. Hits on exact shapes have no u and v: `kernels/geometry` finds the point by the ray.

With instances there are two levels: meshes that stand in several places or move have a tree each. A child c < 0 of the
upper tree is the instance −1 − c. At an instance the ray is transformed to the mesh's space; its direction is not
normalised there, so t is the same in both spaces. Meshes that do not move and occur once are faster in one common tree.
For moving instances the time span of rays is cut into equal slices. Each slice has an upper tree whose boxes bound the
instances throughout the slice; the transform at the ray's time is computed when the ray reaches an instance's box. A
deforming mesh has a copy of tree and vertices for each key, and boxes and triangles are interpolated linearly between
keys. Vertices move linearly too, so a box that moves with its sides bounds them all the time.
"""

from typing import NamedTuple

import warp as wp

from wrt.kernels.core.features import has_exact, has_quadrics, instances_of
from wrt.kernels.core.ray_tree import INFINITE_DISTANCE, Bvh, Hit, InstanceTree
from wrt.kernels.core.rays import Ray
from wrt.kernels.core.scene_data import SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.core.spmd_marks import ray_query
from wrt.kernels.native import include


class Intersect(NamedTuple):
    """The device functions that trace rays through scenes of one kind.

    Attributes:
        closest_hit: (scene, ray) -> the nearest hit, of equal ones that with the lowest instance and triangle number;
            its triangle is NO_HIT for a miss.
        closest_hit_before: (scene, ray, distance) -> the nearest hit before `distance`, likewise.
        next_hit: (scene, ray, last, distance) -> the hit after `last` and before `distance`; hits at equal distances
            follow by instance, then by triangle. So surfaces along a ray are enumerated, coincident ones included.
        occluded: (scene, ray, distance) -> whether anything lies on the ray before `distance`.
    """

    closest_hit: wp.Function
    closest_hit_before: wp.Function
    next_hit: wp.Function
    occluded: wp.Function


@specialised()
def make_intersect(geometry: str) -> Intersect:
    """Return the functions for scenes with this `Features.geometry`."""
    exact = (
        ["exact/with_quadrics.h" if has_quadrics(geometry) else "exact/with_spheres.h"] if has_exact(geometry) else []
    )
    instances = instances_of(geometry)
    if instances == "none":
        return _make_in_one_tree(include(*exact, "traversal.h"))
    return _make_in_instances(include(*exact, "instances.h"), instances, geometry)


@wp.func
def _hit(found: wp.vec4) -> Hit:
    hit = Hit()
    hit.triangle = wp.cast(found[0], wp.int32)
    hit.t = found[1]
    hit.u = found[2]
    hit.v = found[3]
    return hit


def _make_in_one_tree(header: wp.Function) -> Intersect:
    """Return the functions for scenes without instances; the wide kernel knows `traverse` (`wrt/spmd/natives.py`)."""
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
        return before(scene, ray, INFINITE_DISTANCE)

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

    return Intersect(nearest, before, following, blocked)


# Instance, triangle of the mesh, t, u, v
instance_found = wp.types.vector(length=5, dtype=float)


@wp.func
def instance_hit(tree: InstanceTree, found: instance_found) -> Hit:
    """Return the result of a traversal, with triangle numbers from the first one of the instance's mesh on."""
    hit = Hit()
    hit.instance = wp.cast(found[0], wp.int32)
    hit.triangle = -1
    if hit.instance >= 0:
        hit.triangle = wp.cast(found[1], wp.int32) + tree.instances[hit.instance].first_triangle
    hit.t = found[2]
    hit.u = found[3]
    hit.v = found[4]
    return hit


def _make_in_instances(header: wp.Function, instances: str, geometry: str) -> Intersect:
    """Return the functions for scenes with instances."""
    kind = f"wrt::Instances::{instances}"
    trees = "wrt::instances_with_axes(tree, corners, normals)"

    @wp.func_native(
        f"return wrt::closest_instance_hit<{kind}>({trees}, origin, direction, time, t_min, t_max, any_hit);"
    )
    def traverse(
        tree: InstanceTree,
        corners: wp.array(dtype=wp.vec3i),
        normals: wp.array(dtype=wp.vec3),
        origin: wp.vec3,
        direction: wp.vec3,
        time: float,
        t_min: float,
        t_max: float,
        any_hit: bool,
    ) -> instance_found:
        header()

    @wp.func_native(
        f"return wrt::next_instance_hit<{kind}>({trees}, origin, direction, time, t_min, t_max, instance, triangle);"
    )
    def traverse_after(
        tree: InstanceTree,
        corners: wp.array(dtype=wp.vec3i),
        normals: wp.array(dtype=wp.vec3),
        origin: wp.vec3,
        direction: wp.vec3,
        time: float,
        t_min: float,
        t_max: float,
        instance: int,
        triangle: int,
    ) -> instance_found:
        header()

    @wp.func(name=f"closest_hit_before_{geometry}")
    def before(scene: SceneData, ray: Ray, distance: float) -> Hit:
        found = traverse(
            scene.placed, scene.corners, scene.normals, ray.origin, ray.direction, ray.time, 0.0, distance, False
        )
        return instance_hit(scene.placed, found)

    @wp.func(name=f"closest_hit_{geometry}")
    @ray_query
    def nearest(scene: SceneData, ray: Ray) -> Hit:
        return before(scene, ray, INFINITE_DISTANCE)

    @wp.func(name=f"next_hit_{geometry}")
    def following(scene: SceneData, ray: Ray, last: Hit, distance: float) -> Hit:
        placed = scene.placed
        triangle = last.triangle - placed.instances[last.instance].first_triangle
        found = traverse_after(
            placed,
            scene.corners,
            scene.normals,
            ray.origin,
            ray.direction,
            ray.time,
            last.t,
            distance,
            last.instance,
            triangle,
        )
        return instance_hit(placed, found)

    @wp.func(name=f"occluded_{geometry}")
    @ray_query
    def blocked(scene: SceneData, ray: Ray, distance: float) -> bool:
        found = traverse(
            scene.placed, scene.corners, scene.normals, ray.origin, ray.direction, ray.time, 0.0, distance, True
        )
        return wp.cast(found[0], wp.int32) >= 0

    return Intersect(nearest, before, following, blocked)
