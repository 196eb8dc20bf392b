"""The kernel of a pass: one thread a pixel, as many samples as the pixel still lacks."""

import functools

import warp as wp

from wrt.kernels.camera import Camera, camera_ray, shutter_time
from wrt.kernels.features import Features
from wrt.kernels.film import FilmData, is_finite_color
from wrt.kernels.filters import filter_offset
from wrt.kernels.integrators import make_trace
from wrt.kernels.layers import LayerData, make_add_layers
from wrt.kernels.path import PathResult, PathSettings
from wrt.kernels.sampler import BLOCK_FILM_AND_LENS, BLOCK_TIME, Sampler, make_pixel_name, make_sample_camera
from wrt.kernels.scene_data import SceneData


@functools.cache
def make_render_kernel(features: Features) -> wp.Kernel:
    """Return the kernel for scenes with these features; equal features give the same kernel."""
    trace = make_trace(features)
    add_layers = make_add_layers(features)
    has_layers = features.layers
    sample_camera = make_sample_camera(features.sampler)
    pixel_name = make_pixel_name(features.sampler)

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
        layers: LayerData,
    ):
        pixel = first_pixel + wp.tid()
        # Random numbers belong to a place in the whole picture, so that a part of it looks as it does there.
        x = camera.crop_x + pixel % camera.crop_width
        y = camera.crop_y + pixel // camera.crop_width
        total = film.total[pixel]
        squares = film.total_of_squares[pixel]
        rays = int(0)
        sampler = Sampler()
        sampler.seed = seed
        sampler.pixel = pixel_name(x, y, camera.width)
        for index in range(film.count[pixel], target_count):
            sampler.index = wp.uint32(index)
            u = sample_camera(sampler, BLOCK_FILM_AND_LENS)
            position = wp.vec2(
                float(x) + 0.5 + filter_offset(filter_table, u[0]),
                float(y) + 0.5 + filter_offset(filter_table, u[1]),
            )
            time = camera.shutter_open
            if camera.shutter_close > camera.shutter_open:
                time = shutter_time(camera, sample_camera(sampler, BLOCK_TIME)[0])
            seen = camera_ray(camera, position, wp.vec2(u[2], u[3]), time)
            result = PathResult()
            if seen.visible:
                result = trace(scene, seen.ray, seen.footprint, sampler, settings)
                if wp.static(has_layers):
                    offset = position - wp.vec2(float(x) + 0.5, float(y) + 0.5)
                    rays += add_layers(scene, camera, seen, sampler, layers, pixel, offset)
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
