"""Memory is given back to the system, and all that was there works as before."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT

from wrt.memory import trim

STARTED = """
import re, sys
from pathlib import Path
import numpy as np
import warp as wp
from wrt import device

def resident():
    text = Path("/proc/self/smaps").read_text()
    return sum(int(size) for size in re.findall(r"/warp\\.so\\n(?:.+:.+\\n)*?Rss: +(\\d+) kB", text))

if sys.argv[1] == "before":
    device.forget_code = lambda *libraries: None
device.Device("cpu")
kept = resident()
counts = wp.array(np.arange(1000), dtype=int, device="cpu")
sums = wp.empty_like(counts)
wp.utils.array_scan(counts, sums, inclusive=True)
assert sums.numpy()[-1] == 499500
print(kept)
"""

EVERYTHING = """
import json, re, zlib
from pathlib import Path
import numpy as np
from wrt.memory import forget_code

def answers():
    rng = np.random.default_rng(1)
    a = rng.normal(size=(80, 80))
    return [float(np.linalg.det(a)), zlib.crc32(a.tobytes()), json.dumps(a[0].tolist()), str(np.fft.fft(a[1])[3])]

before = answers()
files = {Path(found) for found in re.findall(r"(/\\S+\\.so\\S*)", Path("/proc/self/maps").read_text())}
assert len(files) > 10
forget_code(*files)
assert answers() == before
"""


def run(program: str, *arguments: str) -> str:
    """Run a program in a process of its own, and return what it says."""
    variables = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", program, *arguments]
    return subprocess.run(command, env=variables, check=True, capture_output=True, text=True).stdout


def resident() -> int:
    """Return the bytes of memory that this process has."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def test_most_of_what_warps_library_took_to_start_is_given_back() -> None:
    before, after = (int(run(STARTED, when)) for when in ("before", "after"))
    assert before > 40_000  # kB; else there is nothing to give back
    assert after < 0.4 * before


def test_forgotten_code_runs_again() -> None:
    run(EVERYTHING)


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "malloc_trim"), reason="the C library cannot give memory back")
def test_freed_blocks_are_given_back() -> None:
    malloc, free = ctypes.CDLL(None).malloc, ctypes.CDLL(None).free
    malloc.restype, free.argtypes = ctypes.c_void_p, [ctypes.c_void_p]
    size, count = 60_000, 1000
    blocks = [malloc(size) for _ in range(count)]
    for block in blocks:
        ctypes.memset(block, 1, size)
    for block in blocks[:-1]:  # the last one keeps the heap as long as it is
        free(block)
    before = resident()
    trim()
    assert before - resident() > 0.5 * size * count
    free(blocks[-1])
