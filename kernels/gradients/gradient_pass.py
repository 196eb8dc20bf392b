"""The kernel of gradients: each thread adds the derivatives of the samples of one pixel."""

import warp as wp

from wrt.kernels.camera.camera import Camera
from wrt.kernels.camera.models import make_camera_sample
from wrt.kernels.core.features import Features
from wrt.kernels.core.scene_data import SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.film.film import is_finite_color
from wrt.kernels.gradients.replay import make_replay_path
from wrt.kernels.gradients.sums import GradientSums
from wrt.kernels.integrators.path import make_begin_path, make_trace_path
from wrt.kernels.integrators.path_state import PathSettings
from wrt.kernels.sampling.sampler import make_sampler_of_pixel


@specialised()
def make_gradient_kernel(features: Features) -> wp.Kernel:
    """Return the kernel for scenes with these features, of a path tracer without clamping.

    It takes the arguments of a render kernel, except for the first and the last sample; `upstream`, the derivative of
    the loss by the radiance of each sample, stands in place of the film.
    """
    camera_sample, sampler_of_pixel = make_camera_sample(features), make_sampler_of_pixel(features.sampler)
    begin_path, trace_path = make_begin_path(features), make_trace_path(features)
    replay_path = make_replay_path(features)
    module = wp.get_module(make_gradient_kernel.module_name(features))

    @wp.kernel(module=module, enable_backward=False)
    def gradient_pass(
        first_pixel: int,
        first: int,
        last: int,
        seed: wp.uint32,
        camera: Camera,
        filter_table: wp.array(dtype=float),
        scene: SceneData,
        settings: PathSettings,
        upstream: wp.array(dtype=wp.vec3),
        sums: GradientSums,
    ):
        pixel = first_pixel + wp.tid()
        x = camera.crop_x + pixel % camera.crop_width
        y = camera.crop_y + pixel // camera.crop_width
        weight = upstream[pixel]
        sampler = sampler_of_pixel(seed, x, y, camera.width)
        for index in range(first, last):
            sampler.index = wp.uint32(index)
            seen = camera_sample(camera, filter_table, sampler, x, y).seen
            if seen.visible and wp.max(wp.abs(weight)) > 0.0:
                radiance = trace_path(scene, seen.ray, seen.footprint, sampler, settings).radiance
                if is_finite_color(radiance):  # a picture leaves others out, too
                    path = begin_path(scene, seen.ray, seen.footprint)
                    replay_path(sums, scene, path, sampler, settings, radiance, weight)

    return gradient_pass
