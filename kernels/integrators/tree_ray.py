"""Rays of a ray tree, and those of them that wait to be followed."""

from typing import Any, NamedTuple

import warp as wp

from wrt.kernels.bsdf import make_bsdf, make_is_any, models_with
from wrt.kernels.core.bsdf import Bsdf, SpecularLobes
from wrt.kernels.core.features import Features
from wrt.kernels.core.rays import Ray, to_world
from wrt.kernels.core.scene_data import MOST_BODIES, BodyStack
from wrt.kernels.core.specialise import specialised
from wrt.kernels.geometry.surface import Surface, gap_behind
from wrt.kernels.integrators.path_state import PathSettings, SurfaceVertex
from wrt.kernels.sampling.sampler import BLOCK_BSDF, BLOCKS_PER_PATH, Sampler, make_sample_4d, vertex_block
from wrt.kernels.sampling.warps import BELOW_ONE

WAITING = wp.constant(32)
"""Most rays of a tree that wait. Of two the weaker is followed first, which halves the rest: 32 halvings are more than
any limit on attenuation allows, and rays beyond are not followed."""

REFLECTED = wp.constant(-1.0)
JITTERED = wp.constant(-2.0)
"""`TreeRay.camera_distance` behind a reflection or refraction, and behind a jittered one."""


@wp.struct
class TreeRay:
    """A ray of the tree.

    `eta_scale` is the product of all eta² up to it, times the number of jittered rays that share its vertex.
    `camera_distance` is the straight distance from the camera, later REFLECTED or JITTERED. The ray begins in the
    bodies of `medium_stack`, and `origin_gap` behind the surface that it leaves.
    """

    origin: wp.vec3
    direction: wp.vec3
    throughput: wp.vec3
    eta_scale: float
    camera_distance: float
    depth: int
    medium_stack: BodyStack
    origin_gap: float


@specialised()
def make_waiting_rays(bodies: bool) -> tuple[Any, wp.Function, wp.Function]:
    """Return the type of the stack of rays that wait, a matrix, and functions from a TreeRay to its row and back.

    Only with `bodies` does it keep these, and the gap behind the surface.
    """
    length = 13 + MOST_BODIES if bodies else 12
    row_type = wp.types.vector(length=length, dtype=float)

    @wp.func
    def row_of(r: TreeRay) -> row_type:
        row = row_type()
        for i in range(3):
            row[i] = r.origin[i]
            row[3 + i] = r.direction[i]
            row[6 + i] = r.throughput[i]
        row[9] = r.eta_scale
        row[10] = r.camera_distance
        row[11] = float(r.depth)
        if wp.static(bodies):
            row[12] = r.origin_gap
            for i in range(MOST_BODIES):
                row[13 + i] = float(r.medium_stack[i])
        return row

    @wp.func
    def ray_of(row: row_type) -> TreeRay:
        r = TreeRay()
        r.origin = wp.vec3(row[0], row[1], row[2])
        r.direction = wp.vec3(row[3], row[4], row[5])
        r.throughput = wp.vec3(row[6], row[7], row[8])
        r.eta_scale = row[9]
        r.camera_distance = row[10]
        r.depth = int(row[11])
        if wp.static(bodies):
            r.origin_gap = row[12]
            for i in range(MOST_BODIES):
                r.medium_stack[i] = int(row[13 + i])
        return r

    return wp.types.matrix(shape=(int(WAITING), length), dtype=float), row_of, ray_of


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
def child_ray(parent: TreeRay, throughput: wp.vec3, vertex: SurfaceVertex, mapped: Surface, wi: wp.vec3) -> TreeRay:
    """Return a ray into the local direction `wi`; `mapped` is the vertex's surface with its normal map."""
    r = TreeRay()
    r.eta_scale = parent.eta_scale
    r.throughput = throughput
    direction = to_world(mapped.frame, wi)
    side = wp.where(wi[2] > 0.0, 1.0, -1.0)
    if not (wp.dot(direction, mapped.normal) * wi[2] > 0.0):
        r.throughput = wp.vec3(0.0)
    r.origin = vertex.origin_in_front
    r.medium_stack = parent.medium_stack
    if side < 0.0:
        r.origin = vertex.origin_behind
        r.medium_stack = vertex.medium_stack_behind
    r.direction = wp.normalize(direction)
    r.origin_gap = gap_behind(mapped, r.origin, r.direction)
    r.camera_distance = wp.min(parent.camera_distance, REFLECTED)
    r.depth = parent.depth + 1
    return r


@wp.func
def specular_ray(
    parent: TreeRay,
    part: wp.vec3,
    vertex: SurfaceVertex,
    mapped: Surface,
    lobes: SpecularLobes,
    wo: wp.vec3,
    mirrored: bool,
) -> TreeRay:
    """Return the mirrored ray or the refracted one; `part` is the parent's throughput, of the part of the material."""
    if mirrored:
        return child_ray(parent, wp.cw_mul(part, lobes.reflected), vertex, mapped, wp.vec3(-wo[0], -wo[1], wo[2]))
    r = child_ray(parent, wp.cw_mul(part, lobes.transmitted), vertex, mapped, lobes.through)
    r.eta_scale = parent.eta_scale * (lobes.eta * lobes.eta)
    return r


@wp.func
def straight_on(parent: TreeRay, vertex: SurfaceVertex, share: float) -> TreeRay:
    """Return the ray behind a surface that lets a share of the light pass."""
    r = parent
    if r.camera_distance >= 0.0:
        r.camera_distance = r.camera_distance + wp.length(vertex.origin_behind - r.origin)
    r.origin = vertex.origin_behind
    r.origin_gap = gap_behind(vertex.surface, r.origin, r.direction)
    r.medium_stack = vertex.medium_stack_behind
    r.throughput = r.throughput * share
    return r


class Children(NamedTuple):
    """Device functions for the rays that a ray of the tree sends on where it meets a material.

    Attributes:
        jittered_rays: (bsdf, r, waiting, settings) -> int, the number of jittered ones: several only at the first
            jittering surface, and few enough to leave room in the stack.
        child: (r, part, vertex, mapped, bsdf, lobes, wo, k, jittered_rays, sampler, number) -> TreeRay. The first
            children are jittered, each from its own stripe of the material's lobe, after `number` earlier jittered rays
            of the tree; then come the mirrored and the refracted ray, the weaker last.
    """

    jittered_rays: wp.Function
    child: wp.Function


@specialised("models", "sampler")
def make_children(features: Features) -> Children:
    """Return the functions for scenes with these features."""
    bsdf_sample = make_bsdf(features.models).sample
    jittering = models_with(features.models, "jitters")
    model_jitters = make_is_any(jittering)
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
        vertex: SurfaceVertex,
        mapped: Surface,
        bsdf: Bsdf,
        lobes: SpecularLobes,
        wo: wp.vec3,
        k: int,
        jittered_rays: int,
        sampler: Sampler,
        number: int,
    ) -> TreeRay:
        if wp.static(bool(jittering)):
            if k < jittered_rays:
                rays = float(jittered_rays)
                u = sample_4d(sampler, vertex_block(r.depth, BLOCK_BSDF) + wp.uint32(number + k) * BLOCKS_PER_PATH)
                stripe = wp.vec2(wp.min((float(k) + u[0]) / rays, BELOW_ONE), u[1])
                s = bsdf_sample(bsdf, wo, stripe, u[2])
                jittered = child_ray(r, wp.cw_mul(part, s.weight) / rays, vertex, mapped, s.wi)
                jittered.eta_scale = r.eta_scale * rays
                jittered.camera_distance = JITTERED
                return jittered
        mirrored_first = wp.max(lobes.reflected) >= wp.max(lobes.transmitted) * (lobes.eta * lobes.eta)
        return specular_ray(r, part, vertex, mapped, lobes, wo, mirrored_first == (k == jittered_rays))

    return Children(jittered_rays, child)
