"""The kernel of a pass: one thread a pixel, as many samples as the pixel still lacks."""

import functools

import warp as wp

from wrt.kernels.camera import Camera, camera_ray, pixel_angle
from wrt.kernels.features import Features
from wrt.kernels.film import FilmData, is_finite_color
from wrt.kernels.filters import filter_offset
from wrt.kernels.path import PathSettings, make_trace_path
from wrt.kernels.sampler import BLOCK_FILM_AND_LENS, Sampler, sample_4d
from wrt.kernels.scene_data import SceneData


@functools.cache
def make_render_kernel(features: Features) -> wp.Kernel:
    """Return the kernel for scenes with these features; equal features give the same kernel."""
    trace_path = make_trace_path(features)

    # Named, not "unique": the name alone must keep variants apart, whatever Warp's hash sees.
    module = wp.get_module(f"wrt.render.{features.name}")

    @wp.kernel(module=module, enable_backward=False)
    def render_pass(
        first_pixel: int,
        target_count: int,
        seed: wp.uint32,
        camera: Camera,
        filter_table: wp.array(dtype=float),
        scene: SceneData,
        settings: PathSettings,
        film: FilmData,
    ):
        pixel = first_pixel + wp.tid()
        x = pixel % camera.width
        y = pixel // camera.width
        total = film.total[pixel]
        squares = film.total_of_squares[pixel]
        rays = int(0)
        sampler = Sampler()
        sampler.seed = seed
        sampler.pixel = wp.uint32(pixel)
        for index in range(film.count[pixel], target_count):
            sampler.index = wp.uint32(index)
            u = sample_4d(sampler, BLOCK_FILM_AND_LENS)
            position = wp.vec2(
                float(x) + 0.5 + filter_offset(filter_table, u[0]),
                float(y) + 0.5 + filter_offset(filter_table, u[1]),
            )
            ray = camera_ray(camera, position, wp.vec2(u[2], u[3]))
            result = trace_path(scene, ray, pixel_angle(camera, ray.direction), sampler, settings)
            rays += result.rays
            if is_finite_color(result.radiance):
                value = wp.vec3d(result.radiance)
                total += value
                squares += wp.cw_mul(value, value)
            else:
                film.rejected[pixel] = film.rejected[pixel] + 1
        film.total[pixel] = total
        film.total_of_squares[pixel] = squares
        film.count[pixel] = wp.max(film.count[pixel], target_count)
        film.rays[pixel] = film.rays[pixel] + wp.int64(rays)

    return render_pass
