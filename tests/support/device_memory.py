"""What Warp arrays take: bytes alive, and the most that were at once."""

import contextlib
import weakref

import numpy as np
import warp as wp
from warp._src.types import type_size_in_bytes

from wrt.backend import arrays


class Allocated:
    """Bytes `alive` of arrays that own their memory or share it with NumPy, and their `peak`; views do not count."""

    def __init__(self):
        self.alive = self.peak = 0

    def add(self, owner, size):
        """Count bytes until their owner is released."""
        self.alive += size
        self.peak = max(self.peak, self.alive)
        weakref.finalize(owner, self._remove, size)

    def add_numpy(self, rows):
        """Count the memory of a NumPy array, which may be a view."""
        owner = memory_of(rows)
        self.add(owner, owner.nbytes)

    def _remove(self, size):
        self.alive -= size


def memory_of(rows):
    """Return the NumPy array that owns the memory of another."""
    while isinstance(rows.base, np.ndarray):
        rows = rows.base
    return rows


@contextlib.contextmanager
def allocations():
    """Count the arrays that are made within the context: those of the CPU, and Warp's."""
    counted = Allocated()
    start, empty, from_numpy = wp.array.__init__, arrays.empty, arrays.from_numpy

    def counting_start(self, *arguments, **options):
        start(self, *arguments, **options)
        if options.get("ptr") is None:
            counted.add(self, self.size * type_size_in_bytes(self.dtype))

    def counting_empty(*arguments):
        made = empty(*arguments)
        counted.add_numpy(made.rows)
        return made

    def counting_from_numpy(*arguments, copy):
        made = from_numpy(*arguments, copy=copy)
        if not copy:
            counted.add_numpy(made.rows)
        return made

    wp.array.__init__, arrays.empty, arrays.from_numpy = counting_start, counting_empty, counting_from_numpy
    try:
        yield counted
    finally:
        wp.array.__init__, arrays.empty, arrays.from_numpy = start, empty, from_numpy
