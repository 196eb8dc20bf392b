"""Launches: each index once, whatever the slices; and what cannot be launched on is refused."""

import heapq
import signal
import threading
import time
from collections.abc import Callable

import numpy as np
import pytest
import warp as wp

import wrt
from wrt.backend.backend import Backend
from wrt.backend.device import Device
from wrt.cli import main
from wrt.slices import FIRST_SLICE, SLICE_SECONDS, SLICES_PER_THREAD, Slices


@wp.kernel(enable_backward=False)
def count(first: int, counts: wp.array(dtype=int)):
    i = first + wp.tid()
    wp.atomic_add(counts, i + 8, 1)


def assert_each_once(device: Device, n: int, **options: int) -> None:
    """Launch n indices, and look at eight more on both sides."""
    counts = wp.zeros(n + 16, dtype=int, device=device.name)
    device.launch(count, n, [counts], **options)
    np.testing.assert_array_equal(counts.numpy(), [0] * 8 + [1] * n + [0] * 8)


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_each_index_runs_once(threads, device):
    for n in (0, 1, 2, 15, 16, 17, 33, 1000, 100_003):
        assert_each_once(Device(device, threads=threads), n)
    assert_each_once(Device(device, threads=threads), 1000, spared=3)  # one thread always works


def simulated(n: int, threads: int, seconds: Callable[[int], float]) -> list[tuple[int, int, float]]:
    """Return starts, sizes and seconds of slices of n indices; a thread takes one as soon as its previous has ended."""
    slices, found = Slices(n, threads, 1), []
    running: list[tuple[float, int, int, float]] = []  # end, start, size, seconds
    free = [0.0] * threads
    while True:
        while free and (piece := slices.take()) is not None:
            start, size = piece
            took = sum(seconds(i) for i in range(start, start + size))
            found.append((start, size, took))
            heapq.heappush(running, (free.pop() + took, start, size, took))
        if not running:
            return found
        end, _, size, took = heapq.heappop(running)
        slices.ended(size, took)
        free.append(end)


@pytest.mark.parametrize(("threads", "total"), [(1, 1.0), (16, 60.0), (2, 1000.0)])
def test_no_slice_of_a_long_launch_takes_long(threads, total):
    """For indices that take the same time, and for a second half that takes ten times as long."""
    n = 1 << 15
    for slow in (1.0, 10.0):
        each = total * threads / n

        def seconds(i, each=each, slow=slow):
            return each * (slow if i > n // 2 else 1.0)

        slices = simulated(n, threads, seconds)
        longest = sorted((took for _, _, took in slices), reverse=True)
        first = max(total * FIRST_SLICE / SLICES_PER_THREAD, slow * each)  # at least one index
        assert longest[0] <= max(SLICE_SECONDS * slow, first) * 1.01
        # Only slices that run when the time changes, and the next ones, sized by the mean of both, take longer.
        assert longest[2 * threads :][0] <= max(SLICE_SECONDS, first) * 1.01
        # At most one launch, which costs 25 us, for every 0.05 s.
        assert len(slices) <= threads * (SLICES_PER_THREAD + 20) + sum(longest) / 0.05


def test_an_error_in_a_slice_reaches_the_caller(monkeypatch):
    def fail(*_, **__):
        raise RuntimeError("broken kernel")

    device = Device("cpu", threads=2)
    monkeypatch.setattr(Backend, "launch", fail)
    with pytest.raises(RuntimeError, match="broken kernel"):
        device.launch(count, 100, [])
    monkeypatch.undo()
    assert_each_once(device, 1000)  # the pool is still of use


def test_an_interrupt_leaves_no_worker_running(monkeypatch):
    """Slices that run end, no other starts, and none runs once the interrupt is with the caller."""
    device = Device("cpu", threads=2)
    started, ended = [], []
    # A shell that started this in the background had it ignore interrupts.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)

    def slow(backend, kernel, first, *_):
        started.append(first)
        if len(started) == 3:
            # A true signal: it wakes the main thread where it waits for its workers.
            signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)
        time.sleep(0.5)
        ended.append(first)

    monkeypatch.setattr(Backend, "launch", slow)
    try:
        with pytest.raises(KeyboardInterrupt):
            device.launch(count, 10_000, [])
    finally:
        signal.signal(signal.SIGINT, before)
    slices = len(started)
    assert sorted(ended) == sorted(started)
    # Some more may start before the main thread has its turn, on a busy machine.
    assert 2 <= slices < 2 * SLICES_PER_THREAD
    time.sleep(0.3)
    assert len(started) == slices
    monkeypatch.undo()
    assert_each_once(device, 1000)


@pytest.mark.parametrize("name", ["", "gpu", "cpu:0", "cuda:-1", None])
def test_unknown_devices_and_bad_numbers_of_threads_are_refused(name):
    with pytest.raises(wrt.InputError, match=f"^unknown device {name!r}.*use cpu, cuda or cuda:N[^\n]*$"):
        Device(name)
    for threads in (0, 1025, 2.0, True):
        with pytest.raises(wrt.InputError, match="threads"):
            Device("cpu", threads=threads)


def test_one_line_says_that_the_system_allows_no_more_threads(monkeypatch, capsys):
    def fail(_):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", fail)
    limits = "(ulimit -u, or the pids.max of a control group)"
    for command in ["render", "cornell-box", "--size", "8x8"], ["view", "cornell-box", "--no-browser"]:
        assert main(command) == 1
        assert capsys.readouterr().err.endswith(f"the system allows no more threads or processes {limits}\n")


def test_gpus_are_named(monkeypatch):
    Device("cpu")
    monkeypatch.setattr(wp, "get_cuda_device_count", lambda: 2)
    assert Device("cuda").name == "cuda:0"
    device = Device("cuda:1", threads=4)
    assert (device.name, device.threads, device.is_cpu) == ("cuda:1", 1, False)
    with pytest.raises(wrt.InputError, match="only cuda:0 to cuda:1"):
        Device("cuda:2")
