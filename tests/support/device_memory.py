"""What Warp arrays take: bytes alive, and the most that were at once."""

from __future__ import annotations

import contextlib
import weakref
from collections.abc import Iterator
from typing import Any


class Allocated:
    """Bytes of arrays that own their memory, or share it with NumPy; views of other arrays do not count.

    Attributes:
        alive: bytes now.
        peak: the most bytes alive at once.
    """

    def __init__(self) -> None:
        """Count nothing yet."""
        self.alive = self.peak = 0

    def add(self, array: Any) -> None:
        """Count an array until it is released."""
        size = array.size * _element(array)
        self.alive += size
        self.peak = max(self.peak, self.alive)
        weakref.finalize(array, self._remove, size)

    def _remove(self, size: int) -> None:
        self.alive -= size


def _element(array: Any) -> int:
    from warp._src.types import type_size_in_bytes

    return int(type_size_in_bytes(array.dtype))


@contextlib.contextmanager
def allocations() -> Iterator[Allocated]:
    """Count the arrays that Warp makes within the context."""
    import warp as wp

    counted, start = Allocated(), wp.array.__init__

    def counting(self: Any, *arguments: Any, **options: Any) -> None:
        start(self, *arguments, **options)
        if options.get("ptr") is None:
            counted.add(self)

    wp.array.__init__ = counting
    try:
        yield counted
    finally:
        wp.array.__init__ = start
