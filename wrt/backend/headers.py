"""Keep Warp's precompiled headers from one process and one thread to the next.

Warp precompiles its headers in every thread that compiles, which takes nearly half the time of compiling an ordinary
render kernel. Here one thread does so, and the others wait for it. The headers are kept for each version of Warp and
each processor; file names encode the other settings. Headers precompiled before a change of their sources are not used:
the compiler would reject them, and Warp would print a message and do without.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import os
import sys
import threading
import warnings
import zlib
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

from wrt.backend.cache_folders import keep_latest, make_private, put, work_folder, wrt_folder
from wrt.backend.fingerprint import TESTED, digest_of_warp, folder_of, version_of
from wrt.backend.slices import Threads

WRITTEN = "builtin_*.pch"
"""Pattern of the CPU files, which share a folder with those of the CUDA compiler."""

KEPT = 4
"""Folders that are kept, for different versions of Warp and different processors."""

FLAGS = (
    "-march=native",
    "-mllvm=-inline-threshold=9000",
    "-mllvm=-inline-cold-callsite-threshold=3000",
    "-mllvm=-slp-recursion-max-depth=4",
)
"""Flags of the compiler by default in the tested versions of Warp (`warp.config.cpu_compiler_flags`)."""

_TEXT: Any = ctypes.c_char_p
_COMPILE_CPP = [*[_TEXT] * 4, *[ctypes.c_bool] * 4, ctypes.POINTER(_TEXT), ctypes.c_int]
_COMPILE_CPP += [*[ctypes.c_bool] * 2, _TEXT, ctypes.c_int]
"""Arguments of `wp_compile_cpp` (Warp's clang.cpp): source, its path, headers, output, debug, verify_fp, fuse_fp,
tiles_in_stack_memory, flags, optimization_level, verbose, use_precompiled_headers, their folder, block_dim."""

_EMPTY = b'#define WP_TILE_BLOCK_DIM 1\n#include "builtin.h"\n'
"""What Warp writes for a module without kernels, as far as it matters."""

_THREAD = threading.local()
"""`lent`: names of this thread's headers that were copied from or to the cache."""

_PRECOMPILER = Threads(1, "wrt-headers")

_PRECOMPILING = threading.Lock()
"""Held by a thread while it looks for headers, or precompiles them."""


def _renew_lock() -> None:
    global _PRECOMPILING
    _PRECOMPILING = threading.Lock()


os.register_at_fork(after_in_child=_renew_lock)  # a fork lacks the thread that holds it


def precompile_early() -> None:
    """Have a thread precompile headers if none are kept, while others import Warp and prepare what to compile."""
    with contextlib.suppress(OSError):
        warp = folder_of("warp")
        if version_of(warp) in TESTED and has_usual_flags() and not _is_any_kept():
            _PRECOMPILER.submit(_precompile, warp)


def _precompile(warp: Path) -> None:
    """Precompile headers as Warp does, without importing it, and keep them."""
    import tempfile

    with _PRECOMPILING, contextlib.suppress(OSError):
        if _is_any_kept():
            return
        with tempfile.TemporaryDirectory(dir=work_folder()) as temporary:
            folder = Path(temporary)
            compile_cpp = ctypes.CDLL(str(warp / "bin" / "warp-clang.so")).wp_compile_cpp
            compile_cpp.argtypes = _COMPILE_CPP
            paths = (folder / "empty.cpp", warp / "native", folder / "empty.o")
            flags = (ctypes.c_char_p * (len(FLAGS) + 1))(*map(os.fsencode, FLAGS), None)
            options = (False, False, True, True, flags, 2, False, True)
            compile_cpp(_EMPTY, *map(os.fsencode, paths), *options, os.fsencode(folder), 1)
            _keep_all(folder)


def has_usual_flags() -> bool:
    """Return whether Warp compiles, or will compile, with FLAGS."""
    if (warp := sys.modules.get("warp")) is not None:
        return bool(str(warp.config.cpu_compiler_flags).split() == list(FLAGS))
    return not any(name.startswith("WARP_") for name in os.environ)


def _is_any_kept() -> bool:
    """Return whether the cache has precompiled headers."""
    return any(_kept().glob(f"{WRITTEN}-*"))


def lend_headers(precompile: Callable[[], object]) -> None:
    """Give Warp's compiler in this thread the headers that another thread or process precompiled.

    Args:
        precompile: compiles a module for the first time on this machine; called if there are no headers.
    """
    if hasattr(_THREAD, "lent"):
        return
    _THREAD.lent = set()
    with _PRECOMPILING:
        _lend()
        if not _THREAD.lent:
            precompile()
            keep_headers()


def _lend() -> None:
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
                    warnings.warn(f"{kept}: precompiled headers were damaged; they are compiled again", stacklevel=2)
                    kept.unlink()


def keep_headers() -> None:
    """Keep the headers that Warp has precompiled in this thread, for other processes."""
    with contextlib.suppress(OSError):
        if (folder := _of_thread()) is None:
            return
        _THREAD.lent |= _keep_all(folder, but_for=_THREAD.lent)


def _keep_all(folder: Path, *, but_for: Collection[str] = ()) -> set[str]:
    """Put the headers in a folder into the cache, but for some names; return the names of those put there."""
    names = {written.name for written in folder.glob(WRITTEN)}.difference(but_for)
    for name in names:
        data = (folder / name).read_bytes()
        _keep(data, _kept() / f"{name}-{_digest(data)}")
    return names


def _keep(data: bytes, kept: Path) -> None:
    """Put headers into the cache in place of others with that name, and remove all but the KEPT latest folders."""
    folder = kept.parent
    make_private(folder.parent)
    folder.mkdir(exist_ok=True)
    for before in folder.glob(f"{kept.name.rpartition('-')[0]}-*"):
        if before != kept:
            before.unlink(missing_ok=True)
    put(kept, data)
    keep_latest(folder.parent, "headers-*", KEPT)


def _digest(data: bytes) -> str:
    """Return a checksum of headers: damaged ones could crash the compiler, and this process with it."""
    return f"{zlib.crc32(data):08x}"


def _of_thread() -> Path | None:
    """Return the folder in which Warp looks in this thread; None if Warp is not loaded or not a tested version."""
    import tempfile

    context: Any = sys.modules.get("warp._src.context")
    if context is None or sys.modules["warp"].config.version not in TESTED:
        return None
    runtime = context.runtime
    with runtime._pch_dirs_lock:
        if (thread := threading.get_ident()) not in runtime._pch_dirs:
            # The work folder is removed with this process, except for files that a thread is still writing.
            runtime._pch_dirs[thread] = tempfile.TemporaryDirectory(dir=work_folder(), ignore_cleanup_errors=True)
    folder = runtime.get_clang_pch_dir()
    return None if folder is None else Path(folder)


@functools.cache
def _kept() -> Path:
    """Return the folder of the headers for this version of Warp, its sources, and this processor."""
    return wrt_folder() / f"headers-{digest_of_warp(folder_of('warp'))}"
