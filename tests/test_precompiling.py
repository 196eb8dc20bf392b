"""After `wrt compile` or `wrt.precompile` renders compile nothing, and begin with the fastest kernel."""

from __future__ import annotations

import os
import random
import subprocess
import sys
from pathlib import Path

import pytest
import warp as wp
from conftest import ROOT
from support.caches import copy_of_warm_cache
from test_cli import run

import wrt
from wrt.backend.builds import Builds
from wrt.backend.device import Device
from wrt.backend.kernel_cache import compiled_modules
from wrt.backend.lanes import SWITCH as WIDE
from wrt.backend.lanes import lanes_here, lanes_of
from wrt.backend.processor import processor_flags
from wrt.cli import main
from wrt.compiling import kernel
from wrt.compiling.general import general_features
from wrt.kernels.features import Features
from wrt.rendering.guides import guide_features


def test_the_second_call_compiles_nothing() -> None:
    wrt.precompile("cornell-box")
    again = wrt.precompile(wrt.load("cornell-box"), width=20, height=10, threads=1)
    assert (again.modules, again.lanes, again.wide_seconds) == ((), 1, 0.0)
    assert str(again) == "everything was compiled before; there is only the scalar kernel"


def test_what_is_compiled_is_named() -> None:
    unique = f"unique{random.SystemRandom().randrange(10**9)}"
    number = float(int(unique[6:]))

    @wp.kernel(module=unique, enable_backward=False)
    def set_number(x: wp.array(dtype=float)):  # type: ignore[valid-type]
        x[0] = wp.static(number)

    device = Device("cpu")
    with compiled_modules() as outer, compiled_modules() as modules:
        device.compile(set_number)
    assert modules == outer == {unique}
    with compiled_modules() as modules:
        device.compile(set_number)
    assert modules == set()


def test_it_tells_what_it_did() -> None:
    both = wrt.Precompiled(("a", "b"), 5.04, 16, 9.96)
    assert str(both) == "2 modules of kernels compiled in 5.0 s; the wide kernel of 16 lanes compiled in 10.0 s"
    assert str(wrt.Precompiled(("a",), 1.0, 8, 0.0)) == "1 module of kernels compiled in 1.0 s"
    assert str(wrt.Precompiled((), 0.2, 16, 0.0)) == "everything was compiled before"


def test_the_command_goes_on_after_a_mistake(tmp_path: Path) -> None:
    wrt.precompile("cornell-box")
    (tmp_path / "bad.toml").write_text("shapes = 1")
    done = run(tmp_path, "compile", "none.obj", "cornell-box", "bad.toml", "--threads", "1")
    assert done.returncode == 2
    assert done.stdout.startswith("cornell-box: ")
    none, bad = done.stderr.splitlines()
    assert "none.obj" in none
    assert "bad.toml" in bad


RENDER = """
import sys
from wrt.cli import main
from wrt.rendering import wide_kernel
wide_kernel.COMPILED_LOADING_SECONDS = 0.0
sys.argv = ["wrt", "render", "cornell-box", "--size", "96x96", "--spp", "40", "-o", "a.npy", "--quiet"]
assert main() == 0
from wrt.backend import current_backend
assert "warp" not in sys.modules
print(*(name for name in current_backend().builds._loaded if ".wide" in name))
"""


@pytest.mark.skipif(not lanes_of(processor_flags()), reason="the processor has no such registers")
@pytest.mark.slow
@pytest.mark.parametrize("way", ["command", "python"])
def test_the_first_render_has_everything(way: str, tmp_path: Path) -> None:
    """With an empty cache, and with one that lacks a kernel; a render then starts without Warp, in another size."""
    variables = {key: value for key, value in os.environ.items() if key not in (WIDE, "WARP_CACHE_PATH")}
    variables |= {"PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(tmp_path / "cache")}

    if way == "python":
        copy_of_warm_cache(tmp_path / "cache", but_for=("wrt.kernels.film.", "wrt.kernels.accel.build.top_"))

    def python(*arguments: str) -> str:
        done = subprocess.run(
            [sys.executable, *arguments], env=variables, cwd=tmp_path, stdout=subprocess.PIPE, text=True, check=True
        )
        return done.stdout

    call = {
        "command": ["-m", "wrt", "compile", "cornell-box"],
        "python": ["-c", "import wrt; print('cornell-box:', wrt.precompile('cornell-box'))"],
    }[way]
    said = python(*call)
    lanes = lanes_of(processor_flags())
    assert said.startswith("cornell-box: ")
    assert "modules of kernels compiled in" in said
    assert f"the wide kernel of {lanes} lanes compiled in" in said
    assert python("-c", RENDER).strip().startswith(f"wrt.render.wide{lanes}.")
    assert python(*call) == "cornell-box: everything was compiled before\n"


def test_the_command_wants_something_to_compile(tmp_path: Path) -> None:
    done = run(tmp_path, "compile")
    assert (done.returncode, done.stderr) == (2, "wrt: error: name a scene, or give --general\n")


def test_general_kernels_are_compiled_once(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setenv(WIDE, "8")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    asked: list[Features] = []
    monkeypatch.setattr(kernel, "compile_kernel", lambda features, *_: asked.append(features))
    assert main(["compile", "--general", "--sampler", "independent"]) == 0
    plain = Features(("diffuse",), False, "none", sampler="independent")
    assert asked == general_features(plain) + general_features(guide_features(plain, wrt.RenderSettings()))
    monkeypatch.setattr(Builds, "has", lambda *_: True)
    assert main(["compile", "--general"]) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[0].startswith("general kernels: 5 general kernels compiled in ")
    assert said[1:] == ["general kernels: everything was compiled before"]
    assert len(asked) == 5


def test_the_tests_run_without_the_wide_kernel() -> None:
    """Else the first test here says nothing."""
    assert lanes_here() == 0
