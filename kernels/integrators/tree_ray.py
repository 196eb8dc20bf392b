"""Rays of a ray tree, and those of them that wait to be followed."""

from typing import Any, NamedTuple

import warp as wp

from wrt.kernels.bsdf import make_bsdf, make_is_any, models_with
from wrt.kernels.core.bsdf import Bsdf, SpecularLobes
from wrt.kernels.core.features import Features
from wrt.kernels.core.ray_tree import Hit
from wrt.kernels.core.rays import Ray, to_world
from wrt.kernels.core.scene_data import MOST_BODIES, BodyStack
from wrt.kernels.core.specialise import specialised
from wrt.kernels.geometry.surface import Surface, gap_behind
from wrt.kernels.integrators.path_state import PathSettings
from wrt.kernels.sampling.sampler import BLOCK_BSDF, BLOCKS_PER_PATH, Sampler, make_sample_4d, vertex_block
from wrt.kernels.sampling.warps import BELOW_ONE

WAITING = wp.constant(32)
"""Rays of a tree that may wait. Of two the weaker is followed first, which halves what is left: 32 halvings are more
than any limit on attenuation leaves, and what finds no place is not followed."""

REFLECTED = wp.constant(-1.0)
JITTERED = wp.constant(-2.0)
"""`TreeRay.camera_distance` behind a reflection or refraction, and behind a jittered one."""

_Row = wp.types.vector(length=12, dtype=float)
_Rows = wp.types.matrix(shape=(32, 12), dtype=float)
_LongRow = wp.types.vector(length=13 + MOST_BODIES, dtype=float)
_LongRows = wp.types.matrix(shape=(32, 13 + MOST_BODIES), dtype=float)


@wp.struct
class TreeRay:
    """A ray of the tree.

    `eta_scale` is the product of all eta² on the way to it, times the number of jittered rays that it is one of.
    `camera_distance` is that from the camera through what let the ray pass, later REFLECTED or JITTERED. The ray
    begins in the bodies of `medium_stack`, and `origin_gap` behind the surface that it leaves.
    """

    origin: wp.vec3
    direction: wp.vec3
    throughput: wp.vec3
    eta_scale: float
    camera_distance: float
    depth: int
    medium_stack: BodyStack
    origin_gap: float


@wp.struct
class TreeVertex:
    """Where a ray of the tree meets a surface.

    Rays go on from `origin_in_front`, or from `origin_behind` and within the bodies of `stack_behind`. A surface that
    is not `is_solid` is a boundary within a body of higher priority, which light passes.
    """

    hit: Hit
    surface: Surface
    width: float  # of the pixel's cone; 0 where it has none
    origin_in_front: wp.vec3
    origin_behind: wp.vec3
    stack_behind: BodyStack
    is_solid: bool


class WaitingRays(NamedTuple):
    """How rays that wait are kept: `rows`, the type of their stack, and device functions.

    Attributes:
        rows: the type of the stack, a matrix with a row for each ray.
        row_of: (ray) -> its row.
        ray_of: (row) -> TreeRay.
    """

    rows: Any
    row_of: wp.Function
    ray_of: wp.Function


@wp.func
def _row_of(r: TreeRay) -> _Row:
    o = r.origin
    d = r.direction
    t = r.throughput
    return _Row(o[0], o[1], o[2], d[0], d[1], d[2], t[0], t[1], t[2], r.eta_scale, r.camera_distance, float(r.depth))


@wp.func
def _ray_of(row: _Row) -> TreeRay:
    r = TreeRay()
    r.origin = wp.vec3(row[0], row[1], row[2])
    r.direction = wp.vec3(row[3], row[4], row[5])
    r.throughput = wp.vec3(row[6], row[7], row[8])
    r.eta_scale = row[9]
    r.camera_distance = row[10]
    r.depth = int(row[11])
    return r


@wp.func
def _long_row_of(r: TreeRay) -> _LongRow:
    short = _row_of(r)
    row = _LongRow()
    for i in range(12):
        row[i] = short[i]
    row[12] = r.origin_gap
    for i in range(MOST_BODIES):
        row[13 + i] = float(r.medium_stack[i])
    return row


@wp.func
def _ray_of_long(row: _LongRow) -> TreeRay:
    short = _Row()
    for i in range(12):
        short[i] = row[i]
    r = _ray_of(short)
    r.origin_gap = row[12]
    for i in range(MOST_BODIES):
        r.medium_stack[i] = int(row[13 + i])
    return r


def make_waiting_rays(bodies: bool) -> WaitingRays:
    """Return how rays wait; only with `bodies` are these, and the gap behind the surface, kept."""
    if bodies:
        return WaitingRays(_LongRows, _long_row_of, _ray_of_long)
    return WaitingRays(_Rows, _row_of, _ray_of)


@wp.func
def root_of(camera_ray: Ray) -> TreeRay:
    """Return the ray at the root of a tree."""
    root = TreeRay()
    root.origin = camera_ray.origin
    root.direction = camera_ray.direction
    root.throughput = wp.vec3(1.0)
    root.eta_scale = 1.0
    root.depth = 1
    return root


@wp.func
def segment_of(r: TreeRay, time: float) -> Ray:
    """Return a ray of the tree as the ray to trace."""
    ray = Ray()
    ray.origin = r.origin
    ray.direction = r.direction
    ray.time = time
    return ray


@wp.func
def child_ray(parent: TreeRay, throughput: wp.vec3, vertex: TreeVertex, seen: Surface, wi: wp.vec3) -> TreeRay:
    """Return a ray into the local direction `wi`; `seen` is the vertex's surface with its normal map."""
    r = TreeRay()
    r.eta_scale = parent.eta_scale
    r.throughput = throughput
    direction = to_world(seen.frame, wi)
    side = wp.where(wi[2] > 0.0, 1.0, -1.0)
    if not (wp.dot(direction, seen.normal) * wi[2] > 0.0):
        r.throughput = wp.vec3(0.0)
    r.origin = vertex.origin_in_front
    r.medium_stack = parent.medium_stack
    if side < 0.0:
        r.origin = vertex.origin_behind
        r.medium_stack = vertex.stack_behind
    r.direction = wp.normalize(direction)
    r.origin_gap = gap_behind(seen, r.origin, r.direction)
    r.camera_distance = wp.min(parent.camera_distance, REFLECTED)
    r.depth = parent.depth + 1
    return r


@wp.func
def specular_ray(
    parent: TreeRay, part: wp.vec3, vertex: TreeVertex, seen: Surface, lobes: SpecularLobes, wo: wp.vec3, mirrored: bool
) -> TreeRay:
    """Return the mirrored ray or the refracted one; `part` is the parent's throughput, of the part of the material."""
    if mirrored:
        return child_ray(parent, wp.cw_mul(part, lobes.reflected), vertex, seen, wp.vec3(-wo[0], -wo[1], wo[2]))
    r = child_ray(parent, wp.cw_mul(part, lobes.transmitted), vertex, seen, lobes.through)
    r.eta_scale = parent.eta_scale * (lobes.eta * lobes.eta)
    return r


@wp.func
def straight_on(parent: TreeRay, vertex: TreeVertex, share: float) -> TreeRay:
    """Return the ray behind a surface that lets a share of the light pass."""
    r = parent
    if r.camera_distance >= 0.0:
        r.camera_distance = r.camera_distance + wp.length(vertex.origin_behind - r.origin)
    r.origin = vertex.origin_behind
    r.origin_gap = gap_behind(vertex.surface, r.origin, r.direction)
    r.medium_stack = vertex.stack_behind
    r.throughput = r.throughput * share
    return r


class Children(NamedTuple):
    """Device functions for the rays that a ray of the tree sends on where it meets a material.

    Attributes:
        jittered_rays: (bsdf, r, waiting, settings) -> int, how many of them are jittered: several only once on the way,
            and not so many that others could not wait.
        child: (r, part, vertex, seen, bsdf, lobes, wo, k, jittered_rays, sampler, number) -> TreeRay. The first
            children are jittered, each from a stripe of its own of the material's lobe, `number` of the tree's jittered
            rays having gone before; then come the mirrored and the refracted ray, the weaker last.
    """

    jittered_rays: wp.Function
    child: wp.Function


@specialised("models", "sampler")
def make_children(features: Features) -> Children:
    """Return the functions for scenes with these features."""
    bsdf_sample = make_bsdf(features.models).sample
    jittering = models_with(features.models, "jitters")
    model_jitters, jitters = make_is_any(jittering), bool(jittering)
    sample_4d = make_sample_4d(features.sampler)

    @wp.func
    def jittered_rays(bsdf: Bsdf, r: TreeRay, waiting: int, settings: PathSettings) -> int:
        if not model_jitters(bsdf):
            return 0
        if r.camera_distance <= JITTERED:
            return wp.min(settings.jittered_rays, 1)
        return wp.min(settings.jittered_rays, wp.max(1, (WAITING - waiting) / 2))

    @wp.func
    def child(
        r: TreeRay,
        part: wp.vec3,
        vertex: TreeVertex,
        seen: Surface,
        bsdf: Bsdf,
        lobes: SpecularLobes,
        wo: wp.vec3,
        k: int,
        jittered_rays: int,
        sampler: Sampler,
        number: int,
    ) -> TreeRay:
        if wp.static(jitters):
            if k < jittered_rays:
                rays = float(jittered_rays)
                u = sample_4d(sampler, vertex_block(r.depth, BLOCK_BSDF) + wp.uint32(number + k) * BLOCKS_PER_PATH)
                stripe = wp.vec2(wp.min((float(k) + u[0]) / rays, BELOW_ONE), u[1])
                s = bsdf_sample(bsdf, wo, stripe, u[2])
                jittered = child_ray(r, wp.cw_mul(part, s.weight) / rays, vertex, seen, s.wi)
                jittered.eta_scale = r.eta_scale * rays
                jittered.camera_distance = JITTERED
                return jittered
        mirrored_first = wp.max(lobes.reflected) >= wp.max(lobes.transmitted) * (lobes.eta * lobes.eta)
        return specular_ray(r, part, vertex, seen, lobes, wo, mirrored_first == (k == jittered_rays))

    return Children(jittered_rays, child)
