"""Rays against triangles: the nearest hit, and whether a segment is blocked."""

import warp as wp

from wrt.kernels.geometry import Ray
from wrt.kernels.scene_data import SceneData

NO_HIT = wp.constant(-1)
INFINITE_DISTANCE = wp.constant(3.0e38)


@wp.struct
class Hit:
    """Where a ray meets triangle (v0, v1, v2): at (1 − u − v) v0 + u v1 + v v2, after distance t."""

    triangle: int
    t: float
    u: float
    v: float


@wp.func
def closest_hit(scene: SceneData, ray: Ray) -> Hit:
    """Return the nearest hit, or one whose triangle is NO_HIT."""
    hit = Hit()
    hit.triangle = NO_HIT
    query = wp.mesh_query_ray(scene.mesh, ray.origin, ray.direction, INFINITE_DISTANCE)
    if query.result:
        # Warp weighs v0 by u and v1 by v.
        hit.triangle = query.face
        hit.t = query.t
        hit.u = query.v
        hit.v = 1.0 - query.u - query.v
    return hit


@wp.func
def occluded(scene: SceneData, ray: Ray, distance: float) -> bool:
    """Return whether anything lies on the ray before `distance`."""
    return wp.mesh_query_ray_anyhit(scene.mesh, ray.origin, ray.direction, distance)
