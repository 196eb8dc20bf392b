"""Memory that libraries leave behind, given back to the system."""

from __future__ import annotations

import contextlib
import ctypes
import os
import re
import sys
from pathlib import Path

_MADV_DONTNEED = 4  # of Linux's mman.h
_MAPPING = re.compile(r"([0-9a-f]+)-([0-9a-f]+) (\S{4}) \S+ \S+ \S+ +(/.*)")


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
