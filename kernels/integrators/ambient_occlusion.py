"""Ambient occlusion: how much of the sky a point would see, were there only what lies near it.

A = ∫ V(ω) |cosθ| / π dω over the hemisphere about the shading normal, V being 0 where anything lies within the
distance limit and 1 elsewhere (Zhukov, Iones and Kronin 1998, "An ambient light illumination model", with a step for
their falloff; Landis 2002). Directions are drawn by the cosine, so each sample is 0 or 1.
"""

import dataclasses

import warp as wp

from wrt.kernels.core.features import Features
from wrt.kernels.core.ray_tree import NO_HIT, nowhere
from wrt.kernels.core.rays import Ray, to_world
from wrt.kernels.core.scene_data import BodyStack, SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.core.spmd_marks import traces_alone
from wrt.kernels.geometry.surface import leave_in_front
from wrt.kernels.integrators.first_surface import make_first_surface
from wrt.kernels.integrators.path_state import PathResult, PathSettings
from wrt.kernels.integrators.shadow_rays import make_visibility
from wrt.kernels.media.skin import no_skin
from wrt.kernels.sampling.sampler import BLOCK_BSDF, Sampler, make_sample_4d, vertex_block
from wrt.kernels.sampling.warps import square_to_cosine_hemisphere


@specialised()
def make_trace_occlusion(features: Features) -> wp.Function:
    """Return the device function that asks one direction at the first surface; white where the ray meets none."""
    sample_4d = make_sample_4d(features.sampler)
    first_surface = make_first_surface(features)
    # Panes hide the sky as everything does, whatever else the kernel knows of their glass.
    visibility = make_visibility(dataclasses.replace(features, models=()))

    @wp.func
    @traces_alone
    def trace_occlusion(
        scene: SceneData, camera_ray: Ray, pixel_footprint: wp.vec2, sampler: Sampler, settings: PathSettings
    ) -> PathResult:
        first = first_surface(scene, camera_ray, pixel_footprint, sampler)
        result = PathResult()
        result.rays = first.rays
        result.radiance = wp.vec3(1.0)
        if first.hit.triangle == NO_HIT:
            if settings.hides_lights != 0:
                result.radiance = wp.vec3(0.0)
            return result
        result.radiance = wp.vec3(0.0)
        u = sample_4d(sampler, vertex_block(1, BLOCK_BSDF))
        ray = Ray()
        ray.direction = to_world(first.surface.frame, square_to_cosine_hemisphere(wp.vec2(u[0], u[1])))
        if wp.dot(ray.direction, first.surface.normal) > 0.0:
            ray.origin = leave_in_front(first.surface, camera_ray.origin, camera_ray.direction)
            ray.time = camera_ray.time
            result.radiance = visibility(scene, ray, settings.ao_distance, nowhere(), BodyStack(), no_skin(), u)
            result.rays = result.rays + 1
        return result

    return trace_occlusion
