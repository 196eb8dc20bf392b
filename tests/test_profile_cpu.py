"""The profile says of every part of a kernel which phase it is, by the lines of its source."""

from __future__ import annotations

import collections
import json
import shutil
import subprocess
import sys

import profile_cpu
import pytest
from conftest import ROOT, Report


def test_every_file_of_kernels_is_accounted_for() -> None:
    for path in (ROOT / "kernels").rglob("*.py"):
        profile_cpu.phase_of_file(path)
    named = [name for names in profile_cpu.PHASES.values() for name in names]
    for name in [*named, *profile_cpu.HELPERS, *profile_cpu.OTHER_KERNELS]:
        assert (ROOT / "kernels" / name).is_dir() or (ROOT / "kernels" / f"{name}.py").is_file(), name
    with pytest.raises(profile_cpu.ProfileError, match="not in PHASES"):
        profile_cpu.phase_of_file(ROOT / "kernels" / "another" / "file.py")


def test_functions_have_the_phase_of_their_file() -> None:
    phases = profile_cpu.phases_of_functions()
    expected = {
        "bvh_hit": "traversal",
        "trace_path": "path",
        "light_at_surface": "lights",
        "render_pass": "camera and film",
    }
    assert {name: phases[name] for name in expected} == expected
    assert "to_local" not in phases


def test_names_of_warp_are_read() -> None:
    names = {
        "make_trace_path__locals__trace_path_0": "trace_path",
        "bvh_hit_0": "bvh_hit",
        "sample_12": "sample",
        "make_render_kernel__locals__render_pass_0b97391f_cpu_kernel_forward": "render_pass",
        "make_render_kernel__locals__render_pass_0b97391f_cpu_forward_tasks": "render_pass",
        "sample_4d_0": "sample_4d",
    }
    assert {name: profile_cpu.plain_name(name) for name in names} == names


def test_libraries_are_told_apart() -> None:
    names = {
        "/usr/bin/python3.11": "Python",
        "/x/site-packages/numpy/_core/_multiarray_umath.cpython-311.so": "Python",
        "/x/site-packages/warp/bin/warp.so": "Warp",
        "[kernel.kallsyms]": "system",
        "/lib/x86_64-linux-gnu/libc.so.6": "system",
        "//anon": "everything else",
    }
    assert {name: profile_cpu.host_phase(name) for name in names} == names


def test_what_is_missing_is_told(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(shutil, "which", lambda _: None)
    assert profile_cpu.main(["--scenes", "cornell"]) == 2
    assert "perf was not found: apt-get install" in capsys.readouterr().err


@pytest.mark.slow
def test_lines_of_a_compiled_kernel_are_found(report: Report) -> None:
    """All of a kernel's code, as if each sixteenth byte had been seen once."""
    if not (shutil.which("addr2line") and shutil.which("objdump")):
        pytest.skip("addr2line and objdump are not installed")
    line = [sys.executable, "scripts/profile_cpu.py", "--render", "cornell", "--size", "32"]
    with subprocess.Popen(line, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        started = json.loads(process.stdout.readline())
        process.stdin.close()
    section, entry, length = profile_cpu.place_of(started["kernel"], started["object"])
    base = started["address"] - entry
    samples = [(base + offset, "//anon") for offset in range(entry, length, 16)] + [(1, "/usr/bin/python3.11")]
    phases, functions = profile_cpu.shares(samples, started, profile_cpu.phases_of_functions())
    assert section
    assert {"traversal", "path", "lights", "surface and material", "random numbers", "Python"} <= set(phases)
    assert {"closest_hit", "trace_path", "sample_triangle"} <= set(functions)
    assert sum(phases.values()) == pytest.approx(1.0)
    report("code of no phase", phases.get("everything else", 0.0))
    assert phases.get("everything else", 0.0) < 0.1
    assert collections.Counter(functions).most_common(1)[0][1] < 0.5
