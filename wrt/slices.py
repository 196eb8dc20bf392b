"""Divide a launch into slices for the threads of a CPU."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from concurrent.futures import FIRST_EXCEPTION, Future, ThreadPoolExecutor, wait
from contextvars import copy_context
from typing import Any

SLICES_PER_THREAD = 16
"""Slices of a CPU launch per thread: enough to respond to an interrupt, few enough that the 25 µs of each launch stay
under 0.2 % of a 0.3 s pass."""

SMALLEST_SLICE = 1.0 / 16.0
"""Smallest size relative to the others: the last slices shrink, so that all threads end together."""

FIRST_SLICE = 1.0 / 256.0
"""Size of the first slices relative to the others, while the time of an index is still unknown."""

SLICE_GROWTH = 8
"""Largest growth of slices from one that has ended to a new one."""

SLICE_SECONDS = 0.2
"""Longest time that a slice should take, estimated from earlier slices, because an interrupt waits for running slices.
If indices get slower, a slice may take a few times as long."""

INTERRUPT_SECONDS = 0.1
"""Longest delay until an interrupt during a launch is noticed."""

STACK_BYTES = 8 << 20
"""Stack of a thread that runs kernels, independent of the shell's limit: a thousand paths take up to 2 MB of it."""


class Slices:
    """The slices of a launch, which threads take one after the other.

    All have the same size, limited to one thread's share of the remaining indices (Polychronopoulos and Kuck 1987), and
    to the size that should take SLICE_SECONDS, estimated from earlier slices.
    """

    def __init__(self, count: int, threads: int, least: int = 1) -> None:
        """Prepare slices of `count` indices for some threads, each of at least `least` indices."""
        self._count, self._threads, self._start = count, threads, 0
        self._most = max(least, -(-count // (threads * SLICES_PER_THREAD)))
        self._least, self._smallest = least, max(least, int(self._most * SMALLEST_SLICE))
        self._limit = max(least, int(self._most * FIRST_SLICE))
        self._seconds_each = 0.0
        self._lock = threading.Lock()

    def take(self) -> tuple[int, int] | None:
        """Return the start and size of the next slice; None after the last."""
        with self._lock:
            remaining = self._count - self._start
            size = min(self._most, self._limit, max(self._smallest, remaining // self._threads), remaining)
            start, self._start = self._start, self._start + size
            return (start, size) if size else None

    def ended(self, size: int, seconds: float) -> None:
        """Record how long a slice took."""
        with self._lock:
            # Adapt to slower slices at once and to faster ones gradually: a slow slice often has slow neighbours.
            self._seconds_each = max(seconds / size, 0.5 * self._seconds_each)
            in_time = int(SLICE_SECONDS / max(self._seconds_each, 1e-12))
            self._limit = max(self._least, min(in_time, SLICE_GROWTH * max(size, self._limit)))


class Threads:
    """A thread pool that starts with the first work, and again in a fork, which inherits no threads."""

    def __init__(self, count: int, name: str) -> None:
        self._count, self._name = count, name
        self._process = 0
        self._pool: ThreadPoolExecutor | None = None

    def submit(self, work: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Call `work` in one of the threads, in the context of the caller."""
        if self._pool is None or self._process != os.getpid():
            self._process, self._pool = os.getpid(), ThreadPoolExecutor(self._count, thread_name_prefix=self._name)
        usual = threading.stack_size(STACK_BYTES)
        try:
            return self._pool.submit(copy_context().run, work, *arguments)
        finally:
            threading.stack_size(usual)

    def end(self) -> None:
        """Wait for the work that has begun; no other begins."""
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
            self._pool = None


def finish(workers: set[Future[Any]]) -> None:
    """Wait until all have ended, or raise the exception of the first that fails."""
    # The timeout is needed because an unlimited wait cannot be interrupted on every system.
    while workers:
        ended, workers = wait(workers, timeout=INTERRUPT_SECONDS, return_when=FIRST_EXCEPTION)
        for worker in ended:
            worker.result()


def available_threads() -> int:
    """Return how many CPU cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def run_slices(
    run: Callable[[int, int], None],
    count: int,
    pool: Threads,
    threads: int,
    *,
    spared: int = 0,
    least: int = 1,
    cancelled: threading.Event | None = None,
) -> None:
    """Call `run` with the starts and sizes of slices that cover `count` indices, on all threads but `spared`.

    After KeyboardInterrupt the running slices end, no other starts, and the interrupt is raised to the caller.

    Args:
        run: runs a slice.
        count: number of indices.
        pool: a pool of `threads` threads.
        threads: number of threads.
        spared: threads left idle; one always works.
        least: indices that a slice must have at least, so that its work outweighs its launch.
        cancelled: while it is set no slice starts; the rest of the launch is then left out.
    """
    slices = Slices(count, threads, least)
    stop = threading.Event()

    def work() -> None:
        while not stop.is_set() and (piece := slices.take()) is not None:
            if cancelled is not None and cancelled.is_set():
                return
            began = time.perf_counter()
            run(*piece)
            slices.ended(piece[1], time.perf_counter() - began)

    workers: set[Future[None]] = set()
    try:
        for _ in range(max(1, threads - spared)):
            workers.add(pool.submit(work))
        finish(set(workers))
    finally:
        stop.set()
        wait(workers)
