"""What the command line does with its process, which nobody else's code runs in."""

from __future__ import annotations

import contextlib
import gc
import os
import sys
from collections.abc import Iterator

LARGE = 1 << 22
"""Bytes. What is computed of some faces at a time is smaller; it stays in the heap and is not cleared every time."""

NOT_NEEDED = ("scipy", "networkx")
"""What trimesh imports where it is installed, for things that nothing here asks it for: 0.4 s and 40 MB."""

_MMAP_THRESHOLD, _TRIM_THRESHOLD = -3, -1  # M_MMAP_THRESHOLD and M_TRIM_THRESHOLD of glibc's malloc.h


def settle_in() -> None:
    """Start faster and take less memory; before the heavy imports, and never in a process that other code shares."""
    import ctypes

    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # NumPy's threads would only wait, busily
    for name in NOT_NEEDED:
        sys.modules.setdefault(name, None)  # type: ignore[arg-type]  # so an import of it fails
    # glibc keeps freed blocks of up to 32 MB: reading five million triangles left 95 MB behind.
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_MMAP_THRESHOLD, LARGE)
        mallopt(_TRIM_THRESHOLD, 4 * LARGE)


@contextlib.contextmanager
def no_collections() -> Iterator[None]:
    """Within the context, leave cycles of objects alone, and those that are there at its end for good.

    Nearly all that is imported and built at a start stays; looking through it again and again took a tenth of the time.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.freeze()
            gc.enable()
