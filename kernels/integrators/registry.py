"""Integrators by name: what a camera ray becomes."""

import warp as wp

from wrt.kernels.core.features import Features
from wrt.kernels.core.rays import Ray
from wrt.kernels.core.scene_data import SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.integrators.path_state import PathResult, PathSettings
from wrt.kernels.sampling.sampler import Sampler


@wp.func
def trace_nothing(
    scene: SceneData, camera_ray: Ray, pixel_footprint: wp.vec2, sampler: Sampler, settings: PathSettings
) -> PathResult:
    """Return black, for pictures of layers alone."""
    result = PathResult()
    result.radiance = wp.vec3(0.0)
    result.rays = 0
    return result


INTEGRATORS = ("path", "whitted", "ao", "aov")


@specialised()
def make_trace(features: Features) -> wp.Function:
    """Return the device function (scene, camera_ray, pixel_angle, sampler, settings) -> PathResult."""
    if features.integrator == "aov":
        return trace_nothing
    # Imported when used, as most pictures need one of them.
    if features.integrator == "path":
        from wrt.kernels.integrators.path import make_trace_path as make
    elif features.integrator == "whitted":
        from wrt.kernels.integrators.whitted import make_trace_tree as make
    elif features.integrator not in INTEGRATORS:
        from wrt.kernels.integrators.own import make_trace_own as make
    else:
        from wrt.kernels.integrators.ambient_occlusion import make_trace_occlusion as make
    return make(features)
