"""Run kernels: the backend, devices, launches, compiled kernels, memory."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from wrt.backend.backend import Backend

_backend: Backend | None = None


def current_backend() -> Backend:
    """Return the backend of this process."""
    global _backend
    if _backend is None:
        from wrt.backend.backend import Backend

        _backend = Backend()
    return _backend
