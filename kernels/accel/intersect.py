"""Rays against the scene: the nearest hit, and occlusion.

Traversal is C++ (`kernels/native/traversal.h`): in Warp's Python, with the two tests as intrinsics, it reaches 80 to
85 % of the speed, as Warp clears and copies the stack for each ray.

Exact shapes, spheres or disks and cylinders, too, lie in leaves as triangles that no ray hits (`kernels/native/exact`).
The vectors of disks and cylinders are not in the tree: traversal reads them from the scene's normals, and others leave
these alone. Hits on exact shapes have no u and v: `kernels/geometry` finds the point by the ray. Of shapes by distance
functions the tree has the boxes (`kernels/accel/distances.py`): with them all that is traced has another result.

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

from wrt.kernels.accel.distances import Entered, TreeWithBoxes, through_boxes
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
    instances, boxes = instances_of(geometry), bool(distances_of(geometry))
    if instances == "none":
        suffix = ""
        tree = _in_one_tree(include(*exact, "traversal.h"), boxes)
    else:
        suffix = f"_{identifier([geometry])}"
        tree = _in_instances(include(*exact, "instances.h"), instances, suffix, boxes)
    if boxes:
        suffix = f"_of_surfaces_{identifier([geometry])}"  # the wide kernel knows them by name (wrt/spmd/library.py)
        find, following = through_boxes(tree, geometry, suffix)
    else:
        find, following = tree.find, tree.following

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


_found_with_boxes = wp.types.vector(length=7, dtype=float)
# Instance, number of the triangle through all instances, t, u, v; then the first two and the distances of boxes.
_instance_found = wp.types.vector(length=5, dtype=float)
_instance_found_with_boxes = wp.types.vector(length=9, dtype=float)


@wp.func
def _hit_of(instance: int, triangle: int, t: float, u: float, v: float) -> Hit:
    hit = Hit()
    hit.triangle = triangle
    hit.instance = instance
    hit.t = t
    hit.u = u
    hit.v = v
    return hit


@wp.func
def _hit(found: wp.vec4) -> Hit:
    return _hit_of(0, wp.cast(found[0], wp.int32), found[1], found[2], found[3])


@wp.func
def _entered(found: _found_with_boxes) -> Entered:
    entered = Entered()
    entered.hit = _hit_of(0, wp.cast(found[0], wp.int32), found[1], found[2], found[3])
    entered.box = _hit_of(0, wp.cast(found[4], wp.int32), found[5], 0.0, 0.0)
    entered.next_box = found[6]
    return entered


@wp.func
def _instance_hit(found: _instance_found) -> Hit:
    return _hit_of(wp.cast(found[0], wp.int32), wp.cast(found[1], wp.int32), found[2], found[3], found[4])


@wp.func
def _instance_entered(found: _instance_found_with_boxes) -> Entered:
    entered = Entered()
    instance = wp.cast(found[0], wp.int32)
    entered.hit = _hit_of(instance, wp.cast(found[1], wp.int32), found[2], found[3], found[4])
    entered.box = _hit_of(wp.cast(found[5], wp.int32), wp.cast(found[6], wp.int32), found[7], 0.0, 0.0)
    entered.next_box = found[8]
    return entered


def _in_one_tree(header: wp.Function, boxes: bool) -> TreeWithBoxes:
    """Return the functions for scenes without instances; without `boxes` they return a Hit in place of Entered.

    The wide kernel knows `traverse` (`wrt/spmd/library.py`).
    """
    as_hit, result = (_entered, _found_with_boxes) if boxes else (_hit, wp.vec4)
    arguments = "(bvh, wrt::axes_of(corners, normals), origin, direction,"

    @wp.func_native(f"return wrt::closest_hit{arguments} t_max, any_hit);")
    def traverse(
        bvh: Bvh,
        corners: wp.array(dtype=wp.vec3i),
        normals: wp.array(dtype=wp.vec3),
        origin: wp.vec3,
        direction: wp.vec3,
        t_max: float,
        any_hit: bool,
    ) -> result:  # type: ignore[valid-type]
        header()

    def later(function: str) -> wp.Function:
        @wp.func_native(f"return wrt::{function}{arguments} t_min, t_max, id_min);")
        def traverse_after(
            bvh: Bvh,
            corners: wp.array(dtype=wp.vec3i),
            normals: wp.array(dtype=wp.vec3),
            origin: wp.vec3,
            direction: wp.vec3,
            t_min: float,
            t_max: float,
            id_min: int,
        ) -> result:  # type: ignore[valid-type]
            header()

        @wp.func(name=function)
        def following(scene: SceneData, ray: Ray, last: Hit, distance: float):
            found = traverse_after(
                scene.bvh, scene.corners, scene.normals, ray.origin, ray.direction, last.t, distance, last.triangle
            )
            return as_hit(found)

        return following

    @wp.func(name="find_hit")
    def find(scene: SceneData, ray: Ray, distance: float, any_hit: bool):
        return as_hit(traverse(scene.bvh, scene.corners, scene.normals, ray.origin, ray.direction, distance, any_hit))

    return TreeWithBoxes(find, later("next_hit"), later("next_box"))


def _in_instances(header: wp.Function, instances: str, suffix: str, boxes: bool) -> TreeWithBoxes:
    """Return the same for scenes with instances."""
    as_hit, result = (_instance_entered, _instance_found_with_boxes) if boxes else (_instance_hit, _instance_found)
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
    ) -> result:  # type: ignore[valid-type]
        header()

    def later(function: str) -> wp.Function:
        @wp.func_native(f"return wrt::{function}{arguments} t_min, t_max, instance, triangle);")
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
        ) -> result:  # type: ignore[valid-type]
            header()

        @wp.func(name=f"{function}{suffix}")
        def following(scene: SceneData, ray: Ray, last: Hit, distance: float):
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
            return as_hit(found)

        return following

    @wp.func(name=f"find_hit{suffix}")
    def find(scene: SceneData, ray: Ray, distance: float, any_hit: bool):
        found = traverse(
            scene.placed, scene.corners, scene.normals, ray.origin, ray.direction, ray.time, distance, any_hit
        )
        return as_hit(found)

    return TreeWithBoxes(find, later("next_instance_hit"), later("next_instance_box"))
