"""What Warp arrays take: bytes alive, and the most that were at once."""

import contextlib
import weakref

import warp as wp
from warp._src.types import type_size_in_bytes


class Allocated:
    """Bytes `alive` of arrays that own their memory or share it with NumPy, and their `peak`; views do not count."""

    def __init__(self):
        self.alive = self.peak = 0

    def add(self, array):
        """Count an array until it is released."""
        size = array.size * type_size_in_bytes(array.dtype)
        self.alive += size
        self.peak = max(self.peak, self.alive)
        weakref.finalize(array, self._remove, size)

    def _remove(self, size):
        self.alive -= size


@contextlib.contextmanager
def allocations():
    """Count the arrays that Warp makes within the context."""
    counted, start = Allocated(), wp.array.__init__

    def counting(self, *arguments, **options):
        start(self, *arguments, **options)
        if options.get("ptr") is None:
            counted.add(self)

    wp.array.__init__ = counting
    try:
        yield counted
    finally:
        wp.array.__init__ = start
