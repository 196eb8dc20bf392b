"""Warp's headers, in the form its compiler reads quickly, from one process to the next.

Warp writes them down anew in every thread that compiles, which is nearly half of what compiling an ordinary render
kernel takes. They are of one Warp and one processor; the names of the files tell the other settings. What was written
before a header changed is not lent: the compiler would refuse it, and Warp say so and do without.
"""

from __future__ import annotations

import contextlib
import functools
import sys
import tempfile
import threading
import warnings
import zlib
from pathlib import Path
from typing import Any

from wrt.cache_folders import keep_latest, put, work_folder, wrt_folder
from wrt.lean.builds import TESTED, digest_of_warp

WRITTEN = "builtin_*.pch"
"""Names of files that Warp writes for the CPU; what its compiler for CUDA writes lies in the same folder."""

KEPT = 4
"""Folders, of so many versions of Warp and kinds of processor."""


_THREAD = threading.local()
"""`lent`: the names of this thread's headers that came from, or went to, the cache."""


def lend_headers() -> None:
    """Let Warp's compiler find in this thread what another process has written down."""
    if hasattr(_THREAD, "lent"):
        return
    _THREAD.lent = set()
    with contextlib.suppress(OSError):
        if (folder := _of_thread()) is not None:
            for kept in _kept().glob(f"{WRITTEN}-*"):
                name, _, digest = kept.name.rpartition("-")
                data = kept.read_bytes()
                if digest == _digest(data):
                    # Copy it: another process may remove the cached file, and Warp here would write into it.
                    (folder / name).write_bytes(data)
                    _THREAD.lent.add(name)
                else:
                    warnings.warn(f"{kept}: Warp's headers were damaged, and are written anew", stacklevel=2)
                    kept.unlink()


def keep_headers() -> None:
    """Keep what Warp's compiler has written down in this thread, for other processes."""
    with contextlib.suppress(OSError):
        if (folder := _of_thread()) is None:
            return
        for written in folder.glob(WRITTEN):
            if written.name not in _THREAD.lent:
                data = written.read_bytes()
                _keep(data, _kept() / f"{written.name}-{_digest(data)}")
                _THREAD.lent.add(written.name)


def _keep(data: bytes, kept: Path) -> None:
    """Put headers into the cache, in place of others of that name; keep the KEPT latest folders only."""
    folder = kept.parent
    folder.mkdir(parents=True, exist_ok=True)
    for before in folder.glob(f"{kept.name.rpartition('-')[0]}-*"):
        if before != kept:
            before.unlink(missing_ok=True)
    put(kept, data)
    keep_latest(folder.parent, "headers-*", KEPT)


def _digest(data: bytes) -> str:
    """Return a checksum of headers: damaged ones could crash the compiler, and this process with it."""
    return f"{zlib.crc32(data):08x}"


def _of_thread() -> Path | None:
    """Return the folder in which Warp looks in this thread; None with a Warp that is not known well, or without."""
    context: Any = sys.modules.get("warp._src.context")
    if context is None or sys.modules["warp"].config.version not in TESTED:
        return None
    runtime = context.runtime
    with runtime._pch_dirs_lock:
        if (thread := threading.get_ident()) not in runtime._pch_dirs:
            # In the work folder, which is removed with this process. Files that a thread is still writing may remain.
            runtime._pch_dirs[thread] = tempfile.TemporaryDirectory(dir=work_folder(), ignore_cleanup_errors=True)
    folder = runtime.get_clang_pch_dir()
    return None if folder is None else Path(folder)


@functools.cache
def _kept() -> Path:
    """Return the folder of what is kept for this Warp, its headers as they are, and this processor."""
    return wrt_folder() / f"headers-{digest_of_warp(Path(sys.modules['warp'].__file__ or '').parent)}"
