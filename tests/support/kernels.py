"""Run device functions over arrays, and draw the numbers of samplers."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from wrt.backend.warp_start import initialize_warp
from wrt.checking.bsdf_cases import uniforms as uniforms
from wrt.checking.bsdf_cases import upload as upload
from wrt.kernels.sampling.sampler import BLOCK_TIME, Sampler, make_sample_4d, make_sample_camera


def map_function(function: wp.Function, *inputs: ArrayLike, device: str) -> NDArray[Any]:
    """Return what a device function gives for each row of its inputs.

    Args:
        function: a wp.func of floats, vectors and unsigned integers, none of them structs or arrays.
        inputs: one array an argument, (N,) for a number and (N, k) for a vector; floats become float32.
        device: where to run it.
    """
    initialize_warp()
    arrays = []
    for values in inputs:
        array = np.asarray(values)
        if array.dtype.kind == "f":
            array = array.astype(np.float32)
        scalar = {"f": wp.float32, "i": wp.int32, "u": wp.uint32}[array.dtype.kind]
        dtype = scalar if array.ndim == 1 else wp.types.vector(length=array.shape[1], dtype=scalar)
        arrays.append(wp.array(array, dtype=dtype, device=device))
    return wp.map(function, *arrays).numpy()


@functools.cache
def make_draw_kernel(name: str) -> wp.Kernel:
    """Return the kernel that draws numbers of a sampler, the camera's blocks as the camera does."""
    sample_4d = make_sample_4d(name)
    sample_camera = make_sample_camera(name)

    @wp.kernel(enable_backward=False, module=f"test_draw.{name.replace('-', '_')}")
    def draw_kernel(
        seed: wp.array(dtype=wp.uint32),
        pixel: wp.array(dtype=wp.uint32),
        index: wp.array(dtype=wp.uint32),
        block: wp.array(dtype=wp.uint32),
        numbers_out: wp.array(dtype=wp.vec4),
    ):
        i = wp.tid()
        sampler = Sampler()
        sampler.seed = seed[i]
        sampler.pixel = pixel[i]
        sampler.index = index[i]
        if block[i] <= BLOCK_TIME:
            numbers_out[i] = sample_camera(sampler, block[i])
        else:
            numbers_out[i] = sample_4d(sampler, block[i])

    return draw_kernel


def draw(
    seed: ArrayLike,
    pixel: ArrayLike,
    index: ArrayLike,
    block: ArrayLike,
    device: str = "cpu",
    *,
    sampler: str = "independent",
) -> NDArray[np.float32]:
    """Return (..., 4) numbers of one of the renderer's own samplers; arguments are broadcast.

    Args:
        seed: of the picture.
        pixel: as `Sampler.pixel` names it: the Morton code of its place for "blue-noise".
        index: of the sample.
        block: of four dimensions.
        device: where to run it.
        sampler: which one.
    """
    columns = np.broadcast_arrays(seed, pixel, index, block)
    arrays = [upload(np.ascontiguousarray(c).ravel().astype(np.uint32), wp.uint32, device) for c in columns]
    out = wp.empty(columns[0].size, dtype=wp.vec4, device=device)
    wp.launch(make_draw_kernel(sampler), columns[0].size, arrays, [out], device=device)
    return out.numpy().reshape(*columns[0].shape, 4)
