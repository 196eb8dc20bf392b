"""The wide kernels for the CPU: each of Warp's threads does the work of a tile, several lanes at a time."""

import functools
import re
from collections.abc import Callable
from typing import Literal

import warp as wp

from wrt.kernels.bsdf import model_of
from wrt.kernels.core.bsdf import MAX_SLOTS
from wrt.kernels.core.features import Features
from wrt.kernels.gradients.gradient_pass import make_gradient_kernel, of_gradients
from wrt.kernels.integrators.photons import make_photon_kernel, of_set
from wrt.kernels.native import at_file_level
from wrt.kernels.render import make_render_kernel, of_pass
from wrt.kernels.textures.procedures import model_of as procedure_of
from wrt.spmd.translate import wide_code


@functools.cache
def make_wide_render_kernel(features: Features, lanes: int) -> wp.Kernel:
    """Return the kernel of 4, 8 or 16 lanes for scenes with these features.

    Films have the same bits as with `make_render_kernel`.

    Raises:
        Unsupported: The kernel cannot be translated.
    """
    wide_code_h = _header(make_render_kernel(features), features, lanes)

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


@functools.cache
def make_wide_gradient_kernel(features: Features, part: Literal["radiance", "replay"], lanes: int) -> wp.Kernel:
    """Return the kernel of 4, 8 or 16 lanes for a part of gradients; see `make_gradient_kernel`.

    Raises:
        Unsupported: The kernel cannot be translated.
    """
    wide_code_h = _header(make_gradient_kernel(features, part), features, lanes)

    @wp.func_native("""
    const int width = camera.crop_width, height = (int)upstream.shape[0] / width;
    render_tile(
        tile, width, height, 0, first, last, seed, camera, filter_table, scene, settings, upstream, radiances, sums);
    """)
    @of_gradients
    def tile(tile, first, last, seed, camera, filter_table, scene, settings, upstream, radiances, sums):
        wide_code_h()

    @wp.kernel(module=wp.get_module(f"wrt.{part}.wide{lanes}.{features.name}"), enable_backward=False)
    @of_gradients
    def tiles(first_tile, first, last, seed, camera, filter_table, scene, settings, upstream, radiances, sums):
        number = first_tile + wp.tid()
        tile(number, first, last, seed, camera, filter_table, scene, settings, upstream, radiances, sums)

    return tiles


@functools.cache
def make_wide_photon_kernel(features: Features, lanes: int) -> wp.Kernel:
    """Return the kernel of 4, 8 or 16 lanes that follows photons; see `make_photon_kernel`.

    Raises:
        Unsupported: The kernel cannot be translated.
    """
    wide_code_h = _header(make_photon_kernel(features), features, lanes)

    # Threads of the scalar kernel are the pixels of a strip, so narrow that a pool holds the photons of a tile.
    @wp.func_native("""
    const int width = wrt::TILE / 4, traced = (int)photons_out.shape[0] / 2;
    const int height = (traced + width * share - 1) / (width * share);
    render_tile(
        tile, width, height, 0, share, set_number, seed, camera, scene, settings, casters, photons_out, keys_out);
    """)
    @of_set
    def tile(tile, share, set_number, seed, camera, scene, settings, casters, photons_out, keys_out):
        wide_code_h()

    @wp.kernel(module=wp.get_module(f"wrt.photons.wide{lanes}.{features.name}"), enable_backward=False)
    @of_set
    def tiles(first_tile, share, set_number, seed, camera, scene, settings, casters, photons_out, keys_out):
        number = first_tile + wp.tid()
        tile(number, share, set_number, seed, camera, scene, settings, casters, photons_out, keys_out)

    return tiles


def _header(kernel: wp.Kernel, features: Features, lanes: int) -> Callable[[], None]:
    """Return the function that includes the wide code of a kernel; see `kernels/native`."""
    code = wide_code(kernel, lanes)
    # A material has as many slots as the scene's models read, instead of the maximum. That many take 3 KB in sixteen
    # lanes, copied several times at each surface: glossy 1.02, textures 1.04.
    models = [model_of(name) for name in features.models]
    slots = [1, *(model.slots if model.at is None else MAX_SLOTS for model in models)]
    slots += [procedure_of(name).slots for name in features.procedures]
    code = re.sub(rf"(Matrix|mat_t|make_mat)<{MAX_SLOTS}, ?3,", rf"\g<1><{max(slots)}, 3,", code)
    return at_file_level(code, "wide_code")
