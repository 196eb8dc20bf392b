"""Running device functions over arrays, and the numbers they draw."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from wrt.device import initialize_warp
from wrt.kernels.sampler import Sampler, sample_4d


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


def upload(values: ArrayLike, dtype: Any, device: str) -> wp.array:
    """Return a device array."""
    initialize_warp()
    return wp.array(np.asarray(values), dtype=dtype, device=device)


def uniforms(n: int, width: int, seed: int) -> NDArray[np.float32]:
    """Return (n, width) numbers in [0, 1) from a generator that has nothing to do with the renderer's."""
    return np.random.default_rng(seed).random((n, width), dtype=np.float32)


@wp.kernel(enable_backward=False)
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
    numbers_out[i] = sample_4d(sampler, block[i])


def draw(seed: ArrayLike, pixel: ArrayLike, index: ArrayLike, block: ArrayLike, device: str) -> NDArray[np.float32]:
    """Return (N, 4) numbers of the renderer's own sampler; arguments are broadcast."""
    columns = [np.ascontiguousarray(a) for a in np.broadcast_arrays(seed, pixel, index, block)]
    arrays = [upload(column.astype(np.uint32), wp.uint32, device) for column in columns]
    out = wp.empty(len(columns[0]), dtype=wp.vec4, device=device)
    wp.launch(draw_kernel, len(columns[0]), arrays, [out], device=device)
    return out.numpy()
