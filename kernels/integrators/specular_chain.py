"""What a camera ray sees in mirrors and through glass: the guides of a denoiser follow it there.

Smooth surfaces have no texture of their own. A denoiser keeps the edges that albedo and normals show, so these must be
those of what is seen in the surface (Open Image Denoise, documentation, "Albedos" and "Normals").
"""

import warp as wp

from wrt.kernels.accel.intersect import NO_HIT
from wrt.kernels.bsdf import make_bsdf
from wrt.kernels.features import Features
from wrt.kernels.geometry.rays import Ray, to_local, to_world
from wrt.kernels.geometry.surface import leave, leave_in_front
from wrt.kernels.integrators.first_surface import FirstSurface, make_first_surface
from wrt.kernels.sampling.sampler import BLOCK_BSDF, Sampler, make_sample_4d, vertex_block
from wrt.kernels.scene.materials import disperses, make_bsdf_at, make_with_throughput
from wrt.kernels.scene.scene_data import SceneData
from wrt.kernels.specialise import specialised

MOST_BOUNCES = wp.constant(8)
"""Smooth surfaces on a camera ray; what is behind more of them counts as nothing."""


@wp.struct
class SpecularChain:
    """The first surface that is not smooth, from which direction it is seen, and how the smooth ones colour it."""

    first: FirstSurface
    direction: wp.vec3
    tint: wp.vec3


@specialised(*make_first_surface.fields, "models", *make_bsdf_at.fields)
def make_follow_specular(features: Features) -> wp.Function:
    """Return the device function (scene, first, camera_ray, sampler) -> SpecularChain; `first` is on the camera ray.

    At each smooth surface one direction is chosen at random, as by a path.
    """
    first_surface = make_first_surface(features)
    bsdfs = make_bsdf(features.models)
    bsdf_sample, bsdf_is_delta = bsdfs.sample, bsdfs.is_delta
    bsdf_at = make_bsdf_at(features)
    dispersive, with_throughput = disperses(features.models), make_with_throughput(features.models)
    sample_4d = make_sample_4d(features.sampler)

    @wp.func
    def follow_specular(scene: SceneData, begin: FirstSurface, camera_ray: Ray, sampler: Sampler) -> SpecularChain:
        chain = SpecularChain()
        chain.first = begin
        chain.direction = camera_ray.direction
        origin = camera_ray.origin
        chain.tint = wp.vec3(1.0)
        rays = int(begin.rays)
        bounces = int(0)
        following = bool(True)
        while following:
            following = False
            if chain.first.hit.triangle != NO_HIT:
                surface = chain.first.surface
                bsdf = bsdf_at(scene, chain.first.material, surface)
                if wp.static(dispersive):
                    bsdf = with_throughput(bsdf, chain.tint)
                if bsdf_is_delta(bsdf):
                    u = sample_4d(sampler, vertex_block(bounces + 1, BLOCK_BSDF))
                    s = bsdf_sample(bsdf, to_local(surface.frame, -chain.direction), wp.vec2(u[0], u[1]), u[2])
                    bounces += 1
                    chain.tint = wp.cw_mul(chain.tint, s.weight * (s.eta * s.eta))
                    following = bounces <= MOST_BOUNCES and wp.max(chain.tint) > 0.0
                    chain.first.hit.triangle = NO_HIT
                    if following:
                        ray = Ray()
                        ray.origin = leave(surface, -1.0)
                        if s.wi[2] > 0.0:
                            ray.origin = leave_in_front(surface, origin, chain.direction)
                        ray.direction = wp.normalize(to_world(surface.frame, s.wi))
                        ray.time = camera_ray.time
                        chain.direction = ray.direction
                        origin = ray.origin
                        chain.first = first_surface(scene, ray, wp.vec2(0.0), sampler)
                        rays += chain.first.rays
        chain.first.rays = rays
        return chain

    return follow_specular
