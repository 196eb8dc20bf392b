"""The wide render kernel for the CPU: each of Warp's threads renders a tile, several lanes at a time."""

import functools
import re

import warp as wp

from wrt.kernels.bsdf import model_of
from wrt.kernels.core.bsdf import MAX_SLOTS
from wrt.kernels.core.features import Features
from wrt.kernels.native import at_file_level
from wrt.kernels.render import make_render_kernel, of_pass
from wrt.spmd.translate import wide_code


@functools.cache
def make_wide_render_kernel(features: Features, lanes: int) -> wp.Kernel:
    """Return the kernel of 4, 8 or 16 lanes for scenes with these features.

    Films have the same bits as with `make_render_kernel`.

    Raises:
        Unsupported: The kernel cannot be translated.
    """
    code = wide_code(make_render_kernel(features), lanes)
    # A material has as many slots as the scene's models read, instead of the maximum. That many take 3 KB in sixteen
    # lanes, copied several times at each surface: glossy 1.02, textures 1.04.
    slots = max((model_of(name).slots for name in features.models), default=0)
    code = re.sub(rf"(Matrix|mat_t|make_mat)<{MAX_SLOTS}, ?3,", rf"\g<1><{max(slots, 1)}, 3,", code)
    wide_code_h = at_file_level(code, "wide_code")

    @wp.func_native("""
    const int width = camera.crop_width, height = (int)film.count.shape[0] / width;
    render_tile(tile, width, height, 0, target_count, seed, camera, filter_table, scene, settings, film, aovs);
    """)
    @of_pass
    def render_tile(tile, target_count, seed, camera, filter_table, scene, settings, film, aovs):
        wide_code_h()

    @wp.kernel(module=wp.get_module(f"wrt.render.wide{lanes}.{features.name}"), enable_backward=False)
    @of_pass
    def render_tiles(first_tile, target_count, seed, camera, filter_table, scene, settings, film, aovs):
        render_tile(first_tile + wp.tid(), target_count, seed, camera, filter_table, scene, settings, film, aovs)

    return render_tiles
