"""Two levels of trees: meshes that stand or move in many places, each with one tree of its own.

The upper tree is one of `kernels/bvh.py` whose children c < 0 are the instances −1 − c. A ray that
reaches one goes on in the mesh's own space, its direction not made a unit vector again, so that t is
the same number in both. Meshes that do not move and stand once are faster in one tree.

Where instances move, the time that rays may have is cut into equal slices. Each has an upper tree of its own, over
boxes that hold the instances throughout the slice; where an instance is at the ray's own time is worked out when
the ray comes to its box. Of a mesh that changes its shape there are several copies of tree and vertices, one for each
key: boxes and triangles are interpolated linearly on the way. As the vertices move linearly between two keys, a box
whose sides do so too holds what it held at both.
"""

import functools

import warp as wp

from wrt.kernels.bvh import FOLLOW_RAY, RAY_SETUP, Bvh, Hit, follow_ray, native_code
from wrt.kernels.motion import KEY_AT, PLACEMENT_AT, MotionKey, MotionRecord, Placement, transform_at
from wrt.kernels.ray_batch import RayBatch, reach_of, write_answer
from wrt.kernels.simd import TRIANGLE_TEST, TRIANGLE_TEST_AFTER


@wp.struct
class InstanceRecord:
    """Where a mesh stands: which tree, the number of its triangle 0, and the ways between the world and its space.

    A world point p is at `linear` p + `offset` in the mesh's space, and a point q of that at `to_world` q + `position`;
    where `motion` is not −1 it tells instead. `shape` is −1 where the triangles tell theirs. `side` is −1 for mirror
    images. `round_trip` is how much larger rounding errors may be after the ways there and back; 0 where nothing is
    rounded.
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
    """A mesh's tree; one that changes its shape has a copy of nodes, leaves and vertices for each of its `keys`.

    The times of the keys begin at `first_time`; the strides are those between copies, the last one in vertices.
    """

    bvh: Bvh
    keys: int
    first_time: int
    node_stride: int
    leaf_stride: int
    vertex_stride: int


@wp.struct
class InstanceTree:
    """The upper trees' nodes, the instances, the trees of the meshes, and how they move.

    Slice k of the time begins at `first_slice` + k / `slices_per_second`; its tree begins at node `slice_nodes[k]`.
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


_RAY_NAMES = """
    float inverse[4], near_shift[4], far_shift[4], shear[3];
    int near_row[4], far_row[4], kx, ky, kz, flip;
"""

_STANDING = """
        float linear[3][3], shift[3];
        for (int k = 0; k < 3; ++k) {
            shift[k] = instance.offset[k];
            for (int j = 0; j < 3; ++j) linear[k][j] = instance.linear.data[k][j];
        }
"""

# The inverse by cofactors, of numbers of size 1, for the determinant must neither vanish nor overflow.
_MOVING = (
    _STANDING
    + """
        if (instance.motion >= 0) {
            const auto* const keys = tree.motion_keys.data;
            const auto& motion = tree.motions.data[instance.motion];
            float there[3][3], back[3];
            {
                auto& linear = there;
                auto& offset = back;
"""
    + PLACEMENT_AT
    + """
            }
            float most = 0.0f;
            for (int k = 0; k < 3; ++k)
                for (int j = 0; j < 3; ++j) most = wp::max(most, wp::abs(there[k][j]));
            for (int k = 0; k < 3; ++k)
                for (int j = 0; j < 3; ++j) there[k][j] /= most;
            for (int k = 0; k < 3; ++k)
                for (int j = 0; j < 3; ++j)
                    linear[j][k] = there[(k + 1) % 3][(j + 1) % 3] * there[(k + 2) % 3][(j + 2) % 3]
                                 - there[(k + 1) % 3][(j + 2) % 3] * there[(k + 2) % 3][(j + 1) % 3];
            const float scale = 1.0f / ((there[0][0] * linear[0][0] + there[0][1] * linear[1][0]
                                         + there[0][2] * linear[2][0]) * most);
            for (int k = 0; k < 3; ++k) {
                shift[k] = 0.0f;
                for (int j = 0; j < 3; ++j) {
                    linear[k][j] *= scale;
                    shift[k] -= linear[k][j] * back[j];
                }
            }
        }
"""
)

_FOLLOW_DEFORMING = (
    """
        const auto& mesh = tree.meshes.data[instance.mesh];
        const bool deforms = mesh.keys > 1;
        const float *later_nodes = all_nodes, *later_leaves = all_leaves;
        float share = 0.0f;
        if (deforms) {
            const float* const times = tree.key_times.data + mesh.first_time;
            const int count = mesh.keys;
            int key = 0;
"""
    + KEY_AT
    + """
            const int next = key + 1 < count ? key + 1 : key;
            later_nodes = all_nodes + (size_t)next * mesh.node_stride;
            later_leaves = all_leaves + (size_t)next * mesh.leaf_stride;
            all_nodes += (size_t)key * mesh.node_stride;
            all_leaves += (size_t)key * mesh.leaf_stride;
        }
        // Rounding keeps the order of numbers, so what lay in a box lies in it still.
        const auto mix = [&](float* out, const float* from, const float* to, int count) {
#if VECTOR_CODE
            #pragma clang fp contract(off)
#endif
            for (int k = 0; k < count; ++k) out[k] = (1.0f - share) * from[k] + share * to[k];
        };
        alignas(32) float mixed[10 * LEAF_SIZE];
"""
    + follow_ray(
        """
            const float* leaf = all_leaves + (size_t)(-1 - current) * (10 * LEAF_SIZE);
            if (deforms) {
                mix(mixed, leaf, later_leaves + (size_t)(-1 - current) * (10 * LEAF_SIZE), 9 * LEAF_SIZE);
                memcpy(mixed + 9 * LEAF_SIZE, leaf + 9 * LEAF_SIZE, 4 * LEAF_SIZE);
                leaf = mixed;
            }
"""
        + TRIANGLE_TEST,
        """
            const float* node = all_nodes + (size_t)current * 56;
            if (deforms) {
                mix(mixed, node, later_nodes + (size_t)current * 56, 48);
                node = mixed;
            }
""",
    )
)


def _traverse_code(instances: str) -> str:
    """Return the way of a ray through both levels; `instances` as in Features."""
    return (
        """
    const float pad = BOX_PAD;
    float best_u = 0.0f, best_v = 0.0f;
    int best_instance = -1, best_id = -1;

    // Follow the ray in the space of an instance's mesh. Of equal t the instance of lower number wins:
    // what an earlier one has found, triangles of a later one do not replace, and the other way round.
    const auto visit = [&](int number, float& t_max) {
        const auto& instance = tree.instances.data[number];
        const auto& bvh = tree.meshes.data[instance.mesh].bvh;
        const float* all_nodes = (const float*)bvh.nodes.data;
        const float* all_leaves = (const float*)bvh.leaves.data;
"""
        + (_STANDING if instances == "still" else _MOVING)
        + """
        float origin[3], direction[3];
        for (int k = 0; k < 3; ++k) {
            origin[k] = shift[k];
            direction[k] = 0.0f;
            for (int j = 0; j < 3; ++j) {
                origin[k] += linear[k][j] * world_origin[j];
                direction[k] += linear[k][j] * world_direction[j];
            }
        }
"""
        + _RAY_NAMES
        + RAY_SETUP
        + """
        if (!runs) return;
        const int nothing_yet = best_instance >= 0 && best_instance < number ? -1 : NOTHING_HIT;
        float hit_u = 0.0f, hit_v = 0.0f;
        int id_max = nothing_yet, current = 0;
"""
        + (_FOLLOW_DEFORMING if instances == "deforming" else FOLLOW_RAY)
        + """
        if (id_max != nothing_yet) {
            best_instance = number;
            best_id = id_max;
            best_u = hit_u;
            best_v = hit_v;
        }
    };
    {
        const auto& origin = world_origin;
        const auto& direction = world_direction;
        const float* all_nodes = (const float*)tree.nodes.data;
"""
        + (
            ""
            if instances == "still"
            else """
        const float slice = (time - tree.first_slice) * tree.slices_per_second, last = tree.slice_nodes.shape[0] - 1;
        all_nodes += (size_t)tree.slice_nodes.data[(int)wp::max(0.0f, wp::min(slice, last))] * 56;
"""
        )
        + _RAY_NAMES
        + RAY_SETUP
        + """
        int id_max = NOTHING_HIT, current = 0;
        if (runs) {
"""
        + follow_ray("visit(-1 - current, t_max); id_max = best_instance < 0 ? NOTHING_HIT : 0;")
        + """
        }
    }
    const int found[2] = {best_instance, best_id};
    wp::vec_t<5, float> result;
    memcpy(&result[0], found, 8);
    result[2] = t_max;
    result[3] = best_u;
    result[4] = best_v;
    return result;
"""
    )


_found = wp.types.vector(length=5, dtype=float)


@functools.cache
def make_traverse(instances: str) -> wp.Function:
    """Return the device function (tree, origin, direction, time, t_min, t_max, any_hit) -> what a ray meets.

    `instance_hit` reads it.
    """

    @wp.func_native(native_code(_traverse_code(instances)))
    def traverse(
        tree: InstanceTree,
        world_origin: wp.vec3,
        world_direction: wp.vec3,
        time: float,
        t_min: float,
        t_max: float,
        any_hit: bool,
    ) -> _found: ...

    return traverse


@functools.cache
def make_traverse_after(instances: str) -> wp.Function:
    """Return the device function that finds what follows a hit, in the order of distance, instance and triangle.

    Its arguments are (tree, origin, direction, time, t_min, t_max, last_instance, last_id), t_min being the distance of
    the last hit; its triangle is numbered within its mesh.
    """
    code = _traverse_code(instances).replace(TRIANGLE_TEST, TRIANGLE_TEST_AFTER)
    code = code.replace(
        "if (!runs) return;",
        "if (!runs) return;\n"
        "const int id_min = number < last_instance ? NOTHING_HIT : number == last_instance ? last_id : -1;",
    )

    @wp.func_native(native_code("const bool any_hit = false;" + code))
    def traverse_after(
        tree: InstanceTree,
        world_origin: wp.vec3,
        world_direction: wp.vec3,
        time: float,
        t_min: float,
        t_max: float,
        last_instance: int,
        last_id: int,
    ) -> _found: ...

    return traverse_after


@wp.func
def instance_hit(tree: InstanceTree, found: _found) -> Hit:
    """Return what a traversal found; triangles are numbered from the first one of their instance's mesh on."""
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


@functools.cache
def make_instance_placement(instances: str) -> wp.Function:
    """Return the device function (tree, instance record, time) -> Placement, from the mesh's space to the world."""
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
    """Trace rays one a thread; triangles are numbered through all instances."""
    ray = first + wp.tid()
    reach = reach_of(batch, ray)
    hit = Hit()
    hit.triangle = -1
    if reach >= batch.t_min:
        any_hit = batch.any_hit != 0
        origin = batch.origins[ray]
        hit = instance_hit(tree, _traverse_still(tree, origin, batch.directions[ray], 0.0, batch.t_min, reach, any_hit))
    write_answer(batch, ray, hit)
