"""Available memory, arrays in huge pages, and returning unused memory to the system."""

from __future__ import annotations

import contextlib
import ctypes
import math
import mmap
import os
import resource
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

LARGE = 1 << 21
"""Bytes of a huge page; larger arrays have pages of their own."""

MEMORY_ADVICE = "'wrt info --memory SCENE' says what takes it"
"""The end of messages about memory that does not suffice."""


def memory_left(proc: Path = Path("/proc/self"), groups: Path = Path("/sys/fs/cgroup")) -> int:
    """Return the bytes that this process may still take, given the machine's memory, control groups and limits.

    Memory of other processes counts as free, because the system may swap it out.

    Args:
        proc: the folder of the process in /proc.
        groups: the mount point of control groups.
    """
    page = os.sysconf("SC_PAGE_SIZE")
    try:
        space, resident, _, _, _, data, _ = (page * int(n) for n in (proc / "statm").read_text().split())
    except (OSError, ValueError):  # not Linux
        space = resident = data = 0
    available = min([os.sysconf("SC_PHYS_PAGES") * page, *_group_limits(proc, groups)]) - resident
    for kind, used in ((resource.RLIMIT_AS, space), (resource.RLIMIT_DATA, data)):
        limit, _ = resource.getrlimit(kind)
        if limit != resource.RLIM_INFINITY:
            available = min(available, limit - used)
    return max(available, 0)


def _group_limits(proc: Path, groups: Path) -> Iterator[int]:
    """Yield the memory limits of the process's control groups and all their parents, for versions 1 and 2.

    In a container the path may be the host's, whose upper part is not mounted; the process's group is then the mounted
    root.
    """
    try:
        lines = (proc / "cgroup").read_text(encoding="utf-8", errors="surrogateescape").splitlines()
    except OSError:
        return
    for line in lines:
        number, controllers, path = (*line.split(":", 2), "", "")[:3]
        if number == "0" and not controllers:
            roots, name = (groups, groups / "unified"), "memory.max"
        elif "memory" in controllers.split(","):
            roots, name = (groups / "memory", groups / controllers), "memory.limit_in_bytes"
        else:
            continue
        inner = Path(path.lstrip("/"))
        for folder in (root / part for root in roots for part in (inner, *inner.parents)):
            with contextlib.suppress(OSError, ValueError):  # the file is missing, or says "max": no limit
                yield int((folder / name).read_text())


def trim() -> None:
    """Return unused pages of the C library's heap to the system."""
    malloc_trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if malloc_trim is not None:
        malloc_trim(0)


def zeros(shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
    """Return a NumPy array of zeros; a large one takes memory only where it is written to.

    `np.zeros` clears a freed block of the C library's heap if there is one. Large arrays are in huge pages, if the
    system has them, which are released with the array.
    """
    size = math.prod(shape) * np.dtype(dtype).itemsize
    if size < LARGE or not hasattr(mmap, "MADV_HUGEPAGE"):
        return np.zeros(shape, dtype)
    try:
        memory = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    except OSError as error:
        raise MemoryError(f"{size} bytes") from error
    memory.madvise(mmap.MADV_HUGEPAGE)
    return np.frombuffer(memory, dtype).reshape(shape)
