"""Records of the ray tree, of its instances, and of hits; and where an instance is at a time.

A node of the tree is 56 floats: lower x, y, z and upper x, y, z of its eight boxes, then eight children as integers. A
child c ≥ 0 is a node, c < 0 the leaf −1 − c. A leaf is ten floats for each of its triangles, interleaved: x, y, z of
the first, second and third corners, then the triangle numbers. Unused children have inverted boxes, unused triangles
coincident corners; no ray hits either.
"""

import warp as wp

from wrt.kernels.core.motion import MotionKey, MotionRecord, Placement, transform_at
from wrt.kernels.core.specialise import specialised

NO_HIT = wp.constant(-1)
INFINITE_DISTANCE = wp.constant(3.0e38)


@wp.struct
class Bvh:
    """The tree; node 0 is the root."""

    nodes: wp.array(dtype=float)
    leaves: wp.array(dtype=float)


@wp.struct
class Hit:
    """The point where a ray hits triangle (v0, v1, v2), (1 − u − v) v0 + u v1 + v v2, at distance t.

    For a miss `triangle` is −1 and t is the end of the ray. `instance` is the number of the instance hit, in scenes
    with instances.
    """

    triangle: int
    instance: int
    t: float
    u: float
    v: float


@wp.func
def nowhere() -> Hit:
    """Return a hit of nothing."""
    hit = Hit()
    hit.triangle = NO_HIT
    return hit


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
