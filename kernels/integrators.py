"""Integrators by name: what a camera ray becomes."""

import functools
import importlib

import warp as wp

from wrt.kernels.features import Features
from wrt.kernels.geometry import Ray
from wrt.kernels.path import PathResult, PathSettings
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


INTEGRATORS = {
    "path": ("wrt.kernels.path", "make_trace_path"),
    "whitted": ("wrt.kernels.whitted", "make_trace_tree"),
    "ao": ("wrt.kernels.ambient_occlusion", "make_trace_occlusion"),
    "aov": ("wrt.kernels.integrators", "make_trace_nothing"),
}
"""Module and factory of each; imported when asked for, as most pictures need one of them."""


def make_trace_nothing(features: Features) -> wp.Function:
    """Return the device function that traces no paths, whatever the scene has."""
    del features
    return trace_nothing


@functools.cache
def make_trace(features: Features) -> wp.Function:
    """Return the device function (scene, camera_ray, pixel_angle, sampler, settings) -> PathResult."""
    module, factory = INTEGRATORS[features.integrator]
    function: wp.Function = getattr(importlib.import_module(module), factory)(features)
    return function
