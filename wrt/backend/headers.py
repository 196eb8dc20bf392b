"""Share Warp's precompiled headers among the threads of a process, and keep them for other processes.

Warp precompiles its headers in every thread that compiles, which takes nearly half the time of compiling an ordinary
render kernel. Here the first thread does so, if no other process has, and the others use its folder. The cache has a
folder of headers for each version of Warp and each processor; file names encode the other settings. Headers precompiled
before a change of their sources are not used: the compiler would reject them, and Warp would print a message and do
without.
"""

from __future__ import annotations

import contextlib
import os
import sys
import threading
import warnings
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from wrt.backend.cache_folders import (
    keep_latest,
    make_private,
    put,
    read_checked,
    work_folder,
    write_checked,
    wrt_folder,
)
from wrt.backend.fingerprint import TESTED, digest_of_warp, folder_of

WRITTEN = "builtin_*.pch"
"""Pattern of the CPU files, which share a folder with those of the CUDA compiler."""

KEPT = 4
"""Folders that are kept, for different versions of Warp and different processors."""

_PREPARING = threading.Lock()
"""Held by a thread while it looks for headers, or precompiles them."""


def _renew_lock() -> None:
    global _PREPARING
    _PREPARING = threading.Lock()


os.register_at_fork(after_in_child=_renew_lock)  # a fork lacks the thread that holds it


def share_headers(precompile: Callable[[], object]) -> None:
    """Have Warp's compiler in this thread use the precompiled headers of this process.

    Args:
        precompile: compiles something for the CPU, so that Warp precompiles the headers that are missing.
    """
    if sys.modules["warp"].config.version not in TESTED:
        return
    context: Any = sys.modules["warp._src.context"]
    with _PREPARING, contextlib.suppress(OSError):
        folder = work_folder() / "headers"
        with context.runtime._pch_dirs_lock:
            context.runtime._pch_dirs[threading.get_ident()] = SimpleNamespace(name=str(folder))
        if not folder.is_dir():
            folder.mkdir()
            _copy_from_cache(folder)
            copied = set(folder.glob(WRITTEN))
            precompile()
            for written in set(folder.glob(WRITTEN)) - copied:
                _keep(written)


def _copy_from_cache(folder: Path) -> None:
    """Copy the headers in the cache: another process may remove them there, and Warp here would write into them."""
    for path in cached_folder().glob(WRITTEN):
        if (data := read_checked(path)) is not None:
            put(folder / path.name, data)
        else:  # they could crash the compiler, and this process with it
            warnings.warn(f"{path}: precompiled headers were damaged; they are compiled again", stacklevel=2)
            path.unlink()


def _keep(written: Path) -> None:
    """Put headers into the cache, and remove all but the KEPT latest folders."""
    folder = cached_folder()
    make_private(folder.parent)
    folder.mkdir(exist_ok=True)
    write_checked(folder / written.name, written.read_bytes())
    keep_latest(folder.parent, "headers-*", KEPT)


def cached_folder() -> Path:
    """Return the cached headers for this version of Warp, its sources, and this processor."""
    return wrt_folder() / f"headers-{digest_of_warp(folder_of('warp'))}"
