"""Compile a wide kernel for the next render, after one too short to wait for it, if that saves time.

A render writes a request into a folder beside the table of artefacts, and starts a process that compiles what is
requested there. One such process runs at a time: it holds a lock on the folder, and others that find the lock taken end
at once. It has a low priority, outlives the render, and ends when nothing is requested any more. If it is killed, half
of a build is never found (see `wrt.backend.kernel_cache`), and the request is made again by a render an hour later.
"""

from __future__ import annotations

import contextlib
import json
import os
import resource
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wrt.backend import cache_folders, current_backend
from wrt.backend.artefacts import Artefacts
from wrt.compiling.kernel import (
    RENDER,
    as_json,
    compile_generated,
    compile_kernel,
    from_json,
    is_compiled,
    name_of_kernel,
    start,
)
from wrt.compiling.own import code_of, models_from_outside

if TYPE_CHECKING:
    from concurrent.futures import Future

SWITCH = "WRT_BACKGROUND"
"""Environment variable: 0 compiles nothing for the next render; 1 does so on build machines, too."""

BUILD_MACHINE = "CI"
"""Environment variable that services of continuous integration set."""

RETRY_SECONDS = 3600.0
"""Time after which a kernel is requested again if its compiler has not finished, for instance because it was killed."""

KEPT_SECONDS = 7 * 86400.0
"""Age from which requests are removed."""

LONGEST_SECONDS, MOST_CPU_SECONDS = 3600, 90
"""Time, and time of one core, after which the compiler is ended, whatever it does; kernels take 6 to 20 s of a core."""

WORTH = 3.0
"""Kernels are compiled if they save the next render at least this many times the time that compiling them takes."""

PRIORITY = 10
"""The compiler's niceness: where all cores are busy, it gets about a tenth of one. At 19 it does not finish while
renders follow one another."""

REQUESTED, BEGUN = ".json", ".begun"
"""Suffixes of a request, and of one whose kernel is being compiled, or was when its compiler ended."""

_started: list[subprocess.Popen[bytes]] = []
_being_generated: set[Path] = set()
"""Requests whose code this process still generates."""


def is_wanted() -> bool:
    """Return whether kernels may be compiled for later renders, by what the environment says."""
    switch = os.environ.get(SWITCH, "")
    return switch == "1" or (switch != "0" and os.environ.get(BUILD_MACHINE, "").lower() in ("", "0", "false"))


def is_running() -> bool:
    """Return whether a process compiles for later renders now."""
    path = current_backend().artefacts.path
    return path is not None and requests_folder(path).is_dir() and _is_locked(requests_folder(path))


def request(features: Any, lanes: int, part: str = RENDER) -> Path | None:
    """Have another process compile a kernel, and return the path of the request, which is removed once it is done.

    Return None if the environment forbids that, if the cache cannot be written to, or if the kernel's compiler was
    killed recently.
    """
    artefacts = current_backend().artefacts
    if not is_wanted() or artefacts.path is None:
        return None
    try:
        kernels = cache_folders.kernels_folder()
        cache_folders.require_writable(kernels / artefacts.warp_version)
        folder, name = requests_folder(artefacts.path), _digest(name_of_kernel(features, lanes, part).encode())
        path = folder / f"{_group(artefacts.path, kernels)}-{name}{REQUESTED}"
        folder.mkdir(parents=True, exist_ok=True)
        if _is_young(path.with_suffix(BEGUN), RETRY_SECONDS):
            return path if _is_locked(folder) else None
        if not models_from_outside(features):
            _put(path, json.dumps([as_json(features), lanes, part]), artefacts.path, kernels)
        elif path not in _being_generated:
            _being_generated.add(path)
            code_of(features, lanes, part).add_done_callback(partial(_put_code, path, artefacts.path, kernels))
    except (OSError, TypeError):
        return None
    return path


def _put_code(path: Path, table: Path, kernels: Path, code: Future[str]) -> None:
    """Request the compilation of code once it is generated."""
    with contextlib.suppress(OSError):
        if code.exception() is None:
            _put(path, code.result(), table, kernels)
    _being_generated.discard(path)


def _put(path: Path, text: str, table: Path, kernels: Path) -> None:
    cache_folders.put(path, text.encode())
    if not _is_locked(path.parent):  # the process that holds the lock looks for requests again after releasing it
        _start(table, kernels)


def _start(table: Path, kernels: Path) -> None:
    """Start the process that compiles, in a session of its own, with none of the files and folders of this one."""
    _started[:] = [process for process in _started if process.poll() is None]
    _started.append(start(__name__, table.stem, str(kernels), cwd="/", start_new_session=True))


def is_done(path: Path) -> bool:
    """Return whether a request is not pending any more."""
    return path not in _being_generated and not path.exists() and not path.with_suffix(BEGUN).exists()


def requests_folder(table: Path) -> Path:
    """Return the folder of requests beside a table of artefacts."""
    return table.parent / "requests"


def main(arguments: list[str]) -> int:
    """Compile what is requested, until nothing is.

    The arguments are the program's name, the stem of the table of artefacts, and Warp's folder of compiled kernels.
    """
    signal.alarm(LONGEST_SECONDS)
    resource.setrlimit(resource.RLIMIT_CPU, (MOST_CPU_SECONDS, MOST_CPU_SECONDS))
    give_way()
    artefacts, kernels = current_backend().artefacts, Path(arguments[2])
    if artefacts.path is None or artefacts.path.stem != arguments[1]:
        return 1  # the sources of kernels have changed since
    folder, pattern = requests_folder(artefacts.path), f"{_group(artefacts.path, kernels)}-*{REQUESTED}"
    while any(folder.glob(pattern)):
        with cache_folders.locked(folder, seconds=0.0) as is_free:
            if not is_free:
                return 0
            _remove_old(folder)
            for path in sorted(folder.glob(pattern)):
                _serve(path, artefacts, kernels)
    return 0


def _serve(path: Path, artefacts: Artefacts, kernels: Path) -> None:
    """Compile what a request says. If that fails it stays as BEGUN, so that it is not repeated at once."""
    import warp as wp

    from wrt.spmd.ir import Unsupported

    begun = path.with_suffix(BEGUN)
    with contextlib.suppress(OSError, RuntimeError, ValueError, Unsupported):
        path.replace(begun)
        os.utime(begun)
        requested = json.loads(begun.read_text(encoding="utf-8"))
        artefacts.refresh()
        if wp.config.kernel_cache_dir is None:  # Warp adds its version when it starts
            wp.config.kernel_cache_dir = str(kernels)
        if isinstance(requested, dict):
            compile_generated(requested)
        else:
            features, lanes, part = from_json(requested[0]), requested[1], requested[2]
            if not is_compiled(features, lanes, part):
                compile_kernel(features, lanes, part=part)
        begun.unlink(missing_ok=True)


def _group(table: Path, kernels: Path) -> str:
    """Return the beginning of the names of requests that one process can serve."""
    return f"{table.stem}-{_digest(os.fsencode(kernels))}"


def _digest(data: bytes) -> str:
    return cache_folders.digest(data).decode()


def _is_young(path: Path, seconds: float) -> bool:
    try:
        return time.time() - path.stat().st_mtime < seconds
    except FileNotFoundError:
        return False


def _remove_old(folder: Path) -> None:
    """Remove requests that were not served, for instance since wrt has changed."""
    for path in folder.iterdir():
        if not _is_young(path, KEPT_SECONDS):
            path.unlink(missing_ok=True)


def give_way() -> None:
    """Take a low priority among all processes, and be the first to end when memory is short."""
    with contextlib.suppress(OSError):
        os.nice(PRIORITY)
    # Linux may share the processor among sessions first, each with a priority of its own.
    for name, value in ("autogroup", str(PRIORITY)), ("oom_score_adj", "1000"):
        with contextlib.suppress(OSError):
            Path("/proc/self", name).write_text(value, encoding="ascii")


def _is_locked(folder: Path) -> bool:
    with cache_folders.locked(folder, seconds=0.0) as is_free:
        return not is_free


if __name__ == "__main__":
    sys.exit(main(sys.argv))
