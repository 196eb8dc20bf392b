"""Arrays of rays, and the kernels that trace them for `Intersector`.

The simplest traces one ray per thread. On the CPU others take many rays a thread; on CUDA the hardware interleaves
warps itself. In a packet eight neighbouring rays descend the tree together as long as they stay close: each of a node's
boxes is tested against eight rays, where a single ray tests eight boxes. The tests of a node are independent of each
other, so a coherent packet takes little longer than one ray. When few rays remain in a packet, each goes on alone
(`kernels/native/together.h`). Rays that are not coherent are interleaved, a step of each in turn
(`kernels/native/in_turn.h`). Each kernel has a module of its own, as it is compiled when first used.
"""

import warp as wp

from wrt.kernels.core.ray_tree import Bvh, InstanceTree
from wrt.kernels.native import include

batches_h = include("batches.h")


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


@wp.func_native("wrt::trace_one(bvh, ray, batch);")
def _trace_one(bvh: Bvh, ray: int, batch: RayBatch):
    batches_h()


@wp.func_native("wrt::trace_one_in_instances(tree, ray, batch);")
def _trace_one_in_instances(tree: InstanceTree, ray: int, batch: RayBatch):
    batches_h()


@wp.func_native("wrt::trace_packet(bvh, packet, batch);")
def _trace_packet(bvh: Bvh, packet: int, batch: RayBatch):
    batches_h()


@wp.func_native("wrt::trace_chunk(bvh, chunk, batch);")
def _trace_chunk(bvh: Bvh, chunk: int, batch: RayBatch):
    batches_h()


@wp.kernel(module=wp.get_module("wrt.rays.single"), enable_backward=False)
def trace_rays(first: int, bvh: Bvh, batch: RayBatch):
    """Trace one ray per thread."""
    _trace_one(bvh, first + wp.tid(), batch)


@wp.kernel(module=wp.get_module("wrt.rays.instances"), enable_backward=False)
def trace_rays_instances(first: int, tree: InstanceTree, batch: RayBatch):
    """Trace one ray per thread; triangles are numbered through all instances."""
    _trace_one_in_instances(tree, first + wp.tid(), batch)


@wp.kernel(module=wp.get_module("wrt.rays.packets"), enable_backward=False)
def trace_packets(first: int, bvh: Bvh, batch: RayBatch):
    """Trace one packet of PACKET rays per thread."""
    _trace_packet(bvh, first + wp.tid(), batch)


@wp.kernel(module=wp.get_module("wrt.rays.interleaved"), enable_backward=False)
def trace_interleaved(first: int, bvh: Bvh, batch: RayBatch):
    """Trace RAYS_PER_THREAD rays per thread, RAYS_IN_TURN at a time."""
    _trace_chunk(bvh, first + wp.tid(), batch)


@wp.kernel(module=wp.get_module("wrt.rays.single"), enable_backward=False)
def is_hit(first: int, triangle: wp.array(dtype=int), hit_out: wp.array(dtype=wp.bool)):
    """Write which rays have hit something."""
    i = first + wp.tid()
    hit_out[i] = triangle[i] >= 0
