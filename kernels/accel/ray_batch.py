"""Arrays of rays, and the simplest kernel that traces them: one ray per thread."""

import warp as wp

from wrt.kernels.accel.bvh import Bvh, Hit, bvh_hit
from wrt.kernels.native import constants

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


@wp.kernel(enable_backward=False)
def trace_rays(first: int, bvh: Bvh, batch: RayBatch):
    """Trace one ray per thread."""
    ray = first + wp.tid()
    reach = reach_of(batch, ray)
    hit = Hit()
    hit.triangle = -1
    if reach >= batch.t_min:
        hit = bvh_hit(bvh, batch.origins[ray], batch.directions[ray], batch.t_min, reach, batch.any_hit != 0)
    write_answer(batch, ray, hit)


@wp.kernel(enable_backward=False)
def is_hit(first: int, triangle: wp.array(dtype=int), hit_out: wp.array(dtype=wp.bool)):
    """Write which rays have hit something."""
    i = first + wp.tid()
    hit_out[i] = triangle[i] >= 0
