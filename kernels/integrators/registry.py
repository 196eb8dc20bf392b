"""Integrators by name: what a camera ray becomes."""

import importlib

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


INTEGRATORS = {
    "path": ("wrt.kernels.integrators.path", "make_trace_path"),
    "whitted": ("wrt.kernels.integrators.whitted", "make_trace_tree"),
    "ao": ("wrt.kernels.integrators.ambient_occlusion", "make_trace_occlusion"),
    "aov": ("wrt.kernels.integrators.registry", "make_trace_nothing"),
}
"""Module and factory of each; imported when asked for, as most pictures need one of them."""


def make_trace_nothing(features: Features) -> wp.Function:
    """Return the device function that traces no paths, whatever the scene has."""
    del features
    return trace_nothing


@specialised()
def make_trace(features: Features) -> wp.Function:
    """Return the device function (scene, camera_ray, pixel_angle, sampler, settings) -> PathResult."""
    module, factory = INTEGRATORS[features.integrator]
    function: wp.Function = getattr(importlib.import_module(module), factory)(features)
    return function
