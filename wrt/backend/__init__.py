"""Run kernels: backends, devices, launches, compiled kernels, memory.

A process has one backend, normally Warp's. If everything that a render needs is already compiled, the command line runs
kernels without importing Warp, which takes longer than a first picture. So does a Renderer in a process that has not
imported Warp; its backend is then another than that of the process.
"""

from __future__ import annotations

import contextlib
import gc
import sys
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

from wrt.backend.builds import Builds, NotCompiled

if TYPE_CHECKING:
    from wrt.backend.compiled_backend import CompiledBackend
    from wrt.backend.warp_backend import WarpBackend

    Backend = WarpBackend | CompiledBackend

Result = TypeVar("Result")

_backend: Backend | None = None
_builds: Builds | None = None
_known: Builds | None = None
"""Builds for `compiled_first`: those that one call has loaded serve the next."""
_has_imported_warp = False
"""Whether Warp came with wrt. User code that imported it may expect Warp arrays, or have changed how it compiles."""


@dataclass
class _Apart:
    """What runs the kernels of one call: a backend of its own, or that of the process once this is None."""

    backend: Backend | None


_apart: ContextVar[_Apart | None] = ContextVar("wrt_backend_apart", default=None)
"""Set during a call; threads that it starts inherit it (see `wrt.backend.slices.Threads`)."""


def current_backend() -> Backend:
    """Return the backend of this call or process."""
    global _backend, _has_imported_warp
    apart = _apart.get()
    if apart is not None and apart.backend is not None:
        return apart.backend
    if _backend is None:
        _has_imported_warp = _has_imported_warp or "warp" not in sys.modules
        from wrt.backend.headers import precompile_early

        precompile_early()
        from wrt.backend.warp_backend import WarpBackend

        _backend = WarpBackend()
    return _backend


@contextlib.contextmanager
def using(backend: Backend | None) -> Iterator[_Apart]:
    """Within the context, let `current_backend` return a backend. Do not yield from a generator within."""
    apart = _Apart(backend)
    token = _apart.set(apart)
    try:
        yield apart
    finally:
        _apart.reset(token)


def compiled_first(build: Callable[[], Result]) -> Result:
    """Call `build` and return its result, which compiled kernels without Warp have made, if they suffice.

    Objects on a device keep to the backend that has made them (see `using`).
    """
    if is_own_process() or _apart.get() is not None:
        return build()
    builds = _known_builds() if prefers_compiled() else None
    if builds is None:
        return build()
    with using(_compiled(builds)) as apart:
        try:
            return prepare(build)
        finally:
            if apart.backend is None and _has_imported_warp:
                _note(builds)


def _known_builds() -> Builds | None:
    """Return the builds that are known now."""
    global _known
    if _known is None:
        _known = Builds.known()
    else:
        _known.refresh()
    return _known


def _compiled(builds: Builds) -> Backend | None:
    """Return the backend of compiled kernels, if there are any."""
    if not builds:
        return None
    from wrt.backend.compiled_backend import CompiledBackend

    return CompiledBackend(builds)


def prefer_compiled() -> None:
    """Run compiled kernels without importing Warp, if there are any; otherwise note those that this process compiles.

    Call it before rendering, and only in a process of wrt's own: user code may expect Warp arrays.
    """
    global _backend, _builds
    if _backend is not None or "warp" in sys.modules:
        return
    _builds = Builds.known()
    if _builds is not None:
        _backend = _compiled(_builds)
    if _backend is None:
        from wrt.backend.headers import precompile_early

        precompile_early()


def is_own_process() -> bool:
    """Return whether this is a process of wrt's own, such as the command line's; see `prefer_compiled`."""
    return _builds is not None


def prefers_compiled() -> bool:
    """Return whether this process runs compiled kernels without Warp, if there are any."""
    return is_own_process() or _has_imported_warp or "warp" not in sys.modules


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
    apart = _apart.get()
    if apart is not None:
        apart.backend = None
    else:
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
