"""Several rays in one thread, advanced a step at a time in turn (`kernels/native/in_turn.h`).

This kernel is for the CPU; on CUDA the hardware interleaves warps itself, and `trace_rays` serves.
"""

import warp as wp

from wrt.kernels.accel.bvh import Bvh
from wrt.kernels.accel.ray_batch import RayBatch
from wrt.kernels.native import include

batches_h = include("batches.h")


@wp.func_native("wrt::trace_chunk(bvh, chunk, batch);")
def _trace_chunk(bvh: Bvh, chunk: int, batch: RayBatch):
    batches_h()


@wp.kernel(enable_backward=False)
def trace_interleaved(first: int, bvh: Bvh, batch: RayBatch):
    """Trace RAYS_PER_THREAD rays per thread, RAYS_IN_TURN at a time."""
    _trace_chunk(bvh, first + wp.tid(), batch)
