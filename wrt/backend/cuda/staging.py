"""Pinned host memory through which arrays of a GPU are fetched, kept from one fetch to the next.

Pinning memory and unpinning it wait for all work of a GPU, and later work of other threads waits for that.
"""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

LARGEST_PINNED = 1 << 26
"""Most bytes of an array that is fetched through pinned memory: a picture of five million pixels. Larger ones go to
ordinary memory, which the driver fills through pinned memory of its own."""

LEAST_PINNED = 1 << 16
"""Fewest bytes of the memory, so that small arrays of growing sizes do not pin it anew."""


class Staging:
    """The pinned memory of one stream: a power of two of bytes, for the largest array that it has fetched."""

    def __init__(self) -> None:
        """Hold none yet."""
        self._lock = threading.Lock()
        self._memory: Any = None

    def fetch(self, wp: Any, array: Any, stream: Any) -> NDArray[Any]:
        """Copy an array of a GPU on a stream, wait for that stream, and return the numbers.

        Args:
            wp: Warp.
            array: the array, not empty, of LARGEST_PINNED bytes at most.
            stream: the stream.
        """
        with self._lock:
            if self._memory is None or self._memory.capacity < array.capacity:
                self._memory = None  # release it before its successor is pinned
                size = max(LEAST_PINNED, 1 << (array.capacity - 1).bit_length())
                self._memory = wp.empty(size, dtype=wp.uint8, device="cpu", pinned=True)
            place = wp.array(ptr=self._memory.ptr, dtype=array.dtype, shape=array.shape, device="cpu", pinned=True)
            wp.copy(place, array, stream=stream)
            wp.synchronize_stream(stream)
            return np.array(place.numpy())
