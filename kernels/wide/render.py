"""The kernel of a pass for the CPU: sixteen threads at once, a square of pixels for each of Warp's."""

import functools
import hashlib
from typing import Any

import warp as wp
from warp._src.codegen import StructInstance

from wrt.kernels.camera import Camera
from wrt.kernels.features import Features
from wrt.kernels.film import FilmData
from wrt.kernels.layers import LayerData
from wrt.kernels.path import PathSettings
from wrt.kernels.render import make_render_kernel
from wrt.kernels.scene_data import SceneData
from wrt.kernels.wide.translate import wide_code

AT_FILE_LEVEL = """
    return 0;
}
CODE
static inline int end_of_wide_code() {
    return 0;
"""
"""The text of a native function in whose place `CODE` stands at file level: the braces around it are closed first."""


LARGEST_ARRAY = 2**31 - 1
"""Bytes of an array in which lanes find their records: places have 32 bits, as the processor's gathers do."""


def are_within_reach(*arguments: Any) -> bool:
    """Return whether the arrays among a launch's arguments, and those in its structs, are small enough for lanes."""
    arrays = [a for a in arguments if isinstance(a, wp.array)]
    structs = [a for a in arguments if isinstance(a, StructInstance)]
    return all(a.capacity <= LARGEST_ARRAY for a in arrays) and all(
        are_within_reach(*(getattr(struct, name) for name in struct._cls.vars)) for struct in structs
    )


@functools.cache
def make_wide_render_kernel(features: Features) -> wp.Kernel:
    """Return the kernel for scenes with these features; a film has the same bits as after `make_render_kernel`.

    Raises:
        Unsupported: where there is none.
    """
    code = wide_code(make_render_kernel(features))
    module = wp.get_module(f"wrt.wide.{features.name}.{hashlib.sha256(code.encode()).hexdigest()[:8]}")

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

    @wp.kernel(module=module, enable_backward=False)
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
