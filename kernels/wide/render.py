"""The kernel of a pass for the CPU: sixteen threads at once, a square of pixels for each of Warp's."""

import functools
import re

import warp as wp

from wrt.kernels.camera import Camera
from wrt.kernels.features import Features
from wrt.kernels.film import FilmData
from wrt.kernels.layers import LayerData
from wrt.kernels.path import PathSettings
from wrt.kernels.render import make_render_kernel
from wrt.kernels.scene_data import SceneData

TILE = 16
"""Pixels along each side of a square."""

AT_FILE_LEVEL = """
    return 0;
}
CODE
static inline int end_of_wide_code() {
    return 0;
"""
"""The text of a native function in whose place `CODE` stands at file level: the braces around it are closed first."""


def module_name(features: Features) -> str:
    """Return the name of the module that holds the kernel for these features."""
    return f"wrt.render.wide.{features.name}"


def make_wide_render_kernel(features: Features) -> wp.Kernel:
    """Return the kernel for scenes with these features; a film has the same bits as after `make_render_kernel`.

    Raises:
        Unsupported: where there is none.
    """
    from wrt.kernels.wide.translate import wide_code

    return declare_wide_render_kernel(features, with_few_slots(wide_code(make_render_kernel(features)), features))


def with_few_slots(code: str, features: Features) -> str:
    """Return C++ in which a material has as many values as the scene's models read, instead of all that one may.

    Those are 3 KB in sixteen lanes, copied several times at each surface: glossy 1.02, textures 1.04.
    """
    from wrt.kernels.bsdf import model_of
    from wrt.kernels.bsdf.record import MAX_SLOTS

    slots = max((model_of(name).slots for name in features.models), default=0)
    return re.sub(rf"(Matrix|mat_t|make_mat)<{MAX_SLOTS}, ?3,", rf"\g<1><{max(slots, 1)}, 3,", code)


@functools.cache
def declare_wide_render_kernel(features: Features, code: str) -> wp.Kernel:
    """Return the kernel with the C++ of `wide_code`; with none where it was compiled before and is only loaded."""

    @wp.func_native(AT_FILE_LEVEL.replace("CODE", code))
    def declare_wide_code() -> int: ...

    @wp.func_native("""
    const int width = camera.crop_width, height = (int)film.count.shape[0] / width;
    render_tile(tile, width, height, 0, target_count, seed, camera, filter_table, scene, settings, film, layers);
    """)
    def render_tile(
        tile: int,
        target_count: int,
        seed: wp.uint32,
        camera: Camera,
        filter_table: wp.array(dtype=float),
        scene: SceneData,
        settings: PathSettings,
        film: FilmData,
        layers: LayerData,
    ): ...

    @wp.kernel(module=wp.get_module(module_name(features)), enable_backward=False)
    def render_tiles(
        first_tile: int,
        target_count: int,
        seed: wp.uint32,
        camera: Camera,
        filter_table: wp.array(dtype=float),
        scene: SceneData,
        settings: PathSettings,
        film: FilmData,
        layers: LayerData,
    ):
        if declare_wide_code() == 0:
            render_tile(first_tile + wp.tid(), target_count, seed, camera, filter_table, scene, settings, film, layers)

    return render_tiles
