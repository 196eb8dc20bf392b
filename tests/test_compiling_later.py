"""What a short render lacks is compiled for the next one: once, by one process that disturbs nobody."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT

from wrt.backend.builds import Builds
from wrt.backend.device import Device
from wrt.backend.lanes import SWITCH as WIDE
from wrt.backend.lanes import lanes_of
from wrt.backend.processor import processor_flags
from wrt.compiling import later
from wrt.compiling.general import general_features, is_general
from wrt.compiling.later import BEGUN, BUILD_MACHINE, REQUESTED, RETRY_SECONDS, SWITCH, is_done, request
from wrt.describe.system import system_text
from wrt.kernels.features import Features
from wrt.rendering import wide_kernel
from wrt.rendering.wide_kernel import COMPILING_SECONDS, LOADING_SECONDS, WORTH_SECONDS, WideKernel
from wrt.spmd.ir import Unsupported

needs_lanes = pytest.mark.skipif(not lanes_of(processor_flags()), reason="the processor has no such registers")

DIFFUSE = Features(("diffuse",), False, "none", sampler="sobol")
MIRROR = Features(("mirror",), False, "constant", light_shapes=("disk", "sphere"))


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """Return the folders of the compilers that are started, none of which really is; they are wanted."""
    folders: list[Path] = []
    monkeypatch.setattr(later, "_start", lambda _, kernels: folders.append(kernels))
    monkeypatch.setenv(SWITCH, "")
    monkeypatch.delenv(BUILD_MACHINE, raising=False)
    return folders


@pytest.fixture
def builds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Builds:
    """Return notes in a folder of their own."""
    known = Builds.known()
    assert known is not None
    found = Builds(tmp_path / "wrt" / known.path.name, known._warp, known.warp_version)
    monkeypatch.setattr(Builds, "known", lambda: found)
    return found


@pytest.fixture
def compiled(monkeypatch: pytest.MonkeyPatch) -> list[Features]:
    """Return what `main` has compiled, which it only notes here; diffuse surfaces cannot be translated."""
    features: list[Features] = []

    def compile_kernel(asked: Features, lanes: int, builds: Builds, uses: Any) -> None:
        assert (uses is not None) == is_general(asked)
        if asked == DIFFUSE:
            raise Unsupported("diffuse")
        features.append(asked)

    monkeypatch.setattr(later, "compile_kernel", compile_kernel)
    monkeypatch.setattr(later, "_give_way", lambda: None)
    monkeypatch.setattr(signal, "alarm", lambda _: 0)
    return features


def serve(builds: Builds, kernels: Path) -> int:
    return later.main(["", builds.path.stem, str(kernels)])


def kernel() -> WideKernel:
    found = WideKernel(Device("cpu"), DIFFUSE, ())
    found._is_usable = lambda: True  # type: ignore[method-assign]
    return found


def test_a_short_render_asks_once_and_the_shortest_never(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Features] = []
    monkeypatch.setattr(later, "request", lambda features, *_: asked.append(features))
    wide = kernel()
    wide._builds = Builds.known()
    wide.prepare(LOADING_SECONDS / 2)
    monkeypatch.setattr(wide_kernel, "LOADING_SECONDS", 0.0)
    wide.prepare(WORTH_SECONDS / 2)
    assert asked == []
    for _ in range(3):
        wide.prepare((LOADING_SECONDS + COMPILING_SECONDS) / 2)
    assert asked == [DIFFUSE]
    assert not wide.is_being_compiled


def test_a_render_that_ends_before_its_compiler_asks_for_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Features] = []
    monkeypatch.setattr(later, "request", lambda features, *_: asked.append(features))
    monkeypatch.setattr(WideKernel, "_folders", lambda _: [])
    real = subprocess.Popen
    sleep = [sys.executable, "-c", "import time; time.sleep(60)"]
    monkeypatch.setattr("wrt.rendering.wide_kernel.subprocess.Popen", lambda *_, **__: real(sleep))
    wide = kernel()
    wide._builds = Builds.known()
    wide.prepare(10.0 * COMPILING_SECONDS)
    compiler = wide._compiler
    assert compiler is not None
    del wide
    assert compiler.poll() == -signal.SIGKILL
    assert asked == [DIFFUSE]


@pytest.mark.parametrize(
    ("told", "machine", "expected"),
    [("", None, True), ("0", None, False), ("1", "true", True), ("", "true", False), ("", "false", True)],
)
def test_build_machines_and_the_switch(
    told: str,
    machine: str | None,
    expected: bool,
    started: list[Path],
    builds: Builds,
    tmp_path: Path,
    monkeypatch: Any,
) -> None:
    monkeypatch.setenv(SWITCH, told)
    if machine is not None:
        monkeypatch.setenv(BUILD_MACHINE, machine)
    path = request(MIRROR, 8, builds, tmp_path)
    assert (path is not None, started) == (expected, [tmp_path] * expected)


@pytest.mark.parametrize(
    ("told", "machine", "expected"),
    [("", "", "for the next"), ("0", "true", f"as {SWITCH} says"), ("", "true", f"as {BUILD_MACHINE} says")],
)
def test_the_system_tells_what_holds(told: str, machine: str, expected: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in ((SWITCH, told), (BUILD_MACHINE, machine), (WIDE, "8")):
        monkeypatch.setenv(name, value)
    assert expected in system_text()


def test_what_is_requested_is_compiled_once(
    started: list[Path], builds: Builds, compiled: list[Features], tmp_path: Path
) -> None:
    kernels, others = tmp_path / "kernels", tmp_path / "others"
    path = request(MIRROR, 8, builds, kernels)
    other = request(dataclasses.replace(MIRROR, opacity=True), 8, builds, others)
    assert path is not None
    assert other is not None
    assert not is_done(path)
    assert serve(builds, kernels) == serve(builds, kernels) == 0
    assert compiled == [MIRROR]
    assert is_done(path)
    assert not is_done(other), "it belongs into another folder"
    assert started == [kernels, others]


def test_a_general_kernel_is_compiled_with_what_its_scenes_need(
    started: list[Path], builds: Builds, compiled: list[Features], tmp_path: Path
) -> None:
    kernel = general_features(DIFFUSE)[0]
    request(kernel, 8, builds, tmp_path)
    assert serve(builds, tmp_path) == 0
    assert compiled == [kernel]


def test_what_cannot_be_compiled_is_left_for_an_hour(
    started: list[Path], builds: Builds, compiled: list[Features], tmp_path: Path
) -> None:
    path = request(DIFFUSE, 8, builds, tmp_path)
    assert path is not None
    request(MIRROR, 8, builds, tmp_path)
    assert serve(builds, tmp_path) == 0
    assert compiled == [MIRROR]
    begun = path.with_suffix(BEGUN)
    assert begun.exists()
    assert request(DIFFUSE, 8, builds, tmp_path) is None
    assert len(started) == 2
    before = time.time() - RETRY_SECONDS - 1.0
    os.utime(begun, (before, before))
    assert request(DIFFUSE, 8, builds, tmp_path) == path
    assert len(started) == 3


def test_one_process_compiles_and_serves_what_comes_meanwhile(
    started: list[Path], builds: Builds, compiled: list[Features], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    second = dataclasses.replace(MIRROR, opacity=True)
    paths = []

    def compile_kernel(features: Features, *_: object) -> None:
        if features == MIRROR:
            paths.append(request(second, 8, builds, tmp_path))
            assert serve(builds, tmp_path) == 0, "another process ends at once"
            assert not compiled
        compiled.append(features)

    monkeypatch.setattr(later, "compile_kernel", compile_kernel)
    request(MIRROR, 8, builds, tmp_path)
    serve(builds, tmp_path)
    assert compiled == [MIRROR, second]
    assert len(started) == 1
    assert is_done(paths[0])


def test_damaged_and_old_requests_are_removed(
    started: list[Path], builds: Builds, compiled: list[Features], tmp_path: Path
) -> None:
    path = request(MIRROR, 8, builds, tmp_path)
    assert path is not None
    old = path.with_name(f"builds-old{REQUESTED}")
    old.write_text("[]")
    os.utime(old, (1.0, 1.0))
    path.write_text("{")
    serve(builds, tmp_path)
    assert compiled == []
    assert not path.exists()
    assert not old.exists()


def test_a_cache_that_cannot_be_written_to_is_left_alone(started: list[Path], builds: Builds, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    assert request(MIRROR, 8, builds, tmp_path / "file") is None
    assert started == []


def test_notes_of_a_render_that_ends_meanwhile_are_kept(builds: Builds) -> None:
    """Else the render after it would import Warp."""
    compiler, other = builds, Builds(builds.path, builds._warp, builds.warp_version)
    compiler.refresh()
    tables: dict[str, dict[str, Any]] = {"files": {}, "structs": {}, "modules": {}}
    other.note({**tables, "calls": {"scalar": {"value": 1}}})
    compiler.note({**tables, "calls": {"wide": {"value": 2}}})
    last = Builds(builds.path, builds._warp, builds.warp_version)
    last.refresh()
    assert last.notes["calls"] == {"scalar": {"value": 1}, "wide": {"value": 2}}


def processes(folder: Path) -> list[int]:
    """Return the compilers whose kernels go into a folder."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = path.read_bytes().split(b"\0")
        except OSError:
            continue
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
from wrt.compiling import general
from wrt.rendering import wide_kernel
from wrt.cli import main
general.general_features = lambda features: []  # they take longer to compile
wide_kernel.COMPILED_LOADING_SECONDS = wide_kernel.LOADING_SECONDS = 0.0
wide_kernel.COMPILING_SECONDS, wide_kernel.WORTH_SECONDS = 1e9, 0.0
sys.argv = ["wrt", "render", "cornell-box", "--size", "96x96", "--spp", "40", "-o", sys.argv[1], "--quiet"]
assert main() == 0
from wrt.backend import current_backend
builds = current_backend().builds
print(*(name for name in (builds._loaded if builds else ()) if ".wide" in name))
"""


@needs_lanes
@pytest.mark.slow
def test_the_second_render_from_the_shell_has_the_kernel(tmp_path: Path) -> None:
    """The compiler is killed once, which leaves nothing; the picture is the same, and the shell never waits."""
    variables = {key: value for key, value in os.environ.items() if key not in (WIDE, BUILD_MACHINE)}
    variables |= {SWITCH: "1", "PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(tmp_path / "cache")}
    variables.pop("WARP_CACHE_PATH", None)

    def render(name: str) -> list[str]:
        """Return the wide kernels that were loaded without Warp."""
        done = subprocess.run(
            [sys.executable, "-c", SHORT, name], env=variables, cwd=tmp_path, stdout=subprocess.PIPE, check=True
        )
        # The stream is read to its end: a compiler that held it open would keep the shell waiting.
        return done.stdout.decode().split()

    def bits(name: str) -> str:
        return hashlib.sha256((tmp_path / name).read_bytes()).hexdigest()

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
    assert len({bits(name) for name in ("first.npy", "again.npy", "third.npy", "last.npy")}) == 1
