"""Settings of the command line's own process: memory, imports, garbage collection, and its end."""

from __future__ import annotations

import atexit
import contextlib
import gc
import importlib
import os
import sys
import threading
from collections.abc import Iterator
from typing import NoReturn

LARGE = 1 << 22
"""Freed allocations of at least this many bytes return to the system; smaller intermediate arrays stay in the heap."""

NOT_NEEDED = ("scipy", "networkx")
"""Optional imports of trimesh that wrt does not use; they take 0.4 s and 40 MB."""

KERNELS = (
    "wrt.kernels.integrators.aovs",
    "wrt.kernels.render",
    "wrt.kernels.accel.build.collapse",
    "wrt.kernels.accel.build.presplit",
)
"""Kernel modules for rendering a large mesh; they are imported if they are not compiled yet, which takes long."""

LARGE_FILE = 1 << 20
"""Bytes above which a file is large."""

SWITCH_SECONDS = 5e-4
"""Switch interval of Python threads. At the default, ten times as long, imports in one thread slow down the others."""

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


@contextlib.contextmanager
def importing_renderer(path: str) -> Iterator[None]:
    """Within the context, which reads the input, import the renderer in another thread if the input is a large file."""
    try:
        is_large = os.path.getsize(path) > LARGE_FILE
    except (OSError, ValueError):
        is_large = False
    if not is_large:
        yield
        return

    def run() -> None:
        with contextlib.suppress(Exception):  # raised again where the module is needed
            importlib.import_module("wrt.rendering.renderer")
            from wrt.backend import current_backend  # not at the top: --help must import little

            for name in KERNELS:
                if current_backend().artefacts.get("modules", name) is None:
                    importlib.import_module(name)

    interval = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_SECONDS)
    thread = threading.Thread(target=run, daemon=True)
    from wrt.threads import start_if_possible

    started = start_if_possible(thread)
    try:
        yield
    finally:
        sys.setswitchinterval(interval)
        if started:
            thread.join()


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
    from wrt.threads import start_if_possible

    timer = threading.Timer(1.0, os._exit, (status,))
    timer.daemon = True
    start_if_possible(timer)
