"""Kernels are compiled beside other work: each once; after an error or an interrupt nothing goes on.

Headers that Warp precompiles for the CPU are made once a machine, and shared by all threads that compile.
"""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable

import pytest
from conftest import ROOT
from support.caches import python

from wrt.backend import headers
from wrt.backend.backend import Backend, Kernel
from wrt.backend.device import Device

VARIABLES = {**os.environ, "PYTHONPATH": str(ROOT)}


class Loads:
    """What is asked of the backend: each module takes a while the first time."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.begun: list[tuple[str, str]] = []
        self.ended: list[str] = []
        monkeypatch.setattr(Backend, "is_loaded", lambda _, kernel, device: kernel.module in self.ended)
        monkeypatch.setattr(Backend, "load", lambda _, kernel, device: self(kernel))
        monkeypatch.setattr(Backend, "launch", lambda *_: None)

    def __call__(self, kernel: Kernel) -> None:
        if kernel.module in self.ended:
            return
        self.begun.append((kernel.module, threading.current_thread().name))
        if kernel.module == "broken":
            raise RuntimeError("it does not compile")
        time.sleep(0.2)
        self.ended.append(kernel.module)


@pytest.fixture
def loads(monkeypatch):
    return Loads(monkeypatch)


def kernel(name: str) -> Kernel:
    return Kernel(name, "", lambda: None)


def test_two_threads_compile_from_both_ends_each_kernel_once(loads):
    device = Device("cpu", threads=2)
    with device.compiling(map(kernel, "abcd")):
        for name in "dcb":
            device.launch(kernel(name), 10, [])
    assert sorted(name for name, _ in loads.begun) == sorted(loads.ended) == ["a", "b", "c", "d"]
    assert len({thread for _, thread in loads.begun}) == 2
    assert next(name for name, thread in loads.begun if thread.startswith("wrt-compile")) == "a"


@pytest.mark.parametrize("threads", [1, 2])
def test_what_does_not_compile_is_told(threads, loads):
    with (
        pytest.raises(RuntimeError, match="does not compile"),
        Device("cpu", threads=threads).compiling([kernel("broken")]),
    ):
        pass


def test_after_an_error_nobody_waits_for_what_was_begun_and_nothing_else_begins(loads):
    def fail():
        while not loads.begun:
            time.sleep(0.01)
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError), Device("cpu", threads=2).compiling(map(kernel, "abc")):
        fail()
    assert loads.ended == []
    Device("cpu", threads=2).compile(kernel("a"))  # waits for the compile that continues
    assert [name for name, _ in loads.begun] == loads.ended == ["a"]


def compile_beside(device: Device) -> None:
    with device.compiling([kernel("a")]):
        pass


@pytest.mark.parametrize("begin", [lambda device: device.launch(kernel("a"), 10, []), compile_beside])
@pytest.mark.parametrize("threads", [1, 2])
def test_an_interrupt_does_not_wait_for_the_compiler(
    threads: int, begin: Callable[[Device], None], loads: Loads, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("wrt.slices.INTERRUPT_SECONDS", 0.05)
    release = threading.Event()
    load = loads.__call__

    def slow(_, kernel, device):
        if not release.is_set():
            signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)
        assert release.wait(timeout=60.0)
        load(kernel)

    monkeypatch.setattr(Backend, "load", slow)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    device = Device("cpu", threads=threads)
    try:
        with pytest.raises(KeyboardInterrupt):  # fails after a minute if anything waits
            begin(device)
    finally:
        signal.signal(signal.SIGINT, before)
        release.set()
    device.compile(kernel("a"))
    assert loads.ended == ["a"]


FORKED = """
import os
import signal
import time
from wrt.backend.backend import Backend, Kernel
from wrt.backend.device import Device

device = Device("cpu", threads=2)
kernel = Kernel("a", "", None)

def work():
    with device.compiling([kernel]):
        pass
    device.launch(kernel, 100, [])

Backend.load = Backend.launch = lambda *_: time.sleep(0.01)  # so that all threads have something to do
work()
child = os.fork()
if not child:
    signal.alarm(20)
    work()
    os._exit(0)
assert os.waitpid(child, 0)[1] == 0
"""


def test_a_fork_works_by_threads_of_its_own():
    python(ROOT, VARIABLES, "-c", FORKED)


def test_a_process_ends_with_its_last_message_and_its_folders(tmp_path):
    # A signal may end a process whose compiler still runs: that would complain of the folder that has been removed.
    program = """import atexit, os, sys, tempfile
from wrt.cli.process import end
folder = tempfile.TemporaryDirectory(dir=".")
atexit.register(os.write, 2, b"error: cannot open file")
print("Stopped.", file=sys.stderr)
end(143)"""
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, env=VARIABLES, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (143, "Stopped.\n")
    assert not list(tmp_path.iterdir())


def test_headers_are_kept_apart_where_one_of_them_has_changed(tmp_path, monkeypatch):
    for name in ("__init__.py", "config.py", "bin/warp.so", "bin/warp-clang.so", "native/vec.h"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    monkeypatch.setattr(headers, "folder_of", lambda _: tmp_path)
    before = headers.cached_folder()
    assert headers.cached_folder() == before
    os.utime(tmp_path / "native/vec.h", (1, 1))
    assert headers.cached_folder() != before
