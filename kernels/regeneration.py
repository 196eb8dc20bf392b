"""The kernel of a pass for GPUs: lanes of a warp begin their next paths together, once half of them wait.

If each thread follows its paths in an inner loop, as in `render.py`, threads whose path has ended wait for the longest
one of their warp, at each sample. Here there is one loop: a round begins a path if there is none, follows it to its
next vertex, and adds it to the film if it ended (Novák, Havran and Dachsbacher 2010). Lanes without a path vote, so
that camera rays, which are alike, are traced side by side. The savings are in docs/notes/gpu.md.
"""

from dataclasses import replace

import warp as wp

from wrt.kernels.camera.models import make_camera_sample
from wrt.kernels.core.features import Features
from wrt.kernels.core.specialise import specialised
from wrt.kernels.film.film import is_finite_color
from wrt.kernels.integrators.light_groups import add_to_layers
from wrt.kernels.integrators.path import make_begin_path, make_follow_path
from wrt.kernels.integrators.path_state import PathState, make_path_result
from wrt.kernels.native import include
from wrt.kernels.render import CUDA_BOUNDS, gpu_module, make_render_kernel, of_pass, pixel_of_thread
from wrt.kernels.sampling.sampler import make_sampler_of_pixel

threads_h = include("threads.h")

IDLE_SHARE = wp.constant(2)
"""New paths start once 1/IDLE_SHARE of the lanes with samples left are idle. On an H200 other shares gain up to a fifth
in some scenes and lose a tenth in others, nothing in the mean (docs/notes/cuda.md)."""


@wp.func_native("return wrt::lanes_beside();")
def lanes_beside() -> wp.uint32:
    """Return the lanes that this thread votes with, as bits."""
    threads_h()


@wp.func_native("return wrt::votes(lanes, vote);")
def votes(lanes: wp.uint32, vote: bool) -> wp.uint32:
    """Return those of the lanes that vote yes; each of them has to come here."""
    threads_h()


@wp.func_native("return wrt::number_of(lanes);")
def number_of(lanes: wp.uint32) -> int:
    """Return how many lanes these are."""
    threads_h()


def make_gpu_render_kernel(features: Features, regenerates: bool = True) -> wp.Kernel:
    """Return the kernel for scenes with these features; it regenerates paths if asked to and possible."""
    features = replace(features, gpu=True)
    return (
        make_regenerating_kernel(features) if regenerates and can_regenerate(features) else make_render_kernel(features)
    )


def can_regenerate(features: Features) -> bool:
    """Return whether there is a kernel for these features that regenerates paths."""
    return features.integrator == "path" and not features.aovs and not features.caustics


@specialised()
def make_regenerating_kernel(features: Features) -> wp.Kernel:
    """Return the kernel for scenes with these features, which takes the arguments of `make_render_kernel`."""
    camera_sample = make_camera_sample(features)
    begin_path, advance_path = make_begin_path(features), make_follow_path(features, in_rounds=True)
    sampler_of_pixel, path_result = make_sampler_of_pixel(features.sampler), make_path_result(features)
    module = gpu_module(make_regenerating_kernel.module_name(features))

    @wp.kernel(module=module, enable_backward=False, launch_bounds=CUDA_BOUNDS)
    @of_pass
    def render_pass(first_pixel, target_count, seed, camera, filter_table, scene, settings, film, aovs):
        lanes = lanes_beside()
        pixel = pixel_of_thread(first_pixel + wp.tid(), camera.crop_width, film.count.shape[0] // camera.crop_width)
        x = camera.crop_x + pixel % camera.crop_width
        y = camera.crop_y + pixel // camera.crop_width
        sampler = sampler_of_pixel(seed, settings.is_sobol, x, y, camera.width)
        index = film.count[pixel]
        path = PathState()
        path.is_done = True
        # All lanes stay until the last has no sample left, as all have to vote.
        unfinished = votes(lanes, index < target_count)
        while unfinished != wp.uint32(0):
            waits = path.is_done and index < target_count
            waiting = votes(lanes, waits)
            works = not path.is_done
            if waits and IDLE_SHARE * number_of(waiting) >= number_of(unfinished):
                sampler.index = wp.uint32(index)
                camera_ray = camera_sample(camera, filter_table, sampler, x, y).seen
                path = begin_path(scene, camera_ray.ray, camera_ray.footprint)
                path.is_done = not camera_ray.visible
                works = True
            # No branch around this step, which would keep the path's state twice: 364 bytes of spills.
            path = advance_path(scene, path, sampler, settings)
            if works and path.is_done:
                index += 1
                # To memory at once: sums in registers, twelve for doubles alone, would be spilled.
                result = path_result(path, settings.clamp_indirect)
                film.rays[pixel] = film.rays[pixel] + wp.int64(result.rays)
                if is_finite_color(result.radiance):
                    value = wp.vec3d(result.radiance)
                    film.total[pixel] = film.total[pixel] + value
                    film.total_of_squares[pixel] = film.total_of_squares[pixel] + wp.cw_mul(value, value)
                    if wp.static(features.light_groups):
                        add_to_layers(aovs.sums, pixel, aovs.light_groups, result.groups)
                else:
                    film.rejected[pixel] = film.rejected[pixel] + 1
            unfinished = votes(lanes, index < target_count)
        film.count[pixel] = wp.max(film.count[pixel], target_count)

    return render_pass
