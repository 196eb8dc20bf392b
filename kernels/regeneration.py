"""A kernel of a pass for GPUs, on trial: a thread begins its next path as soon as one has ended.

Where each thread follows its paths in a loop of their own, as in `render.py`, those of a warp whose path has ended wait
for the longest one, at each sample. Here there is one loop, a round of which begins a path if there is none, follows it
to its next vertex, and adds it to the film if it ended (Novák, Havran and Dachsbacher 2010). Rays of a warp are then
less alike, and counts are for it in small scenes alone (docs/gpu.md): `WRT_REGENERATE=1` chooses it.
"""

import warp as wp

from wrt.kernels.camera.camera import Camera
from wrt.kernels.camera.samples import make_camera_sample
from wrt.kernels.features import Features
from wrt.kernels.film.aovs import AovData
from wrt.kernels.film.film import FilmData, is_finite_color
from wrt.kernels.integrators.path import make_begin_path, make_follow_path
from wrt.kernels.integrators.path_state import PathSettings, PathState, path_result
from wrt.kernels.render import launch_bounds, make_render_kernel
from wrt.kernels.sampling.sampler import Sampler, make_pixel_name
from wrt.kernels.scene.scene_data import SceneData
from wrt.kernels.specialise import specialised


def make_gpu_render_kernel(features: Features) -> wp.Kernel:
    """Return the kernel for scenes with these features that regenerates paths, where there are paths alone."""
    if features.integrator == "path" and not features.aovs:
        return make_regenerating_kernel(features)
    return make_render_kernel(features)


@specialised()
def make_regenerating_kernel(features: Features) -> wp.Kernel:
    """Return the kernel for scenes with these features, which takes the arguments of `make_render_kernel`."""
    camera_sample = make_camera_sample(features)
    begin_path, advance_path = make_begin_path(features), make_follow_path(features, in_rounds=True)
    pixel_name = make_pixel_name(features.sampler)
    module = wp.get_module(make_regenerating_kernel.module_name(features))

    @wp.kernel(module=module, enable_backward=False, launch_bounds=launch_bounds(features))
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
        # The last sample is noticed here, where all lanes come by in each round. Where a path ends, a way out of the
        # loop would keep the lanes that take it from meeting the others before the end of the kernel.
        while index < target_count:
            if path.is_done:
                sampler.index = wp.uint32(index)
                seen = camera_sample(camera, filter_table, sampler, x, y).seen
                path = begin_path(scene, seen.ray, seen.footprint)
                if not seen.visible:
                    path.depth = settings.max_depth
            path = advance_path(scene, path, sampler, settings)
            if path.is_done:
                index += 1
                # To memory at once: sums in registers, twelve of them for doubles alone, would be spilled on the way.
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
