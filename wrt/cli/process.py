"""Settings of the command line's own process: memory, imports, garbage collection, and its end."""

from __future__ import annotations

import atexit
import contextlib
import gc
import os
import sys
import threading
from collections.abc import Iterator
from typing import NoReturn

LARGE = 1 << 22
"""Freed allocations of at least this many bytes return to the system; smaller intermediate arrays stay in the heap."""

NOT_NEEDED = ("scipy", "networkx")
"""Optional imports of trimesh that wrt does not use; they take 0.4 s and 40 MB."""

_MMAP_THRESHOLD, _TRIM_THRESHOLD = -3, -1  # M_MMAP_THRESHOLD and M_TRIM_THRESHOLD of glibc's malloc.h


def settle_in() -> None:
    """Reduce start time and memory. Call it before the heavy imports, and never in a process shared with other code."""
    import ctypes

    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # NumPy's threads would only busy-wait
    for name in NOT_NEEDED:
        sys.modules.setdefault(name, None)  # type: ignore[arg-type]  # makes its import fail
    # By default glibc keeps freed blocks of up to 32 MB, which was 95 MB after reading five million triangles.
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_MMAP_THRESHOLD, LARGE)
        mallopt(_TRIM_THRESHOLD, 4 * LARGE)


def allow_imports() -> None:
    """Undo what `settle_in` does to imports, for a person's own code."""
    for name in NOT_NEEDED:
        if name in sys.modules and sys.modules[name] is None:
            del sys.modules[name]


@contextlib.contextmanager
def no_collections() -> Iterator[None]:
    """Disable garbage collection within the context, and exempt the objects made there for good.

    Nearly all of them live as long as the process, and collections took a tenth of the start time.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.freeze()
            gc.enable()


def end(status: int) -> NoReturn:
    """End the process without freeing its objects; temporary files are still removed."""
    _flush()
    if status:  # close standard error: a compiler that still runs would complain about its missing files
        with contextlib.suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    atexit._run_exitfuncs()
    _flush()
    os._exit(status)


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError, AttributeError):  # closed or missing
            stream.flush()


def end_soon(status: int) -> None:
    """End the process within a second, whatever its threads are doing."""
    timer = threading.Timer(1.0, os._exit, (status,))
    timer.daemon = True
    with contextlib.suppress(RuntimeError):  # if the system allows no more threads
        timer.start()
