"""Two levels of trees: meshes that stand in many places, each with one tree of its own.

The upper tree is one of `kernels/bvh.py` whose children c < 0 are the instances −1 − c. A ray that
reaches one goes on in the mesh's own space, its direction not made a unit vector again, so that t is
the same number in both. Meshes that do not move and stand once are faster in one tree.
"""

import warp as wp

from wrt.kernels.bvh import FOLLOW_RAY, RAY_SETUP, Bvh, follow_ray, native_code
from wrt.kernels.ray_batch import RayBatch, reach_of


@wp.struct
class InstanceRecord:
    """Where a mesh stands: which tree, the number of its triangle 0, and the way from the world to its space.

    A world point p is at `linear` p + `offset`.
    """

    mesh: int
    first_triangle: int
    linear: wp.mat33
    offset: wp.vec3


@wp.struct
class InstanceTree:
    """The upper tree's nodes, the instances, and the trees of the meshes."""

    nodes: wp.array(dtype=float)
    instances: wp.array(dtype=InstanceRecord)
    meshes: wp.array(dtype=Bvh)


@wp.struct
class InstanceHit:
    """Where a ray meets an instance's triangle, as in `bvh.Hit`; `instance` is −1 where nothing is hit."""

    instance: int
    triangle: int
    t: float
    u: float
    v: float


_RAY_NAMES = """
    float inverse[4], near_shift[4], far_shift[4], shear[3];
    int near_row[4], far_row[4], kx, ky, kz, flip;
"""

_TRAVERSE = (
    """
    const float pad = BOX_PAD;
    float best_u = 0.0f, best_v = 0.0f;
    int best_instance = -1, best_id = -1;

    // Follow the ray in the space of an instance's mesh. Of equal t the instance of lower number wins:
    // what an earlier one has found, triangles of a later one do not replace, and the other way round.
    const auto visit = [&](int number, float& t_max) {
        const auto& instance = tree.instances.data[number];
        const auto& bvh = tree.meshes.data[instance.mesh];
        const float* const all_nodes = (const float*)bvh.nodes.data;
        const float* const all_leaves = (const float*)bvh.leaves.data;
        float origin[3], direction[3];
        for (int k = 0; k < 3; ++k) {
            origin[k] = instance.offset[k];
            direction[k] = 0.0f;
            for (int j = 0; j < 3; ++j) {
                origin[k] += instance.linear.data[k][j] * world_origin[j];
                direction[k] += instance.linear.data[k][j] * world_direction[j];
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
    + FOLLOW_RAY
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
        const float* const all_nodes = (const float*)tree.nodes.data;
"""
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


@wp.func_native(native_code(_TRAVERSE))
def _traverse(
    tree: InstanceTree, world_origin: wp.vec3, world_direction: wp.vec3, t_min: float, t_max: float, any_hit: bool
) -> _found: ...


@wp.func
def instances_closest_hit(
    tree: InstanceTree, origin: wp.vec3, direction: wp.vec3, t_min: float, t_max: float
) -> InstanceHit:
    """Return the nearest hit with t in [t_min, t_max]; among equals the lowest instance, then triangle."""
    found = _traverse(tree, origin, direction, t_min, t_max, False)
    hit = InstanceHit()
    hit.instance = wp.cast(found[0], wp.int32)
    hit.triangle = wp.cast(found[1], wp.int32)
    hit.t = found[2]
    hit.u = found[3]
    hit.v = found[4]
    return hit


@wp.func
def instances_any_hit(tree: InstanceTree, origin: wp.vec3, direction: wp.vec3, t_min: float, t_max: float) -> bool:
    """Return whether there is a hit with t in [t_min, t_max]."""
    found = _traverse(tree, origin, direction, t_min, t_max, True)
    return wp.cast(found[0], wp.int32) >= 0


@wp.kernel(enable_backward=False)
def trace_rays_instances(first: int, tree: InstanceTree, batch: RayBatch):
    """Trace rays one a thread; triangles are numbered through all instances."""
    ray = first + wp.tid()
    origin = batch.origins[ray]
    direction = batch.directions[ray]
    reach = reach_of(batch, ray)
    triangle = int(-1)
    if batch.any_hit != 0:
        if reach >= batch.t_min:
            if instances_any_hit(tree, origin, direction, batch.t_min, reach):
                triangle = 0
    else:
        t = float(wp.inf)
        uv = wp.vec2(0.0, 0.0)
        if reach >= batch.t_min:
            hit = instances_closest_hit(tree, origin, direction, batch.t_min, reach)
            if hit.instance >= 0:
                triangle = tree.instances[hit.instance].first_triangle + hit.triangle
                t = hit.t
                uv = wp.vec2(hit.u, hit.v)
        batch.t_out[ray] = t
        batch.uv_out[ray] = uv
    batch.triangle_out[ray] = triangle
