"""Headers that Warp precompiles for the CPU are made once a machine, and lent to every thread that compiles."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import warp as wp
from conftest import ROOT, WARPS_FLAGS

from wrt.backend import headers, kernel_cache
from wrt.backend.kernel_cache import Build
from wrt.backend.warp_backend import initialize_warp

PROGRAM = """
import sys
from pathlib import Path
import warp as wp
from wrt.backend import headers
from wrt.backend.device import Device

@wp.kernel(enable_backward=False)
def double(first: int, x: wp.array(dtype=float)):
    x[first + wp.tid()] *= 2.0

kept = []
keep, headers._keep = headers._keep, lambda *arguments: (kept.append(arguments), keep(*arguments))
wp.config.kernel_cache_dir = sys.argv[1]
Device("cpu").compile(double)
print("written" if kept else "lent")
"""


@pytest.fixture
def no_headers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of a cache without precompiled headers."""
    initialize_warp()
    headers._PRECOMPILER.submit(int).result()  # what Warp's start has begun is done
    monkeypatch.setattr(headers, "_kept", lambda: tmp_path / "headers-0")
    monkeypatch.setattr(wp.config, "cpu_compiler_flags", WARPS_FLAGS)
    return tmp_path / "headers-0"


def test_one_thread_precompiles_headers_and_all_get_them(no_headers: Path) -> None:
    asked: list[int] = []

    def header() -> Path:
        return Path(str(headers._of_thread()), "builtin_1.pch")

    def precompile() -> None:
        asked.append(threading.get_ident())
        time.sleep(0.05)
        header().write_bytes(b"headers")

    def compile(_: int) -> tuple[int, bytes]:
        everybody.wait()
        headers.lend_headers(precompile)
        found = header().read_bytes()
        header().unlink()  # a thread of another test may get this folder
        return threading.get_ident(), found

    everybody = threading.Barrier(4)
    with ThreadPoolExecutor(4) as pool:
        found = dict(pool.map(compile, range(4)))
    assert len(asked) == 1
    assert set(found.values()) == {b"headers"}
    assert len(found) == 4


@pytest.mark.parametrize("early", [False, True], ids=["by Warp", "without Warp"])
def test_headers_precompiled_before_kernels_are_those_of_kernels(early: bool, no_headers: Path, tmp_path: Path) -> None:
    @wp.kernel(enable_backward=False, module=wp.get_module("wrt.test_headers"))
    def nothing(first: int) -> None:
        pass

    own = Build.of(nothing.module, "cpu")
    assert own is not None

    def precompile() -> None:
        assert not early
        kernel_cache.compile_nothing()

    def compile() -> str:
        headers.lend_headers(precompile)
        (written,) = Path(str(headers._of_thread())).glob(headers.WRITTEN)
        before = written.stat().st_mtime_ns
        own.compile(tmp_path / "build")
        assert [path.stat().st_mtime_ns for path in written.parent.glob(headers.WRITTEN)] == [before]
        return written.name

    if early:
        headers.precompile_early()
        headers._PRECOMPILER.submit(int).result()
    with ThreadPoolExecutor(1) as pool:
        name = pool.submit(compile).result()
    assert [kept.name.rpartition("-")[0] for kept in no_headers.iterdir()] == [name]


@pytest.mark.slow
def test_warps_headers_are_kept_for_other_processes_and_written_anew_where_damaged(tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(PROGRAM)
    variables = {**os.environ, "PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(tmp_path)}

    def compile_once(number: int) -> str:
        command = [sys.executable, str(tmp_path / "program.py"), str(tmp_path / f"kernels{number}")]
        return subprocess.run(command, env=variables, check=True, capture_output=True, text=True).stdout.strip()

    assert compile_once(0) == "written"
    assert compile_once(1) == "lent"
    (kept,) = tmp_path.glob("wrt/headers-*/*")
    whole = kept.read_bytes()
    kept.write_bytes(whole[: len(whole) // 2])
    assert compile_once(2) == "written"
    (kept,) = tmp_path.glob("wrt/headers-*/*")
    assert len(kept.read_bytes()) == len(whole)


def test_headers_are_kept_apart_where_one_of_them_has_changed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("__init__.py", "config.py", "bin/warp.so", "bin/warp-clang.so", "native/vec.h"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    monkeypatch.setattr(headers, "folder_of", lambda _: tmp_path)
    folder_now = headers._kept.__wrapped__
    before = folder_now()
    assert folder_now() == before
    os.utime(tmp_path / "native/vec.h", (1, 1))
    assert folder_now() != before
