"""How much memory this process may still take, and returning unused memory of libraries to the system."""

from __future__ import annotations

import contextlib
import ctypes
import os
import re
import resource
import sys
from collections.abc import Iterator
from pathlib import Path

_MADV_DONTNEED = 4  # of Linux's mman.h
_MAPPING = re.compile(r"([0-9a-f]+)-([0-9a-f]+) (\S{4}) \S+ \S+ \S+ +(/.*)")


def memory_left(proc: Path = Path("/proc/self"), groups: Path = Path("/sys/fs/cgroup")) -> int:
    """Return how many more bytes this process may take, by the machine's memory, its control groups and its limits.

    Memory of other processes counts as free, as the system may swap it out.

    Args:
        proc: the process's folder in /proc.
        groups: where control groups are mounted.
    """
    page = os.sysconf("SC_PAGE_SIZE")
    try:
        space, resident, _, _, _, data, _ = (page * int(n) for n in (proc / "statm").read_text().split())
    except (OSError, ValueError):  # not Linux
        space = resident = data = 0
    held = [os.sysconf("SC_PHYS_PAGES") * page, *_group_limits(proc, groups)]
    left = min(held) - resident
    for kind, used in ((resource.RLIMIT_AS, space), (resource.RLIMIT_DATA, data)):
        limit, _ = resource.getrlimit(kind)
        if limit != resource.RLIM_INFINITY:
            left = min(left, limit - used)
    return max(left, 0)


def _group_limits(proc: Path, groups: Path) -> Iterator[int]:
    """Yield the memory limits of the process's control groups and of all their parents, for versions 1 and 2.

    In a container the path may be the host's, of which the upper part is not mounted: then the process's group is the
    mounted root.
    """
    try:
        lines = (proc / "cgroup").read_text(encoding="utf-8", errors="surrogateescape").splitlines()
    except OSError:
        return
    for line in lines:
        number, _, rest = line.partition(":")
        controllers, _, path = rest.partition(":")
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
    """Give back the pages of the C library's heap that nobody uses any more."""
    malloc_trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if malloc_trim is not None:
        malloc_trim(0)


def forget_code(*libraries: Path) -> None:
    """Take out of this process's memory what it has of the code of libraries, which comes back where it is run again.

    That is fast, as the file stays in the system's cache. Only for pages that are as they are in the file: where a part
    of it was changed, as by the linker that loaded it, that part stays.
    """
    if not sys.platform.startswith("linux"):
        return
    names = {os.fspath(library) for library in libraries}
    madvise = ctypes.CDLL(None).madvise
    madvise.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int]
    with contextlib.suppress(OSError, UnicodeDecodeError):
        start = size = 0
        for line in Path("/proc/self/smaps").read_text(encoding="utf-8").splitlines():
            if found := _MAPPING.fullmatch(line):
                start, end = int(found[1], 16), int(found[2], 16)
                size = end - start if found[4] in names and found[3] in ("r-xp", "r--p") else 0
            elif size and line.startswith("Anonymous:") and int(line.split()[1]) == 0:
                madvise(start, size, _MADV_DONTNEED)
