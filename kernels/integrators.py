"""Integrators by name: what a camera ray becomes."""

from collections.abc import Callable

import warp as wp

from wrt.kernels.features import Features
from wrt.kernels.geometry import Ray
from wrt.kernels.path import PathResult, PathSettings, make_trace_path
from wrt.kernels.sampler import Sampler
from wrt.kernels.scene_data import SceneData


@wp.func
def trace_nothing(
    scene: SceneData, camera_ray: Ray, pixel_footprint: wp.vec2, sampler: Sampler, settings: PathSettings
) -> PathResult:
    """Return black, for pictures of layers alone."""
    result = PathResult()
    result.radiance = wp.vec3(0.0)
    result.rays = 0
    return result


def _make_trace_tree(features: Features) -> wp.Function:
    from wrt.kernels.whitted import make_trace_tree

    return make_trace_tree(features)


def _make_trace_occlusion(features: Features) -> wp.Function:
    from wrt.kernels.ambient_occlusion import make_trace_occlusion

    return make_trace_occlusion(features)


INTEGRATORS: dict[str, Callable[[Features], wp.Function]] = {
    "path": make_trace_path,
    "whitted": _make_trace_tree,
    "ao": _make_trace_occlusion,
    "aov": lambda features: trace_nothing,
}


def make_trace(features: Features) -> wp.Function:
    """Return the device function (scene, camera_ray, pixel_angle, sampler, settings) -> PathResult."""
    return INTEGRATORS[features.integrator](features)
