"""Memory that runs out in Warp: one line of wrt's own instead of several of Warp's.

On CUDA, Warp's library writes what failed to file descriptor 2 before Python learns of it. And the CUDA runtime keeps
the error of a failed allocation, which the next prefix sum of this thread would take for its own.
"""

from __future__ import annotations

import contextlib
import re
import threading
from collections.abc import Iterator
from typing import Any

from wrt.backend.memory import MEMORY_ADVICE
from wrt.errors import NotEnoughMemory

_NO_MEMORY = re.compile(r"Failed to allocate (\d+) bytes")
"""What Warp says when an array finds no memory."""

_NO_MEMORY_OF_CUDA = "out of memory"
"""What CUDA says when a launch or a prefix sum finds none."""


class _Silence:
    """Whether the library writes its errors: a switch of the process, which several threads may turn at once."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._users, self._wrote = 0, 1

    @contextlib.contextmanager
    def kept(self, core: Any) -> Iterator[None]:
        """Within the context, the library writes no errors; exceptions have the last one all the same."""
        with self._lock:
            self._users += 1
            if self._users == 1:
                self._wrote = core.wp_is_error_output_enabled()
                core.wp_set_error_output_enabled(0)
        try:
            yield
        finally:
            with self._lock:
                self._users -= 1
                if self._users == 0:
                    core.wp_set_error_output_enabled(self._wrote)


_silence = _Silence()


@contextlib.contextmanager
def on_device(device: Any) -> Iterator[None]:
    """Within the context, raise NotEnoughMemory when memory of a device runs out, and let Warp write nothing.

    A GPU's CUDA context is the current one within: Warp's prefix sums, sums and sorts run in that, whatever device
    their arrays are on, and so does the allocation of pinned memory.

    Args:
        device: the name, or Warp's device.
    """
    gpu = _cuda(device)
    try:
        if gpu is None:
            yield
        else:
            with _silence.kept(gpu.runtime.core), gpu.context_guard:
                yield
    except RuntimeError as error:
        raise plain(error, device) from None


def plain(error: RuntimeError, device: Any) -> Exception:
    """Return NotEnoughMemory if an exception of Warp says that memory of a device ran out; else the exception."""
    if found := _NO_MEMORY.match(str(error)):
        return ran_out(device, int(found[1]))
    return ran_out(device) if _NO_MEMORY_OF_CUDA in str(error) else error


def ran_out(device: Any, size: int = 0) -> NotEnoughMemory:
    """Return the error that memory ran out, and let CUDA forget its own.

    Args:
        device: the name, or Warp's device.
        size: the bytes that were not found, 0 if unknown.
    """
    gpu = _cuda(device)
    if gpu is not None:
        with _silence.kept(gpu.runtime.core):
            gpu.runtime.core.wp_cuda_context_check(gpu.context)
    shortage = f": {size / 1e9:.2f} GB more were needed" if size else ""
    return NotEnoughMemory(f"memory ran out on {device}{shortage}; {MEMORY_ADVICE}")


def _cuda(device: Any) -> Any:
    """Return Warp's device if it is a GPU, else None."""
    if device == "cpu":
        return None
    from warp import get_device

    of = get_device(device)
    return of if of.is_cuda else None
