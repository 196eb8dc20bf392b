"""Warp's headers, in the form its compiler reads quickly, from one process to the next.

Warp writes them down anew in every thread that compiles, which is nearly half of what compiling an ordinary render
kernel takes. They are of one Warp and one processor; the names of the files tell the other settings. What was written
before a header changed is not lent: the compiler would refuse it, and Warp say so and do without.
"""

from __future__ import annotations

import contextlib
import functools
import shutil
import sys
import threading
import zlib
from pathlib import Path
from typing import Any

from wrt.errors import InputError
from wrt.lean.builds import TESTED, digest_of_warp, kept_folder
from wrt.safe_write import keep_latest, write_whole

WRITTEN = "builtin_*.pch"
"""Names of files that Warp writes for the CPU; what its compiler for CUDA writes lies in the same folder."""

KEPT = 4
"""Folders, of so many versions of Warp and kinds of processor."""


_THREAD = threading.local()


def lend_headers() -> None:
    """Let Warp's compiler find in this thread what another process has written down."""
    if hasattr(_THREAD, "lent"):
        return
    _THREAD.lent = True
    with contextlib.suppress(OSError, RuntimeError):  # the latter where nobody has a home
        if (folder := _of_thread()) is not None:
            for kept in _kept().glob(f"{WRITTEN}-*"):
                name, _, digest = kept.name.rpartition("-")
                if digest == _digest(kept):
                    (folder / name).symlink_to(kept)
                else:
                    kept.unlink()


def keep_headers() -> None:
    """Keep what Warp's compiler has written down in this thread, for other processes."""
    with contextlib.suppress(OSError, RuntimeError, InputError):
        if (folder := _of_thread()) is None:
            return
        for written in folder.glob(WRITTEN):
            kept = _kept() / f"{written.name}-{_digest(written)}"
            if not written.is_symlink() and not kept.exists():
                _keep(written, kept)


def _keep(written: Path, kept: Path) -> None:
    """Copy a file; remove others in its place, and what is of the oldest Warps or processors."""
    folder = kept.parent
    folder.mkdir(parents=True, exist_ok=True)
    for before in folder.glob(f"{written.name}-*"):
        before.unlink(missing_ok=True)
    write_whole(kept, functools.partial(shutil.copyfile, written))
    keep_latest(folder.parent, "headers-*", KEPT)


def _digest(file: Path) -> str:
    """Return what tells a file from a damaged one, which could end the compiler and this process with it."""
    return f"{zlib.crc32(file.read_bytes()):08x}"


def _of_thread() -> Path | None:
    """Return the folder in which Warp looks in this thread; None with a Warp that is not known well, or without."""
    context: Any = sys.modules.get("warp._src.context")
    if context is None or sys.modules["warp"].config.version not in TESTED:
        return None
    folder = context.runtime.get_clang_pch_dir()
    return None if folder is None else Path(folder)


@functools.cache
def _kept() -> Path:
    """Return the folder of what is kept for this Warp, its headers as they are, and this processor."""
    return kept_folder() / f"headers-{digest_of_warp(Path(sys.modules['warp'].__file__ or '').parent)}"
