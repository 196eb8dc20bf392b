"""The memory left is found correctly; memory is returned to the system without breaking anything."""

from __future__ import annotations

import ctypes
import os
import re
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import ROOT

from wrt.backend.memory import memory_left, trim

STARTED = """
import re, sys
from pathlib import Path
import numpy as np
import warp as wp
from wrt.backend import warp_backend
from wrt.backend.device import Device

def resident():
    text = Path("/proc/self/smaps").read_text()
    return sum(int(size) for size in re.findall(r"/warp\\.so\\n(?:.+:.+\\n)*?Rss: +(\\d+) kB", text))

if sys.argv[1] == "before":
    warp_backend.forget_code = lambda *libraries: None
Device("cpu")
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
from wrt.backend.memory import forget_code

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


def fake(folder: Path, cgroup: str, files: dict[str, str]) -> tuple[Path, Path]:
    proc, groups = folder / "proc", folder / "groups"
    proc.mkdir()
    (proc / "statm").write_text("3000 1000 10 1 0 2000 0\n")
    (proc / "cgroup").write_text(cgroup)
    for name, text in files.items():
        (groups / name).parent.mkdir(parents=True, exist_ok=True)
        (groups / name).write_text(text)
    return proc, groups


MACHINE = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
RESIDENT = 1000 * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.parametrize(
    ("cgroup", "files", "limit"),
    [
        ("", {}, MACHINE),
        ("0::/a/b\n", {"a/b/memory.max": "max\n", "a/memory.max": "max\n"}, MACHINE),
        ("0::/a/b\n", {"a/b/memory.max": "50000000\n", "a/memory.max": "max\n"}, 50_000_000),
        ("0::/a/b\n", {"a/b/memory.max": "50000000\n", "a/memory.max": "40000000\n"}, 40_000_000),
        ("0::/a/b\n", {"a/b/memory.max": "max\n", "other/memory.max": "1\n"}, MACHINE),
        ("0::/\n", {"memory.max": "30000000\n"}, 30_000_000),  # a container with its own cgroup namespace
        ("0::/machine/c1\n", {"memory.max": "30000000\n"}, 30_000_000),  # a container without one
        ("1:name=systemd:/x\n4:memory:/a\n", {"memory/a/memory.limit_in_bytes": "20000000\n"}, 20_000_000),
        ("4:cpu,memory:/a\n", {"cpu,memory/a/memory.limit_in_bytes": "20000000\n"}, 20_000_000),
        ("4:memory:/docker/c\n", {"memory/memory.limit_in_bytes": "20000000\n"}, 20_000_000),
        ("4:memory:/a\n", {"memory/a/memory.limit_in_bytes": "9223372036854771712\n"}, MACHINE),
        ("0::/\n4:memory:/a\n", {"memory/a/memory.limit_in_bytes": "20000000\n", "unified/memory.max": "max"}, 2e7),
        ("0::/a:b\n", {"a:b/memory.max": "50000000\n"}, 50_000_000),
        ("nonsense\n0::/a\n", {"a/memory.max": "none of these\n"}, MACHINE),
        ("0::/a\n", {"a/memory.max": "1000\n"}, RESIDENT),  # less than the process has already
    ],
)
def test_limits_of_control_groups(cgroup: str, files: dict[str, str], limit: int, tmp_path: Path) -> None:
    assert memory_left(*fake(tmp_path, cgroup, files)) == limit - RESIDENT


def test_where_the_system_says_nothing(tmp_path: Path) -> None:
    assert memory_left(tmp_path / "none", tmp_path / "none") == MACHINE


TOO_LARGE = ("-m", "wrt", "render", "cornell-box", "--size", "8000x8000", "--spp", "1", "-o", "x.png", "--quiet")


def refused(folder: Path, before: Callable[[], None]) -> None:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, *TOO_LARGE]
    result = subprocess.run(
        command,
        env=environment,
        cwd=folder,
        capture_output=True,
        text=True,
        preexec_fn=before,
        timeout=300,
        check=False,
    )
    assert result.returncode == 1, result.stderr
    assert re.fullmatch(
        r"wrt: error: a picture of 8000x8000 needs 7\.7 GB, more than the [0-2]\.\d GB that cpu has left\n",
        result.stderr,
    )


@pytest.mark.parametrize("kind", [resource.RLIMIT_AS, resource.RLIMIT_DATA])
def test_limits_of_the_process_are_known(kind: int, tmp_path: Path) -> None:
    refused(tmp_path, lambda: resource.setrlimit(kind, (2 << 30, 2 << 30)))


def test_the_limit_of_a_real_control_group_is_known(tmp_path: Path) -> None:
    places = [(Path("/sys/fs/cgroup/memory"), "memory.limit_in_bytes"), (Path("/sys/fs/cgroup"), "memory.max")]
    root, name = next(((root, name) for root, name in places if root.is_dir()), (Path(), ""))
    group = root / f"wrt-test-{os.getpid()}"
    try:
        group.mkdir()
    except OSError:
        pytest.skip("no control groups can be made here")
    try:
        try:
            (group / name).write_text(str(2 << 30))
            probe = subprocess.run(
                ["true"], preexec_fn=lambda: (group / "cgroup.procs").write_text(str(os.getpid())), check=False
            )
        except (OSError, subprocess.SubprocessError):
            pytest.skip("no process can be put into a control group here")
        assert probe.returncode == 0
        refused(tmp_path, lambda: (group / "cgroup.procs").write_text(str(os.getpid())) and None)
    finally:
        group.rmdir()
