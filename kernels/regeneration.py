"""The kernel of a pass for GPUs: lanes of a warp begin their next paths together, once half of them wait.

Where each thread follows its paths in a loop of their own, as in `render.py`, those of a warp whose path has ended wait
for the longest one, at each sample. Here there is one loop, a round of which begins a path if there is none, follows it
to its next vertex, and adds it to the film if it ended (Novák, Havran and Dachsbacher 2010). Lanes without a path vote,
so that camera rays, which are alike, are traced side by side. What that saves is in docs/gpu.md.
"""

from dataclasses import replace

import warp as wp

from wrt.kernels.camera.camera import Camera
from wrt.kernels.camera.samples import make_camera_sample
from wrt.kernels.features import Features
from wrt.kernels.film.aovs import AovData
from wrt.kernels.film.film import FilmData, is_finite_color
from wrt.kernels.film.tiles import pixel_of_thread
from wrt.kernels.integrators.path import make_begin_path, make_follow_path
from wrt.kernels.integrators.path_state import PathSettings, PathState, path_result
from wrt.kernels.native import include
from wrt.kernels.render import CUDA_BOUNDS, gpu_module, make_render_kernel
from wrt.kernels.sampling.sampler import make_sampler_of_pixel
from wrt.kernels.scene.scene_data import SceneData
from wrt.kernels.specialise import specialised

votes_h = include("votes.h")

WAITING = wp.constant(2)
"""One of so many lanes that still have samples must wait before those that do begin paths. On an H200 other shares gain
up to a fifth in some scenes and lose a tenth in others, nothing in the mean (docs/notes/cuda.md)."""


@wp.func_native("return wrt::lanes_beside();")
def lanes_beside() -> wp.uint32:
    """Return the lanes that this thread votes with, as bits."""
    votes_h()


@wp.func_native("return wrt::votes(lanes, vote);")
def votes(lanes: wp.uint32, vote: bool) -> wp.uint32:
    """Return those of the lanes that vote yes; each of them has to come here."""
    votes_h()


@wp.func_native("return wrt::number_of(lanes);")
def number_of(lanes: wp.uint32) -> int:
    """Return how many lanes these are."""
    votes_h()


def make_gpu_render_kernel(features: Features, regenerates: bool = True) -> wp.Kernel:
    """Return the kernel for scenes with these features, which may regenerate paths where there are paths alone."""
    features = replace(features, slot_loop=True, shadows_meet=features.opacity and not features.bodies)
    if regenerates and can_regenerate(features):
        return make_regenerating_kernel(features)
    return make_render_kernel(replace(features, tiles=True))


def can_regenerate(features: Features) -> bool:
    """Return whether there is a kernel for these features that regenerates paths."""
    return features.integrator == "path" and not features.aovs


@specialised()
def make_regenerating_kernel(features: Features) -> wp.Kernel:
    """Return the kernel for scenes with these features, which takes the arguments of `make_render_kernel`."""
    camera_sample = make_camera_sample(features)
    begin_path, advance_path = make_begin_path(features), make_follow_path(features, in_rounds=True)
    sampler_of_pixel = make_sampler_of_pixel(features.sampler)
    module = gpu_module(make_regenerating_kernel.module_name(features))

    @wp.kernel(module=module, enable_backward=False, launch_bounds=CUDA_BOUNDS)
    def render_pass(
        first_pixel: int,
        target_count: int,
        seed: wp.uint32,
        camera: Camera,
        filter_table: wp.array(dtype=float),
        scene: SceneData,
        settings: PathSettings,
        film: FilmData,
        aovs: AovData,
    ):
        lanes = lanes_beside()
        pixel = pixel_of_thread(first_pixel + wp.tid(), camera.crop_width, film.count.shape[0] // camera.crop_width)
        x = camera.crop_x + pixel % camera.crop_width
        y = camera.crop_y + pixel // camera.crop_width
        sampler = sampler_of_pixel(seed, x, y, camera.width)
        index = film.count[pixel]
        path = PathState()
        path.is_done = True
        # All lanes stay until the last has no sample left, as all have to vote.
        left = votes(lanes, index < target_count)
        while left != wp.uint32(0):
            waits = path.is_done and index < target_count
            waiting = votes(lanes, waits)
            if waits and WAITING * number_of(waiting) >= number_of(left):
                sampler.index = wp.uint32(index)
                seen = camera_sample(camera, filter_table, sampler, x, y).seen
                path = begin_path(scene, seen.ray, seen.footprint)
                if not seen.visible:
                    path.depth = settings.max_depth
            works = not path.is_done
            if not works:
                # Such a path takes no step. A branch around the step would keep its state twice: 364 bytes of spills.
                path.depth = settings.max_depth
            path = advance_path(scene, path, sampler, settings)
            if works and path.is_done:
                index += 1
                # To memory at once: in registers sums, twelve for doubles alone, would be spilled on the way.
                result = path_result(path, settings.clamp_indirect)
                film.rays[pixel] = film.rays[pixel] + wp.int64(result.rays)
                if is_finite_color(result.radiance):
                    value = wp.vec3d(result.radiance)
                    film.total[pixel] = film.total[pixel] + value
                    film.total_of_squares[pixel] = film.total_of_squares[pixel] + wp.cw_mul(value, value)
                else:
                    film.rejected[pixel] = film.rejected[pixel] + 1
            left = votes(lanes, index < target_count)
        film.count[pixel] = wp.max(film.count[pixel], target_count)

    return render_pass
