"""Kernels are compiled beside other work: each once, whoever asks; after an error or an interrupt nothing goes on."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest
import warp as wp
from conftest import ROOT

from wrt.backend.device import Device

PROGRAM = """
import sys
import numpy as np
import warp as wp
from wrt.backend.device import Device

def kernel_of(name, factor):
    @wp.kernel(module=wp.get_module(name), enable_backward=False)
    def scale(first: int, x: wp.array(dtype=float)):
        x[first + wp.tid()] *= wp.static(factor)
    return scale

import warp._src.build as build
compiled, build_cpu = [], build.build_cpu
build.build_cpu = lambda path, *rest, **options: (compiled.append(path), build_cpu(path, *rest, **options))
device = Device("cpu", threads=2)
one, other = kernel_of("one", 2.0), kernel_of("other", 3.0)
x = wp.ones(100, dtype=float, device="cpu")
with device.compiling() as compile:
    compile(other)
    device.launch(one, 100, [x])
device.launch(other, 100, [x])
assert (x.numpy() == 6.0).all()
assert len(compiled) == 2, compiled
"""


FORKED = """
import os
import signal
import time
from types import SimpleNamespace
import warp as wp
from wrt.backend.device import Device

device = Device("cpu", threads=2)
kernel = SimpleNamespace(module=SimpleNamespace(name="a"))

def work():
    with device.compiling() as compile:
        compile(kernel)
    device.launch(kernel, 100, [])

wp.load_module = wp.launch = lambda *_, **__: time.sleep(0.01)  # so that all threads have something to do
work()
child = os.fork()
if not child:
    signal.alarm(20)
    work()
    os._exit(0)
assert os.waitpid(child, 0)[1] == 0
"""


class Loads:
    """What is asked of Warp: each module takes a while the first time."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Take the place of Warp."""
        self.begun: list[tuple[str, str]] = []
        self.ended: list[str] = []
        monkeypatch.setattr(wp, "load_module", self)
        monkeypatch.setattr(wp, "launch", lambda *_, **__: None)

    def __call__(self, module: SimpleNamespace, device: str) -> None:
        """Load a module."""
        if module.name in self.ended:
            return
        self.begun.append((module.name, threading.current_thread().name))
        if module.name == "broken":
            raise RuntimeError("it does not compile")
        time.sleep(0.2)
        self.ended.append(module.name)


@pytest.fixture
def loads(monkeypatch: pytest.MonkeyPatch) -> Loads:
    return Loads(monkeypatch)


def kernel(name: str) -> SimpleNamespace:
    return SimpleNamespace(module=SimpleNamespace(name=name))


def test_a_launch_compiles_once_for_all_its_threads(loads: Loads) -> None:
    Device("cpu", threads=4).launch(kernel("a"), 1000, [])
    assert [name for name, _ in loads.begun] == ["a"]


def test_two_threads_compile_from_both_ends_each_kernel_once(loads: Loads) -> None:
    device = Device("cpu", threads=2)
    with device.compiling() as compile:
        for name in "abcd":
            compile(kernel(name))
        for name in "dcb":
            device.launch(kernel(name), 10, [])
    assert sorted(name for name, _ in loads.begun) == ["a", "b", "c", "d"]
    assert sorted(loads.ended) == ["a", "b", "c", "d"]
    assert len({thread for _, thread in loads.begun}) == 2
    assert next(name for name, thread in loads.begun if thread.startswith("wrt-compile")) == "a"


def test_one_thread_alone_does_all_there_is_when_it_comes_to_it(loads: Loads) -> None:
    device = Device("cpu", threads=1)
    with device.compiling() as compile:
        compile(kernel("a"))
        compile(kernel("b"))
        device.compile(kernel("b"))
    assert [name for name, _ in loads.begun] == ["b", "a"]
    assert len({thread for _, thread in loads.begun}) == 1


@pytest.mark.parametrize("threads", [1, 2])
def test_what_does_not_compile_is_told(threads: int, loads: Loads) -> None:
    with pytest.raises(RuntimeError, match="does not compile"), Device("cpu", threads=threads).compiling() as compile:
        compile(kernel("broken"))


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_after_an_error_nobody_waits_for_what_was_begun_and_nothing_else_begins(
    error: type[BaseException], loads: Loads
) -> None:
    def fail(compile: Callable[[object], None]) -> None:
        for name in "abc":
            compile(kernel(name))
        while not loads.begun:
            time.sleep(0.01)
        raise error

    with pytest.raises(error), Device("cpu", threads=2).compiling() as compile:
        fail(compile)
    assert loads.ended == []
    Device("cpu", threads=2).compile(kernel("a"))  # waits for the compile that continues
    assert [name for name, _ in loads.begun] == loads.ended == ["a"]


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("way", ["compile", "launch", "compiling"])
def test_an_interrupt_does_not_wait_for_the_compiler(
    way: str, threads: int, loads: Loads, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("wrt.backend.slices.INTERRUPT_SECONDS", 0.05)
    release = threading.Event()
    load = loads.__call__

    def slow(module: SimpleNamespace, device: str) -> None:
        if not release.is_set():
            signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)
        assert release.wait(timeout=60.0)
        load(module, device)

    monkeypatch.setattr(wp, "load_module", slow)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    device = Device("cpu", threads=threads)

    def begin() -> None:
        if way == "compiling":
            with device.compiling() as compile:
                compile(kernel("a"))
        elif way == "compile":
            device.compile(kernel("a"))
        else:
            device.launch(kernel("a"), 10, [])

    try:
        with pytest.raises(KeyboardInterrupt):  # fails after a minute if anything waits
            begin()
    finally:
        signal.signal(signal.SIGINT, before)
        release.set()
    device.compile(kernel("a"))
    assert loads.ended == ["a"]


def test_the_thread_that_compiles_is_always_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    # Warp writes its headers down, in a form quick to read, for each thread anew.
    threads: list[threading.Thread] = []  # themselves, not their numbers, which others get after them
    monkeypatch.setattr(wp, "load_module", lambda *_, **__: threads.append(threading.current_thread()))
    for _ in range(3):
        with Device("cpu", threads=2).compiling() as compile:
            compile(kernel("a"))
    assert len(threads) == 3
    assert len(set(threads)) == 1
    assert threads[0] is not threading.current_thread()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no system that forks")
def test_a_fork_works_by_threads_of_its_own() -> None:
    subprocess.run([sys.executable, "-c", FORKED], env={**os.environ, "PYTHONPATH": str(ROOT)}, check=True)


def test_what_compiling_leaves_behind_is_given_back(loads: Loads, monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[str] = []
    monkeypatch.setattr("wrt.backend.warp_backend.trim", lambda: given.append("heap"))
    monkeypatch.setattr(
        "wrt.backend.warp_backend.forget_code", lambda *libraries: given.extend(each.name for each in libraries)
    )
    monkeypatch.setattr("wrt.backend.warp_backend.LOAD_SECONDS", 0.1)
    device = Device("cpu")
    given.clear()
    device.compile(kernel("a"))
    assert given == ["heap", "warp.so", "warp-clang.so"]
    device.compile(kernel("a"))  # only loaded
    assert len(given) == 3


@pytest.mark.slow
def test_warp_compiles_in_two_threads_and_leaves_whole_files_alone(tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(PROGRAM)
    variables = {**os.environ, "PYTHONPATH": str(ROOT), "WARP_CACHE_PATH": str(tmp_path / "cache")}
    subprocess.run([sys.executable, str(tmp_path / "program.py")], env=variables, check=True)
    folders = list(next((tmp_path / "cache").iterdir()).iterdir())
    assert sorted(folder.name.rpartition("_")[0] for folder in folders) == ["wp_one", "wp_other"]
    assert all({path.suffix for path in folder.iterdir()} >= {".o", ".meta"} for folder in folders)


def test_files_that_are_of_use_to_one_process_go_with_it(tmp_path: Path) -> None:
    # Warp's headers, read and written down for the modules that follow, are 5 MB a thread.
    program = "import tempfile; from wrt.cli.process import end; t = tempfile.TemporaryDirectory(dir='.'); end(3)"
    variables = {**os.environ, "PYTHONPATH": str(ROOT)}
    assert subprocess.run([sys.executable, "-c", program], cwd=tmp_path, env=variables).returncode == 3
    assert not list(tmp_path.iterdir())


def test_nobody_complains_after_the_last_message() -> None:
    # The compiler would, about a folder that has been removed: as a signal ends a process, it may still run.
    program = """import atexit, os, sys
from wrt.cli.process import end
atexit.register(os.write, 2, b"error: cannot open file")
print("Stopped.", file=sys.stderr)
end(143)"""
    variables = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", program], env=variables, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (143, "Stopped.\n")


def test_seconds_are_those_that_somebody_waited(monkeypatch: pytest.MonkeyPatch) -> None:
    # By a clock of its own, a load takes a second. It ends only after somebody has looked at the clock and waits.
    now, ended, loaded = 0.0, threading.Event(), set[str]()
    waits = threading.Event()

    def clock() -> float:
        waits.set()
        return now

    def load(module: SimpleNamespace, device: str) -> None:
        nonlocal now
        if module.name not in loaded:
            assert waits.wait(60.0)
            loaded.add(module.name)
            now += 1.0
        ended.set()

    monkeypatch.setattr(wp, "load_module", load)
    monkeypatch.setattr(wp, "launch", lambda *_, **__: None)
    monkeypatch.setattr("wrt.backend.device.time", SimpleNamespace(perf_counter=clock))
    device = Device("cpu", threads=2)
    with device.compiling() as compile:
        waits.set()
        compile(kernel("beside"))
        assert ended.wait(60.0), "other work takes longer"
    assert device.seconds_compile == 0.0
    waits.clear()
    with device.compiling() as compile:
        compile(kernel("waited for"))
    assert device.seconds_compile == 1.0
    device.launch(kernel("needed at once"), 1, [])
    assert device.seconds_compile == 2.0
    device.launch(kernel("needed at once"), 1, [])
    assert device.seconds_compile == 2.0, "it was loaded already"


def test_seconds_of_another_process_are_counted_until_it_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    from wrt.kernels.features import Features
    from wrt.rendering.wide_kernel import WideKernel

    class Compiler:
        ended: int | None = None

        def poll(self) -> int | None:
            return self.ended

        def wait(self) -> int:
            return 0

        kill = wait

    compiler = Compiler()
    monkeypatch.setattr("wrt.rendering.wide_kernel.subprocess.Popen", lambda *_, **__: compiler)
    monkeypatch.setattr(WideKernel, "_is_usable", lambda _: True)
    wide = WideKernel(Device("cpu"), Features(models=(), textured=False, environment="none"), ())
    assert wide.seconds == 0.0
    wide.prepare(1e9)
    time.sleep(0.2)
    assert wide.seconds > 0.15
    compiler.ended = 0
    wide.prepare(0.0)
    assert not wide.is_being_compiled
    seconds = wide.seconds
    time.sleep(0.1)
    assert wide.seconds == seconds > 0.15


def test_one_thread_loads_a_wide_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    """The others go on without: Warp generates the code of a kernel in one thread at a time."""
    from wrt.rendering import wide_kernel

    prepared: list[float] = []
    monkeypatch.setattr(wide_kernel.WideKernel, "_prepare", lambda _, seconds, speedup: prepared.append(seconds))
    wide = wide_kernel.WideKernel(Device("cpu"), None, ())
    with wide_kernel._LOADING:
        wide.prepare(1e9)
    assert not prepared
    wide.prepare(1e9)
    assert prepared == [1e9]
