"""The kernels of gradients: each thread adds the derivatives of the samples of one pixel."""

import inspect
from collections.abc import Callable
from typing import Literal

import warp as wp

from wrt.kernels.camera.camera import Camera
from wrt.kernels.camera.models import make_camera_sample
from wrt.kernels.core.features import Features
from wrt.kernels.core.scene_data import SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.core.spmd_marks import pixel_kernel
from wrt.kernels.film.film import is_finite_color
from wrt.kernels.gradients.replay import make_replay_path
from wrt.kernels.gradients.sums import GradientSums
from wrt.kernels.integrators.path import make_trace_path
from wrt.kernels.integrators.path_state import PathSettings
from wrt.kernels.sampling.sampler import make_sampler_of_pixel

Colors = wp.array(dtype=wp.vec3)


def of_gradients(function: Callable[..., None]) -> Callable[..., None]:
    """Annotate the arguments of a kernel of gradients, or of a function that does its work, with their types."""
    types = (int, int, int, wp.uint32, Camera, wp.array(dtype=float), SceneData, PathSettings)
    types += (Colors, Colors, GradientSums)
    function.__annotations__ = dict(zip(inspect.signature(function).parameters, types, strict=True))
    return function


@specialised()
def make_gradient_kernel(
    features: Features, part: Literal["both", "radiance", "replay", "vertices", "index"] = "both"
) -> wp.Kernel:
    """Return the kernel for scenes with these features, of a path tracer without clamping.

    It takes the arguments of a render kernel, except the first and the last sample. In place of the film it takes
    `upstream`, the derivative of the loss by the radiance of each sample, and `radiances`. Wide kernels do one `part`
    each: "radiance" writes what paths find to `radiances`, those of a pixel side by side, and "replay" reads it.
    "vertices" does both, and has derivatives by vertices and normals as well, and "index" that by the index of one
    smooth glass.
    """
    camera_sample, sampler_of_pixel = make_camera_sample(features), make_sampler_of_pixel(features.sampler)
    by = part if part in ("vertices", "index") else "values"
    trace_path, replay_path = make_trace_path(features), make_replay_path(features, by=by)
    module = wp.get_module(f"{make_gradient_kernel.module_name(features)}.{part}")
    traces, replays = part != "replay", part != "radiance"

    @wp.kernel(module=module, enable_backward=False)
    @pixel_kernel
    @of_gradients
    def gradient_pass(first_pixel, first, last, seed, camera, filter_table, scene, settings, upstream, radiances, sums):
        pixel = first_pixel + wp.tid()
        x = camera.crop_x + pixel % camera.crop_width
        y = camera.crop_y + pixel // camera.crop_width
        weight = upstream[pixel]
        sampler = sampler_of_pixel(seed, settings.is_sobol, x, y, camera.width)
        for index in range(first, last):
            sampler.index = wp.uint32(index)
            seen = camera_sample(camera, filter_table, sampler, x, y).seen
            place = pixel * (last - first) + index - first
            if seen.visible and wp.max(wp.abs(weight)) > 0.0:
                if wp.static(traces):
                    radiance = trace_path(scene, seen.ray, seen.footprint, sampler, settings).radiance
                    if wp.static(not replays):
                        radiances[place] = radiance
                else:
                    radiance = radiances[place]
                if wp.static(replays):
                    if is_finite_color(radiance):  # a picture leaves others out, too
                        replay_path(sums, scene, seen.ray, seen.footprint, sampler, settings, radiance, weight)

    return gradient_pass
