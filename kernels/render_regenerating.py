"""The kernel of a pass on CUDA, where a thread begins its next path as soon as one has ended."""

import warp as wp

from wrt.kernels.camera.camera import Camera, shutter_time
from wrt.kernels.camera.models import make_camera
from wrt.kernels.features import Features
from wrt.kernels.film.aovs import AovData
from wrt.kernels.film.film import FilmData, is_finite_color
from wrt.kernels.film.filters import filter_offset
from wrt.kernels.integrators.path import make_begin_path, make_follow_path
from wrt.kernels.integrators.path_state import PathSettings, PathState, path_result
from wrt.kernels.native import include
from wrt.kernels.render import CUDA_BOUNDS, FEW_MODELS
from wrt.kernels.sampling.sampler import BLOCK_FILM_AND_LENS, BLOCK_TIME, Sampler, make_pixel_name, make_sample_camera
from wrt.kernels.scene.scene_data import SceneData
from wrt.kernels.specialise import specialised

opaque_h = include("opaque.h")


@wp.func_native("return wrt::opaque(value);")
def opaque(value: int) -> int:
    """Return the value, of which the compiler knows nothing from here on."""
    opaque_h()


@specialised()
def make_regenerating_kernel(features: Features) -> wp.Kernel:
    """Return the kernel for scenes with these features."""
    camera_ray = make_camera(features.cameras).ray
    begin_path, follow_path = make_begin_path(features), make_follow_path(features, in_rounds=True)
    sample_camera = make_sample_camera(features.sampler)
    pixel_name = make_pixel_name(features.sampler)
    bounds = CUDA_BOUNDS if len(features.models) <= FEW_MODELS else None
    module = wp.get_module(make_regenerating_kernel.module_name(features))

    @wp.kernel(module=module, enable_backward=False, launch_bounds=bounds)
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
        pixel = first_pixel + wp.tid()
        x = camera.crop_x + pixel % camera.crop_width
        y = camera.crop_y + pixel // camera.crop_width
        sampler = Sampler()
        sampler.seed = seed
        sampler.pixel = pixel_name(x, y, camera.width)
        index = film.count[pixel]
        path = PathState()
        path.is_done = True
        while opaque(index) < target_count:
            if opaque(int(path.is_done)) != 0:
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
                path = begin_path(scene, seen.ray, seen.footprint)
                if not seen.visible:
                    path.depth = settings.max_depth
            path = follow_path(scene, path, sampler, settings)
            if path.is_done:
                index += 1
                result = path_result(path, settings.clamp_indirect)
                film.rays[pixel] = film.rays[pixel] + wp.int64(result.rays)
                if is_finite_color(result.radiance):
                    value = wp.vec3d(result.radiance)
                    film.total[pixel] = film.total[pixel] + value
                    film.total_of_squares[pixel] = film.total_of_squares[pixel] + wp.cw_mul(value, value)
                else:
                    film.rejected[pixel] = film.rejected[pixel] + 1
        film.count[pixel] = wp.max(film.count[pixel], target_count)

    return render_pass
