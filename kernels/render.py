"""The kernel of a pass: each thread adds to one pixel the samples that it lacks."""

import inspect
from collections.abc import Callable

import warp as wp

from wrt.kernels.camera.camera import Camera
from wrt.kernels.camera.models import make_camera_sample
from wrt.kernels.core.features import Features
from wrt.kernels.core.scene_data import SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.core.spmd_marks import pixel_kernel
from wrt.kernels.film.film import FilmData, is_finite_color
from wrt.kernels.integrators.aovs import AovData, make_add_aovs
from wrt.kernels.integrators.light_groups import GroupTotals, read_totals, write_totals
from wrt.kernels.integrators.path_state import PathSettings, result_type
from wrt.kernels.integrators.registry import make_trace
from wrt.kernels.sampling.sampler import make_sampler_of_pixel

CUDA_BOUNDS = (256, 2)
"""Threads of a block, and blocks that a multiprocessor is to hold at least.

That caps registers at 128. On an H200 no other choice is faster in the mean: without a cap scenes take 0.9 to 1.5
times as long, with three blocks 0.87 to 1.13 times (docs/notes/cuda.md).
"""


def of_pass(function: Callable[..., None]) -> Callable[..., None]:
    """Annotate the arguments of a kernel of a pass, or of a function that does its work, with their types."""
    types = (int, int, wp.uint32, Camera, wp.array(dtype=float), SceneData, PathSettings, FilmData, AovData)
    function.__annotations__ = dict(zip(inspect.signature(function).parameters, types, strict=True))
    return function


def gpu_module(name: str) -> wp.Module:
    """Return the module of this name, for kernels that run on GPUs alone.

    It is compiled with approximate division and square roots, accurate to two units in the last place, which take half
    of the code: a GPU waits for instructions longer than for anything else (docs/notes/gpu.md).
    """
    module = wp.get_module(name)
    module.options["fast_math"] = True
    return module


TILE_WIDTH = wp.constant(8)
TILE_HEIGHT = wp.constant(4)
"""Pixels of a tile. Tiles of 4 x 8 are as good, those of 16 x 2 worse."""


@wp.func
def pixel_of_thread(thread: int, width: int, height: int) -> int:
    """Return the pixel, row by row, that is the `thread`-th, tile by tile; tiles at the end of a row are narrower."""
    first_row = TILE_HEIGHT * (thread // (TILE_HEIGHT * width))
    rows = wp.min(TILE_HEIGHT, height - first_row)
    in_band = thread - first_row * width
    first_column = TILE_WIDTH * (in_band // (TILE_WIDTH * rows))
    columns = wp.min(TILE_WIDTH, width - first_column)
    in_tile = in_band - first_column * rows
    return (first_row + in_tile // columns) * width + first_column + in_tile % columns


@specialised()
def make_render_kernel(features: Features) -> wp.Kernel:
    """Return the kernel for scenes with these features."""
    camera_sample, trace, add_aovs = make_camera_sample(features), make_trace(features), make_add_aovs(features)
    sampler_of_pixel, Result = make_sampler_of_pixel(features.sampler), result_type(features.light_groups)
    name = make_render_kernel.module_name(features)
    module = gpu_module(name) if features.gpu else wp.get_module(name)

    @wp.kernel(module=module, enable_backward=False, launch_bounds=CUDA_BOUNDS)
    @pixel_kernel
    @of_pass
    def render_pass(first_pixel, target_count, seed, camera, filter_table, scene, settings, film, aovs):
        pixel = first_pixel + wp.tid()
        if wp.static(features.gpu):
            pixel = pixel_of_thread(pixel, camera.crop_width, film.count.shape[0] // camera.crop_width)
        # Random numbers depend on the place in the whole picture, so that a crop looks as it does there.
        x = camera.crop_x + pixel % camera.crop_width
        y = camera.crop_y + pixel // camera.crop_width
        total = film.total[pixel]
        squares = film.total_of_squares[pixel]
        if wp.static(features.light_groups):
            by_group = read_totals(aovs.sums, pixel, aovs.light_groups)
        rays = int(0)
        sampler = sampler_of_pixel(seed, settings.is_sobol, x, y, camera.width)
        for index in range(film.count[pixel], target_count):
            sampler.index = wp.uint32(index)
            sample = camera_sample(camera, filter_table, sampler, x, y)
            camera_ray = sample.seen
            result = Result()
            if camera_ray.visible:
                result = trace(scene, camera_ray.ray, camera_ray.footprint, sampler, settings)
                if wp.static(features.aovs):
                    offset = sample.position - wp.vec2(float(x) + 0.5, float(y) + 0.5)
                    rays += add_aovs(scene, camera, camera_ray, sampler, aovs, pixel, offset, result.radiance)
            rays += result.rays
            if is_finite_color(result.radiance):
                value = wp.vec3d(result.radiance)
                total += value
                squares += wp.cw_mul(value, value)
                if wp.static(features.light_groups):
                    by_group += GroupTotals(result.groups)
            else:
                film.rejected[pixel] = film.rejected[pixel] + 1
        film.total[pixel] = total
        film.total_of_squares[pixel] = squares
        if wp.static(features.light_groups):
            write_totals(aovs.sums, pixel, aovs.light_groups, by_group)
        film.count[pixel] = wp.max(film.count[pixel], target_count)
        film.rays[pixel] = film.rays[pixel] + wp.int64(rays)

    return render_pass
