"""Packets of eight neighbouring rays, which descend the tree together as long as they stay close.

A packet visits a node once for all its rays: each of the node's boxes is tested against eight rays, where a single ray
tests eight boxes. The tests of a node are independent of each other, so a coherent packet takes little longer than one
ray. When few rays are left in a packet, each goes on alone (`kernels/native/together.h`). This kernel is for the CPU;
on CUDA it would trace rays one by one, and `trace_rays` serves.
"""

import warp as wp

from wrt.kernels.accel.bvh import Bvh
from wrt.kernels.accel.ray_batch import RayBatch
from wrt.kernels.native import include

batches_h = include("batches.h")


@wp.func_native("wrt::trace_packet(bvh, packet, batch);")
def _trace_packet(bvh: Bvh, packet: int, batch: RayBatch):
    batches_h()


@wp.kernel(enable_backward=False)
def trace_packets(first: int, bvh: Bvh, batch: RayBatch):
    """Trace one packet of PACKET rays per thread."""
    _trace_packet(bvh, first + wp.tid(), batch)
