"""Run kernels: backends, devices, launches, compiled kernels, memory.

A process has one backend, normally Warp's. If everything that a render needs is already compiled, the command line runs
kernels without importing Warp, which takes longer than a first picture.
"""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

from wrt.backend.builds import Builds, NotCompiled

if TYPE_CHECKING:
    from wrt.backend.compiled_backend import CompiledBackend
    from wrt.backend.warp_backend import WarpBackend

    Backend = WarpBackend | CompiledBackend

Result = TypeVar("Result")

_backend: Backend | None = None
_builds: Builds | None = None


def current_backend() -> Backend:
    """Return the backend of this process."""
    global _backend
    if _backend is None:
        from wrt.backend.warp_backend import WarpBackend

        _backend = WarpBackend()
    return _backend


def prefer_compiled() -> None:
    """Run compiled kernels without importing Warp, if there are any; otherwise note those that this process compiles.

    Call it before rendering, and only in a process of wrt's own: user code may expect Warp arrays.
    """
    global _backend, _builds
    if _backend is not None or "warp" in sys.modules:
        return
    _builds = Builds.known()
    if _builds:
        from wrt.backend.compiled_backend import CompiledBackend

        _backend = CompiledBackend(_builds)


def is_own_process() -> bool:
    """Return whether this is a process of wrt's own, such as the command line's; see `prefer_compiled`."""
    return _builds is not None


def prepare(build: Callable[[], Result]) -> Result:
    """Call `build` and return its result; if it needs a kernel that is not compiled yet, call it again with Warp."""
    try:
        return build()
    except NotCompiled:
        pass
    leave_compiled()
    return build()


def leave_compiled() -> None:
    """Go over to Warp after NotCompiled; what the other backend has made cannot be used any more."""
    global _backend
    _backend = None
    gc.collect()  # free what it has made, which may be large


def finish() -> None:
    """After the last render, note the kernels that Warp has compiled, for later processes."""
    if not _note(_builds) and _backend is not None:
        from wrt.backend.cache_folders import remove_leftovers

        remove_leftovers()


def note_compiled() -> None:
    """Note the kernels that Warp has compiled in this process, whatever it is, for processes of the command line."""
    _note(_builds or Builds.known())


def _note(builds: Builds | None) -> bool:
    """Note what Warp has compiled, if it has; return whether there is a place for notes."""
    from wrt.backend.warp_backend import WarpBackend

    if not isinstance(_backend, WarpBackend) or builds is None:
        return False
    from wrt.backend.recording import compiled_by_warp

    builds.note(compiled_by_warp(_backend))
    return True
