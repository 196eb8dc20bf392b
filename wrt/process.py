"""What the command line does with its process, which nobody else's code runs in."""

from __future__ import annotations

import atexit
import contextlib
import gc
import importlib
import os
import sys
import threading
from collections.abc import Iterator, Sequence
from typing import NoReturn

LARGE = 1 << 22
"""Bytes. What is computed of some faces at a time is smaller; it stays in the heap and is not cleared every time."""

NOT_NEEDED = ("scipy", "networkx")
"""What trimesh imports where it is installed, for things that nothing here asks it for: 0.4 s and 40 MB."""

RENDERING = (
    "warp",
    "wrt.renderer",
    "wrt.kernels.layers",
    "wrt.kernels.render",
    "wrt.kernels.bvh_collapse",
    "wrt.kernels.bvh_presplit",
    "wrt.build.vertex_normals",
)
"""What rendering a large mesh imports sooner or later."""

LARGE_FILE = 1 << 20
"""Bytes."""

SWITCH_SECONDS = 5e-4
"""How long one thread may go on with Python while another waits for its turn; by default ten times as long, and an
import would let the other come up for breath only that often."""

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


def importing_renderer(path: str) -> contextlib.AbstractContextManager[None]:
    """Return a context within which what renders is imported beside other work, if reading a file is much of that."""
    try:
        large = os.path.getsize(path) > LARGE_FILE
    except (OSError, ValueError):
        large = False
    return importing(RENDERING) if large else contextlib.nullcontext()


@contextlib.contextmanager
def importing(names: Sequence[str]) -> Iterator[None]:
    """Within the context, import modules in another thread: while files are read and large arrays gone over."""

    def run() -> None:
        with contextlib.suppress(Exception):  # whoever needs the module is told
            for name in names:
                importlib.import_module(name)

    interval = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_SECONDS)
    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield
    finally:
        sys.setswitchinterval(interval)
        thread.join()


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


def end(status: int) -> NoReturn:
    """End the process, without taking apart first what the system takes back anyway, which temporary files are not."""
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError, AttributeError):  # closed, or not there
            stream.flush()
    os._exit(status)


def end_soon(status: int) -> None:
    """Have the process end within a second, whatever its threads are busy with."""
    timer = threading.Timer(1.0, os._exit, (status,))
    timer.daemon = True
    timer.start()
