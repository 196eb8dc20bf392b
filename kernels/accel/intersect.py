"""Rays against the scene: the nearest hit, and occlusion.

Traversal is C++ (`kernels/native/traversal.h`): in Warp's Python, with the two tests as intrinsics, it reaches 80 to
85 % of the speed, as Warp clears and copies the stack for each ray.

Exact shapes, spheres or disks and cylinders, too, lie in leaves as triangles that no ray hits (`kernels/native/exact`).
The vectors of disks and cylinders are not in the tree: traversal reads them from the scene's normals, and others leave
these alone. Hits on exact shapes have no u and v: `kernels/geometry` finds the point by the ray. Of shapes by distance
functions the tree has the boxes (`kernels/accel/distances.py`).

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

from wrt.kernels.accel.distances import through_boxes
from wrt.kernels.core.features import distances_of, has_exact, has_quadrics, identifier, instances_of
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
    exact = []
    if has_exact(geometry):
        kind = "boxes" if distances_of(geometry) else "quadrics" if has_quadrics(geometry) else "spheres"
        exact = [f"exact/with_{kind}.h"]
    instances = instances_of(geometry)
    if instances == "none":
        suffix = ""
        find, following = _in_one_tree(include(*exact, "traversal.h"))
    else:
        suffix = f"_{identifier([geometry])}"
        find, following = _in_instances(include(*exact, "instances.h"), instances, suffix)
    if distances_of(geometry):
        suffix = f"_of_surfaces_{identifier([geometry])}"  # the wide kernel knows others by name (wrt/spmd/library.py)
        find, following = through_boxes(find, following, geometry, suffix)

    @wp.func(name=f"closest_hit_before{suffix}")
    def before(scene: SceneData, ray: Ray, distance: float) -> Hit:
        return find(scene, ray, distance, False)

    @wp.func(name=f"closest_hit{suffix}")
    @ray_query
    def nearest(scene: SceneData, ray: Ray) -> Hit:
        return find(scene, ray, INFINITE_DISTANCE, False)

    @wp.func(name=f"occluded{suffix}")
    @ray_query
    def blocked(scene: SceneData, ray: Ray, distance: float) -> bool:
        hit = find(scene, ray, distance, True)
        return hit.triangle >= 0

    return Intersect(nearest, before, following, blocked)


@wp.func
def _hit(found: wp.vec4) -> Hit:
    hit = Hit()
    hit.triangle = wp.cast(found[0], wp.int32)
    hit.t = found[1]
    hit.u = found[2]
    hit.v = found[3]
    return hit


def _in_one_tree(header: wp.Function) -> tuple[wp.Function, wp.Function]:
    """Return (scene, ray, distance, any_hit) -> Hit before a distance, and `next_hit`, for scenes without instances.

    The wide kernel knows `traverse` (`wrt/spmd/library.py`).
    """

    @wp.func_native("return wrt::closest_hit(bvh, wrt::axes_of(corners, normals), origin, direction, t_max, any_hit);")
    def traverse(
        bvh: Bvh,
        corners: wp.array(dtype=wp.vec3i),
        normals: wp.array(dtype=wp.vec3),
        origin: wp.vec3,
        direction: wp.vec3,
        t_max: float,
        any_hit: bool,
    ) -> wp.vec4:
        header()

    @wp.func_native(
        "return wrt::next_hit(bvh, wrt::axes_of(corners, normals), origin, direction, t_min, t_max, id_min);"
    )
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

    @wp.func(name="find_hit")
    def find(scene: SceneData, ray: Ray, distance: float, any_hit: bool) -> Hit:
        return _hit(traverse(scene.bvh, scene.corners, scene.normals, ray.origin, ray.direction, distance, any_hit))

    @wp.func(name="next_hit")
    def following(scene: SceneData, ray: Ray, last: Hit, distance: float) -> Hit:
        found = traverse_after(
            scene.bvh, scene.corners, scene.normals, ray.origin, ray.direction, last.t, distance, last.triangle
        )
        return _hit(found)

    return find, following


# Instance, number of the triangle through all instances, t, u, v
_instance_found = wp.types.vector(length=5, dtype=float)


@wp.func
def _instance_hit(found: _instance_found) -> Hit:
    hit = Hit()
    hit.instance = wp.cast(found[0], wp.int32)
    hit.triangle = wp.cast(found[1], wp.int32)
    hit.t = found[2]
    hit.u = found[3]
    hit.v = found[4]
    return hit


def _in_instances(header: wp.Function, instances: str, suffix: str) -> tuple[wp.Function, wp.Function]:
    """Return the same for scenes with instances."""
    arguments = f"<wrt::Instances::{instances}>(tree, wrt::axes_of(corners, normals), origin, direction, time,"

    @wp.func_native(f"return wrt::closest_instance_hit{arguments} 0.0f, t_max, any_hit);")
    def traverse(
        tree: InstanceTree,
        corners: wp.array(dtype=wp.vec3i),
        normals: wp.array(dtype=wp.vec3),
        origin: wp.vec3,
        direction: wp.vec3,
        time: float,
        t_max: float,
        any_hit: bool,
    ) -> _instance_found:
        header()

    @wp.func_native(f"return wrt::next_instance_hit{arguments} t_min, t_max, instance, triangle);")
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
    ) -> _instance_found:
        header()

    @wp.func(name=f"find_hit{suffix}")
    def find(scene: SceneData, ray: Ray, distance: float, any_hit: bool) -> Hit:
        found = traverse(
            scene.placed, scene.corners, scene.normals, ray.origin, ray.direction, ray.time, distance, any_hit
        )
        return _instance_hit(found)

    @wp.func(name=f"next_hit{suffix}")
    def following(scene: SceneData, ray: Ray, last: Hit, distance: float) -> Hit:
        found = traverse_after(
            scene.placed,
            scene.corners,
            scene.normals,
            ray.origin,
            ray.direction,
            ray.time,
            last.t,
            distance,
            last.instance,
            last.triangle,
        )
        return _instance_hit(found)

    return find, following
