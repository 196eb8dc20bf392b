"""Kernels compiled for later renders: by a process of low priority, by `wrt compile`, by `wrt.precompile`."""

import contextlib
import dataclasses
import hashlib
import os
import resource
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT
from support.caches import copy_of_warm_cache, python, without_artefacts
from support.wide_scenes import LANES, needs_lanes

import wrt
from wrt.backend import cache_folders, current_backend
from wrt.backend.artefacts import Artefacts
from wrt.backend.processor import SWITCH as WIDE
from wrt.cli import main
from wrt.cli.system import system_text
from wrt.compiling import kernel, later
from wrt.compiling.general import general_features
from wrt.compiling.later import BEGUN, BUILD_MACHINE, RETRY_SECONDS, SWITCH, is_done
from wrt.kernels.core.features import Features
from wrt.rendering.guides import guide_features
from wrt.spmd.ir import Unsupported

DIFFUSE = Features(("diffuse",), False, "none", sampler="sobol")
MIRROR = Features(("mirror",), False, "constant", light_shapes=("disk", "sphere"))


@pytest.fixture
def started(monkeypatch):
    """Return the folders for which compilers would be started."""
    folders = []
    monkeypatch.setattr(later, "_start", lambda _, kernels: folders.append(kernels))
    monkeypatch.setenv(SWITCH, "")
    monkeypatch.delenv(BUILD_MACHINE, raising=False)
    return folders


@pytest.fixture
def table(tmp_path, monkeypatch):
    """Return the file of a table of artefacts in a folder of its own."""
    artefacts = Artefacts()
    assert artefacts.path is not None
    artefacts.path = tmp_path / "wrt" / artefacts.path.name
    artefacts.folders = [artefacts.path.parent]
    artefacts.table["values"].clear()
    monkeypatch.setattr(current_backend(), "artefacts", artefacts)
    return artefacts.path


def request(features: Features, lanes: int, kernels: Path) -> Path | None:
    """Request a kernel that goes into a folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cache_folders, "kernels_folder", lambda: kernels)
        return later.request(features, lanes)


@pytest.fixture
def compiled(monkeypatch):
    """Return what `main` would have compiled; diffuse surfaces are not translated, or rejected by clang."""
    features = []

    def compile_kernel(requested, lanes, part):
        assert part == kernel.RENDER
        if requested == DIFFUSE:
            raise Unsupported("diffuse") if lanes == 8 else RuntimeError("CPU kernel build failed")
        features.append(requested)

    monkeypatch.setattr(later, "compile_kernel", compile_kernel)
    monkeypatch.setattr(later, "give_way", lambda: None)
    monkeypatch.setattr(signal, "alarm", lambda _: 0)
    monkeypatch.setattr(resource, "setrlimit", lambda *_: None)
    return features


def serve(table: Path, kernels: Path) -> int:
    return later.main(["", table.stem, str(kernels)])


@pytest.mark.parametrize(
    ("switch", "machine", "compiles", "text"),
    [
        ("", None, True, "for the next"),
        ("0", "true", False, f"as {SWITCH} says"),
        ("1", "true", True, "for the next"),
        ("", "true", False, f"as {BUILD_MACHINE} says"),
        ("", "false", True, "for the next"),
    ],
)
def test_build_machines_and_the_switch(switch, machine, compiles, text, started, table, tmp_path, monkeypatch):
    monkeypatch.setenv(SWITCH, switch)
    monkeypatch.setenv(WIDE, "8")
    if machine is not None:
        monkeypatch.setenv(BUILD_MACHINE, machine)
    path = request(MIRROR, 8, tmp_path)
    assert (path is not None, started) == (compiles, [tmp_path] * compiles)
    assert text in system_text()


def test_what_is_requested_is_compiled_once(started, table, compiled, tmp_path):
    kernels, elsewhere = tmp_path / "kernels", tmp_path / "elsewhere"
    path = request(MIRROR, 8, kernels)
    path_elsewhere = request(dataclasses.replace(MIRROR, composite="holes"), 8, elsewhere)
    textured = dataclasses.replace(MIRROR, textured=True)
    request(textured, 8, kernels)
    assert path is not None
    assert path_elsewhere is not None
    assert not is_done(path)
    assert serve(table, kernels) == serve(table, kernels) == 0
    assert sorted(compiled, key=str) == sorted([MIRROR, textured], key=str)
    assert is_done(path)
    assert not is_done(path_elsewhere), "it belongs into another folder"
    assert started == [kernels, elsewhere, kernels]


def test_what_cannot_be_compiled_is_left_for_an_hour_and_damaged_requests_are_removed(
    started, table, compiled, tmp_path
):
    path, damaged = request(DIFFUSE, 8, tmp_path), request(MIRROR, 8, tmp_path)
    rejected = request(DIFFUSE, 16, tmp_path)
    assert path is not None
    assert rejected is not None
    assert damaged is not None
    damaged.write_text("{")
    assert serve(table, tmp_path) == 0
    assert compiled == []
    assert not damaged.exists()
    assert rejected.with_suffix(BEGUN).exists()
    assert request(DIFFUSE, 8, tmp_path) is None
    before = time.time() - RETRY_SECONDS - 1.0
    os.utime(path.with_suffix(BEGUN), (before, before))
    assert request(DIFFUSE, 8, tmp_path) == path
    assert len(started) == 4


def test_one_process_compiles_and_serves_what_comes_meanwhile(started, table, compiled, tmp_path, monkeypatch):
    second = dataclasses.replace(MIRROR, composite="holes")
    paths = []

    def compile_kernel(features, *_, **__):
        if features == MIRROR:
            paths.append(request(second, 8, tmp_path))
            assert serve(table, tmp_path) == 0, "another process ends at once"
            assert not compiled
        compiled.append(features)

    monkeypatch.setattr(later, "compile_kernel", compile_kernel)
    request(MIRROR, 8, tmp_path)
    serve(table, tmp_path)
    assert compiled == [MIRROR, second]
    assert len(started) == 1
    assert is_done(paths[0])


def test_a_cache_that_cannot_be_written_to_is_left_alone(started, table, tmp_path):
    (tmp_path / "file").touch()
    assert request(MIRROR, 8, tmp_path / "file") is None
    assert started == []


def processes(folder: Path) -> list[int]:
    """Return the compilers whose kernels go into a folder."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            words = path.read_bytes().split(b"\0")
            if any(b"wrt.compiling.later" in word for word in words) and os.fsencode(folder) in words:
                found.append(int(path.parent.name))
    return found


def until(condition: Any, seconds: float = 900.0) -> None:
    limit = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < limit
        time.sleep(0.05)


SHORT = """
import sys
from wrt.compiling import later
from wrt.rendering import wide_kernel
from wrt.cli import main
wide_kernel.LOADING_SECONDS = 0.0
wide_kernel.COMPILING_SECONDS, later.WORTH = 1e9, 0.0
sys.argv = ["wrt", "render", "cornell-box", "--size", "96x96", "--spp", "40", "-o", sys.argv[1], "--quiet"]
assert main() == 0
from wrt.backend import current_backend
loaded = current_backend().artefacts.loaded
print(*(name for name in (() if "warp" in sys.modules else loaded) if ".wide" in name))
"""


@needs_lanes
@pytest.mark.machinery
def test_the_second_render_from_the_shell_has_the_kernel(tmp_path):
    """The compiler is killed once, which leaves nothing; the picture is the same, and the shell never waits."""
    variables = {key: value for key, value in os.environ.items() if key not in (WIDE, BUILD_MACHINE)}
    variables |= {SWITCH: "1", "PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(tmp_path / "cache")}
    variables.pop("WARP_CACHE_PATH", None)
    copy_of_warm_cache(tmp_path / "cache")

    def render(name):
        """Return the wide kernels that were loaded without Warp."""
        # The streams are read to their end: a compiler that held them open would keep the shell waiting.
        return python(tmp_path, variables, "-c", SHORT, name).split()

    requests, kernels = tmp_path / "cache" / "wrt" / "requests", tmp_path / "cache" / "warp"
    render("first.npy")
    (compiler,) = processes(kernels)
    assert os.getsid(compiler) != os.getsid(0)
    until(lambda: list(requests.glob(f"*{BEGUN}")))
    assert os.getpriority(os.PRIO_PROCESS, compiler) == later.PRIORITY
    os.kill(compiler, signal.SIGKILL)
    until(lambda: not processes(kernels))
    assert not list(kernels.rglob("*wide*"))
    render("again.npy")
    assert not processes(kernels), "it is not compiled again at once"
    for begun in requests.glob(f"*{BEGUN}"):
        os.utime(begun, (1.0, 1.0))
    render("third.npy")
    for compiler in processes(kernels):
        with contextlib.suppress(OSError):  # where this is allowed, the test need not wait for others
            os.setpriority(os.PRIO_PROCESS, compiler, 0)
    until(lambda: not processes(kernels))
    assert list(kernels.rglob("*wide*.o"))
    assert not list(requests.iterdir())
    assert len(render("last.npy")) == 1
    assert not processes(kernels)
    films = {hashlib.sha256((tmp_path / f"{name}.npy").read_bytes()).digest() for name in ("first", "again", "last")}
    assert len(films) == 1


def test_the_command_goes_on_after_a_mistake(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("bad.toml").write_text("shapes = 1")
    assert main(["compile", "none.obj", "cornell-box", "bad.toml", "--threads", "1"]) == 2
    printed = capsys.readouterr()
    assert printed.out.startswith("cornell-box: ")
    none, bad = printed.err.splitlines()
    assert "none.obj" in none
    assert "bad.toml" in bad
    assert main(["compile", "cornell-box", "--threads", "1"]) == 0
    assert capsys.readouterr().out == "cornell-box: everything was compiled before; there is only the scalar kernel\n"
    result = wrt.Precompiled(("a", "b"), 5.04, 16, 9.96)
    assert str(result) == "2 modules of kernels compiled in 5.0 s; the wide kernel of 16 lanes compiled in 10.0 s"
    assert main(["compile"]) == 2
    assert capsys.readouterr().err == "wrt: error: name a scene, or give --general\n"


def test_general_kernels_are_compiled_once(monkeypatch, capsys, tmp_path):
    monkeypatch.setenv(WIDE, "8")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    compiled = []
    monkeypatch.setattr(kernel, "compile_kernel", lambda features, *_, **__: compiled.append(features))
    assert main(["compile", "--general", "--sampler", "independent"]) == 0
    plain = Features(("diffuse",), False, "none", sampler="independent")
    assert compiled == general_features(plain) + general_features(guide_features(plain, wrt.RenderSettings()))
    monkeypatch.setattr(kernel, "is_compiled", lambda *_: True)
    assert main(["compile", "--general"]) == 0
    first, second = capsys.readouterr().out.splitlines()
    assert first.startswith("general kernels: 5 general kernels compiled in ")
    assert second == "general kernels: everything was compiled before"
    assert len(compiled) == 5


@needs_lanes
@pytest.mark.machinery
@pytest.mark.parametrize("cache", ["warm", "empty"])
def test_the_first_render_has_everything(cache, tmp_path):
    """A render then starts without Warp, in another size, and gives the picture of the scalar kernel."""
    variables = without_artefacts(tmp_path)
    del variables[WIDE]
    if cache == "empty":
        del variables["WARP_CACHE_PATH"]

    printed = python(tmp_path, variables, "-m", "wrt", "compile", "cornell-box")
    assert printed.startswith("cornell-box: ")
    if cache == "empty":
        assert "modules of kernels compiled in" in printed
        assert f"the wide kernel of {LANES} lanes compiled in" in printed
    assert python(tmp_path, variables, "-c", SHORT, "wide.npy").count("\n") == 1
    scalar = wrt.Renderer(wrt.load("cornell-box"), width=96, height=96)
    list(scalar.passes(spp=40))
    np.testing.assert_array_equal(np.load(tmp_path / "wide.npy"), scalar.image())
    call = "import wrt; print('cornell-box:', wrt.precompile('cornell-box'))"
    assert python(tmp_path, variables, "-c", call) == "cornell-box: everything was compiled before\n"
