"""Two-level trees for instances: meshes that stand in several places or move, each with a tree of its own.

The upper tree has the layout of `kernels/accel/bvh.py`, where a child c < 0 is the instance −1 − c. At an instance the
ray is transformed to the mesh's space; its direction is not normalised there, so t is the same in both spaces. Meshes
that do not move and occur once are faster in one common tree.

For moving instances the time span of rays is cut into equal slices. Each slice has an upper tree whose boxes bound the
instances throughout the slice; the transform at the ray's time is computed when the ray reaches an instance's box. A
deforming mesh has a copy of tree and vertices for each key, and boxes and triangles are interpolated linearly between
keys. Vertices move linearly too, so a box that moves with its sides bounds them all the time.
"""

import warp as wp

from wrt.kernels.accel.bvh import Bvh, Hit
from wrt.kernels.accel.ray_batch import RayBatch, reach_of, write_answer
from wrt.kernels.features import has_exact, has_quadrics, instances_of
from wrt.kernels.geometry.motion import MotionKey, MotionRecord, Placement, transform_at
from wrt.kernels.native import include
from wrt.kernels.specialise import specialised

instances_h = include("instances.h")
instances_spheres_h = include("exact/instances_spheres.h")
instances_quadrics_h = include("exact/instances_quadrics.h")


@wp.struct
class InstanceRecord:
    """An instance: its mesh, the number of its triangle 0, and the transforms between world space and mesh space.

    A world point p is at `linear` p + `offset` in the mesh's space, and a point q of that at `to_world` q + `position`,
    unless `motion` is not −1 and gives the transform. `shape` is −1 where each triangle has its own. `side` is −1 for
    mirror images. `round_trip` scales rounding errors for both transforms; 0 where nothing is rounded.
    """

    mesh: int
    first_triangle: int
    motion: int
    shape: int
    linear: wp.mat33
    offset: wp.vec3
    to_world: wp.mat33
    position: wp.vec3
    side: float
    round_trip: float


@wp.struct
class PlacedMesh:
    """A mesh's tree; a deforming mesh has a copy of nodes, leaves and vertices for each of its `keys`.

    The times of the keys begin at `first_time`; the strides lead from copy to copy, the last one in vertices.
    """

    bvh: Bvh
    keys: int
    first_time: int
    node_stride: int
    leaf_stride: int
    vertex_stride: int


@wp.struct
class InstanceTree:
    """The upper trees' nodes, the instances, the meshes' trees, and the motions.

    Time slice k begins at `first_slice` + k / `slices_per_second`; its tree begins at node `slice_nodes[k]`.
    """

    nodes: wp.array(dtype=float)
    instances: wp.array(dtype=InstanceRecord)
    meshes: wp.array(dtype=PlacedMesh)
    first_slice: float
    slices_per_second: float
    slice_nodes: wp.array(dtype=int)
    motion_keys: wp.array(dtype=MotionKey)
    motions: wp.array(dtype=MotionRecord)
    key_times: wp.array(dtype=float)


_found = wp.types.vector(length=5, dtype=float)

_WITH_AXES = "wrt::instances_with_axes(tree, corners, normals)"


@specialised()
def make_traverse(geometry: str) -> wp.Function:
    """Return the function (tree, origin, direction, time, t_min, t_max, any_hit) -> argument of `instance_hit`.

    With exact shapes, the scene's corners and normals follow the tree.
    """
    kind = f"wrt::Instances::{instances_of(geometry)}"
    arguments = "origin, direction, time, t_min, t_max, any_hit"
    if has_exact(geometry):
        header = instances_quadrics_h if has_quadrics(geometry) else instances_spheres_h

        @wp.func_native(f"return wrt::closest_instance_hit<{kind}>({_WITH_AXES}, {arguments});")
        def traverse_exact(
            tree: InstanceTree,
            corners: wp.array(dtype=wp.vec3i),
            normals: wp.array(dtype=wp.vec3),
            origin: wp.vec3,
            direction: wp.vec3,
            time: float,
            t_min: float,
            t_max: float,
            any_hit: bool,
        ) -> _found:
            header()

        return traverse_exact

    @wp.func_native(f"return wrt::closest_instance_hit<{kind}>(tree, {arguments});")
    def traverse(
        tree: InstanceTree,
        origin: wp.vec3,
        direction: wp.vec3,
        time: float,
        t_min: float,
        t_max: float,
        any_hit: bool,
    ) -> _found:
        instances_h()

    return traverse


@specialised()
def make_traverse_after(geometry: str) -> wp.Function:
    """Return the device function that finds the next hit, ordered by distance, instance and triangle.

    Its arguments are (tree, origin, direction, time, t_min, t_max, last_instance, last_id), where t_min is the distance
    of the last hit and last_id its triangle's number within its mesh. With exact shapes, the scene's corners and
    normals follow the tree.
    """
    kind = f"wrt::Instances::{instances_of(geometry)}"
    arguments = "origin, direction, time, t_min, t_max, last_instance, last_id"
    if has_exact(geometry):
        header = instances_quadrics_h if has_quadrics(geometry) else instances_spheres_h

        @wp.func_native(f"return wrt::next_instance_hit<{kind}>({_WITH_AXES}, {arguments});")
        def traverse_after_exact(
            tree: InstanceTree,
            corners: wp.array(dtype=wp.vec3i),
            normals: wp.array(dtype=wp.vec3),
            origin: wp.vec3,
            direction: wp.vec3,
            time: float,
            t_min: float,
            t_max: float,
            last_instance: int,
            last_id: int,
        ) -> _found:
            header()

        return traverse_after_exact

    @wp.func_native(f"return wrt::next_instance_hit<{kind}>(tree, {arguments});")
    def traverse_after(
        tree: InstanceTree,
        origin: wp.vec3,
        direction: wp.vec3,
        time: float,
        t_min: float,
        t_max: float,
        last_instance: int,
        last_id: int,
    ) -> _found:
        instances_h()

    return traverse_after


@wp.func
def instance_hit(tree: InstanceTree, found: _found) -> Hit:
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


_traverse_still = make_traverse("still")


@specialised()
def make_instance_placement(instances: str) -> wp.Function:
    """Return the device function (tree, instance record, time) -> Placement, the transform from mesh to world space."""
    moving = instances != "still"

    @wp.func(name=f"instance_placement_{instances}")
    def instance_placement(tree: InstanceTree, instance: InstanceRecord, time: float) -> Placement:
        if wp.static(moving):
            if instance.motion >= 0:
                return transform_at(tree.motion_keys, tree.motions[instance.motion], time)
        placement = Placement()
        placement.linear = instance.to_world
        placement.offset = instance.position
        return placement

    return instance_placement


@wp.kernel(enable_backward=False)
def trace_rays_instances(first: int, tree: InstanceTree, batch: RayBatch):
    """Trace one ray per thread; triangles are numbered through all instances."""
    ray = first + wp.tid()
    reach = reach_of(batch, ray)
    hit = Hit()
    hit.triangle = -1
    if reach >= batch.t_min:
        any_hit = batch.any_hit != 0
        origin = batch.origins[ray]
        hit = instance_hit(tree, _traverse_still(tree, origin, batch.directions[ray], 0.0, batch.t_min, reach, any_hit))
    write_answer(batch, ray, hit)
