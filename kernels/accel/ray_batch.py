"""Arrays of rays, and the kernels that trace them for `Intersector`.

The simplest traces one ray per thread. On the CPU others take many rays a thread; on CUDA the hardware interleaves
warps itself. In a packet eight neighbouring rays descend the tree together as long as they stay close: each of a node's
boxes is tested against eight rays, where a single ray tests eight boxes. The tests of a node are independent of each
other, so a coherent packet takes little longer than one ray. When few rays remain in a packet, each goes on alone
(`kernels/native/together.h`). Rays that are not coherent are interleaved, a step of each in turn
(`kernels/native/in_turn.h`). Each kernel has a module of its own, as it is compiled when first used.
"""

import warp as wp

from wrt.kernels.accel.intersect import instance_found, instance_hit
from wrt.kernels.core.ray_tree import Bvh, Hit, InstanceTree
from wrt.kernels.native import constants, include

traversal_h = include("traversal.h")
instances_h = include("instances.h")
batches_h = include("batches.h")

LONGEST = wp.constant(constants.LONGEST)


@wp.struct
class RayBatch:
    """Rays, and the arrays for their hits.

    `t_max` has one entry for all rays or one for each. For a miss `triangle_out` is −1 and `t_out` infinite. With
    `any_hit`, `triangle_out` is not negative for a hit, and `t_out` and `uv_out` are not written. A ray whose direction
    is zero or not finite hits nothing.
    """

    origins: wp.array(dtype=wp.vec3)
    directions: wp.array(dtype=wp.vec3)
    t_min: float
    t_max: wp.array(dtype=float)
    any_hit: int
    triangle_out: wp.array(dtype=int)
    t_out: wp.array(dtype=float)
    uv_out: wp.array(dtype=wp.vec2)


@wp.func
def reach_of(batch: RayBatch, ray: int) -> float:
    """Return a ray's greatest distance."""
    if batch.t_max.shape[0] > 1:
        return wp.min(batch.t_max[ray], LONGEST)
    return wp.min(batch.t_max[0], LONGEST)


@wp.func
def write_answer(batch: RayBatch, ray: int, hit: Hit):
    """Store a ray's hit."""
    batch.triangle_out[ray] = hit.triangle
    if batch.any_hit == 0:
        missed = hit.triangle < 0
        batch.t_out[ray] = wp.where(missed, float(wp.inf), hit.t)
        batch.uv_out[ray] = wp.where(missed, wp.vec2(0.0, 0.0), wp.vec2(hit.u, hit.v))


@wp.func_native("return wrt::closest_hit(bvh, origin, direction, t_min, t_max, any_hit);")
def _traverse(bvh: Bvh, origin: wp.vec3, direction: wp.vec3, t_min: float, t_max: float, any_hit: bool) -> wp.vec4:
    traversal_h()


@wp.kernel(module=wp.get_module("wrt.rays.single"), enable_backward=False)
def trace_rays(first: int, bvh: Bvh, batch: RayBatch):
    """Trace one ray per thread."""
    ray = first + wp.tid()
    reach = reach_of(batch, ray)
    hit = Hit()
    hit.triangle = -1
    if reach >= batch.t_min:
        found = _traverse(bvh, batch.origins[ray], batch.directions[ray], batch.t_min, reach, batch.any_hit != 0)
        hit.triangle = wp.cast(found[0], wp.int32)
        hit.t = found[1]
        hit.u = found[2]
        hit.v = found[3]
    write_answer(batch, ray, hit)


@wp.kernel(module=wp.get_module("wrt.rays.single"), enable_backward=False)
def is_hit(first: int, triangle: wp.array(dtype=int), hit_out: wp.array(dtype=wp.bool)):
    """Write which rays have hit something."""
    i = first + wp.tid()
    hit_out[i] = triangle[i] >= 0


@wp.func_native("wrt::trace_packet(bvh, packet, batch);")
def _trace_packet(bvh: Bvh, packet: int, batch: RayBatch):
    batches_h()


@wp.kernel(module=wp.get_module("wrt.rays.packets"), enable_backward=False)
def trace_packets(first: int, bvh: Bvh, batch: RayBatch):
    """Trace one packet of PACKET rays per thread."""
    _trace_packet(bvh, first + wp.tid(), batch)


@wp.func_native("wrt::trace_chunk(bvh, chunk, batch);")
def _trace_chunk(bvh: Bvh, chunk: int, batch: RayBatch):
    batches_h()


@wp.kernel(module=wp.get_module("wrt.rays.interleaved"), enable_backward=False)
def trace_interleaved(first: int, bvh: Bvh, batch: RayBatch):
    """Trace RAYS_PER_THREAD rays per thread, RAYS_IN_TURN at a time."""
    _trace_chunk(bvh, first + wp.tid(), batch)


@wp.func_native("""
    return wrt::closest_instance_hit<wrt::Instances::still>(tree, origin, direction, 0.0f, t_min, t_max, any_hit);
""")
def _traverse_instances(
    tree: InstanceTree, origin: wp.vec3, direction: wp.vec3, t_min: float, t_max: float, any_hit: bool
) -> instance_found:
    instances_h()


@wp.kernel(module=wp.get_module("wrt.rays.instances"), enable_backward=False)
def trace_rays_instances(first: int, tree: InstanceTree, batch: RayBatch):
    """Trace one ray per thread; triangles are numbered through all instances."""
    ray = first + wp.tid()
    reach = reach_of(batch, ray)
    hit = Hit()
    hit.triangle = -1
    if reach >= batch.t_min:
        any_hit = batch.any_hit != 0
        found = _traverse_instances(tree, batch.origins[ray], batch.directions[ray], batch.t_min, reach, any_hit)
        hit = instance_hit(tree, found)
    write_answer(batch, ray, hit)
