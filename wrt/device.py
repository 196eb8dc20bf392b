"""Where kernels run: the one place on the host that knows CPU from CUDA."""

from __future__ import annotations

import math
import mmap
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_EXCEPTION, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt import cache_folders, kernel_cache
from wrt.errors import InputError, did_you_mean
from wrt.memory import forget_code, memory_left, trim
from wrt.values import integer

SLICES_PER_THREAD = 16
"""Slices of a CPU launch per thread: enough that an interrupt is soon seen, few enough that the 25 µs a launch costs
stay under 0.2 % of a 0.3 s pass."""

SMALLEST_SLICE = 1.0 / 16.0
"""Of the others: the last ones get smaller, so that all threads end together."""

FIRST_SLICE = 1.0 / 256.0
"""Size of the first slices, relative to the others: it is not known yet how long an index takes."""

SLICE_GROWTH = 8
"""Largest ratio of a slice's size to that of a slice that has ended."""

SLICE_SECONDS = 0.2
"""Longest time that a slice should take, estimated from earlier slices, since an interrupt waits for running slices.
Where indices get slower, a slice may take a few times as long."""

LARGE = 1 << 21
"""Bytes of a huge page, from which on an array has pages of its own."""

INTERRUPT_SECONDS = 0.1
"""An interrupt during a launch is seen after this at the latest."""


LOAD_SECONDS = 0.2
"""A module that took longer was compiled, which left behind 40 MB in the heap, and 27 MB of the compiler's own code."""

_LOADING: dict[str, threading.Lock] = {}
"""By the names of modules of kernels, what the one thread holds that loads it."""

os.register_at_fork(after_in_child=_LOADING.clear)  # a fork lacks the threads that hold these locks


STACK_BYTES = 8 << 20
"""The stack of a thread that runs kernels, whatever the shell's limit: a thousand paths take up to 2 MB of it."""


class _Threads:
    """Threads that wait for work, made where there first is some: a fork has none but the one that made it."""

    def __init__(self, count: int, name: str) -> None:
        self._count, self._name = count, name
        self._process = 0
        self._pool: ThreadPoolExecutor | None = None

    def submit(self, work: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Have one of them call `work`."""
        if self._pool is None or self._process != os.getpid():
            self._process, self._pool = os.getpid(), ThreadPoolExecutor(self._count, thread_name_prefix=self._name)
        given = threading.stack_size(STACK_BYTES)
        try:
            return self._pool.submit(work, *arguments)
        finally:
            threading.stack_size(given)


_COMPILER = _Threads(1, "wrt-compile")
"""The one thread of a process that compiles beside others. Warp writes its headers down once a thread, in a form quick
to read, which is nearly half of what compiling an ordinary render kernel takes."""

_LOADER = _Threads(1, "wrt-load")
"""The thread that compiles while the caller waits, so that the caller can be interrupted; native code cannot."""


def available_threads() -> int:
    """Return how many CPU cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


# Lines that Warp writes at every start and that no user can act on: that there is no GPU (the check
# for one says it when it matters), and that its next release will drop the oldest Python.
_HELD_BACK = (b"Could not find or load the NVIDIA CUDA driver", b"Support for Python")


def initialize_warp() -> None:
    """Start Warp quietly.

    Its native library writes straight to file descriptor 2. The lines of _HELD_BACK are left out;
    anything else it writes goes through.
    """
    import tempfile

    import warp as wp

    if is_lean():
        return  # there is no Warp to start
    wp.config.log_level = max(wp.config.log_level, wp.LOG_WARNING)
    _prepare_folders()
    sys.stderr.flush()
    kept = os.dup(2)
    try:
        with tempfile.TemporaryFile() as caught:
            os.dup2(caught.fileno(), 2)
            try:
                wp.init()
            finally:
                os.dup2(kept, 2)
            caught.seek(0)
            for line in caught:
                if not any(text in line for text in _HELD_BACK):
                    os.write(2, line)
    finally:
        os.close(kept)
    _forget_start()


@cache
def _forget_start() -> None:
    """Give back 90 MB of Warp's libraries, once: what runs when they are loaded lies all over them."""
    forget_code(*_libraries())


@cache
def _prepare_folders() -> None:
    """Choose the folder of compiled kernels, and remove leftovers of killed processes."""
    import warp as wp

    cache_folders.choose_warp_folder()
    version = wp.config.version
    kernels = Path(wp.config.kernel_cache_dir)
    kernels = kernels if kernels.name == version else kernels / version  # Warp adds the version when it starts
    notes = cache_folders.wrt_folder()
    cache_folders.remove_leftovers(kernels, notes, *notes.glob("headers-*"))


def is_lean() -> bool:
    """Return whether the module `warp` is the stand-in of `wrt/lean`."""
    return hasattr(sys.modules["warp"], "builds")


def _libraries() -> list[Path]:
    """Return Warp's libraries; none where `wrt/lean` stands in for it."""
    import warp as wp

    file = getattr(wp, "__file__", None)
    return [Path(file).parent / "bin" / name for name in ("warp.so", "warp-clang.so")] if file else []


def zeros(shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
    """Return a NumPy array of zeros, which if it is large takes memory only where somebody writes to it.

    NumPy's own does so only where the C library has no freed block for it, which it would clear.
    """
    size = math.prod(shape) * np.dtype(dtype).itemsize
    if size < LARGE or not hasattr(mmap, "MADV_HUGEPAGE"):
        return np.zeros(shape, dtype)
    return np.frombuffer(_pages(size), dtype).reshape(shape)


def _pages(size: int) -> mmap.mmap:
    """Return so many bytes of zeros in huge pages, which go back to the system as soon as nobody has them."""
    memory = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    memory.madvise(mmap.MADV_HUGEPAGE)
    return memory


class Device:
    """A device by name, with the way to launch a kernel over a range of work on it.

    Attributes:
        name: "cpu", or "cuda:N".
        threads: CPU threads that share a launch; 1 on CUDA.
        seconds_compile: time that callers have waited for kernels to be compiled or loaded.
    """

    def __init__(self, name: str = "cpu", *, threads: int | None = None) -> None:
        """Open a device.

        Args:
            name: "cpu", "cuda" (the first GPU) or "cuda:N".
            threads: CPU threads; by default every core this process may use.

        Raises:
            InputError: on an unknown device, a GPU that is not there, or a bad thread count.
        """
        if threads is not None:
            threads = integer(threads, "threads", minimum=1, maximum=1024)
        kind, colon, number = str(name).partition(":")
        if kind not in ("cpu", "cuda") or (kind == "cpu" and colon) or (colon and not number.isdecimal()):
            hint = did_you_mean(name, ("cpu", "cuda", "cuda:0"))
            raise InputError(f"unknown device {name!r}: use cpu, cuda or cuda:N{hint}")
        import warp as wp

        initialize_warp()
        if kind == "cuda":
            count = wp.get_cuda_device_count()
            if count == 0:
                raise InputError(f"device {name!r}: no CUDA GPU was found; use cpu")
            index = int(number or 0)
            if index >= count:
                raise InputError(f"device {name!r}: there are only {count} CUDA GPUs, numbered from 0")
            self.name = f"cuda:{index}"
            self.threads = 1
        else:
            self.name = "cpu"
            self.threads = threads or available_threads()
        self.seconds_compile = 0.0
        self._workers = _Threads(self.threads, "wrt")

    @property
    def is_cpu(self) -> bool:
        """Whether kernels run on the CPU."""
        return self.name == "cpu"

    def require_memory(self, size: int, what: str, *, copies: int = 0) -> None:
        """Raise InputError where `what` needs more bytes than can be had.

        On the CPU an allocation that large may well succeed, and the process be killed for using it.

        Args:
            size: bytes on the device.
            what: the thing that needs them, for the message.
            copies: additional bytes that are needed temporarily in host memory.
        """
        import warp as wp

        places = {"cpu": (size if self.is_cpu else 0) + copies}
        if not self.is_cpu:
            places[self.name] = size
        for name, needed in places.items():
            left = memory_left() if name == "cpu" else wp.get_device(name).total_memory
            if needed > left:
                raise InputError(
                    f"{what} needs {needed / 1e9:.1f} GB, more than the {left / 1e9:.1f} GB that {name} can give"
                )

    def empty_large(self, count: int, dtype: Any = float) -> Any:
        """Return an uninitialised array of numbers, or of vectors of them, for large data such as a ray tree.

        On the CPU it asks for huge pages: with small ones, most reads of a tree over millions of
        triangles also miss the cache of page addresses (the gain is noted in docs/performance.md).
        """
        import warp as wp

        if not self.is_cpu or count == 0 or not hasattr(mmap, "MADV_HUGEPAGE"):
            return wp.empty(count, dtype=dtype, device=self.name)
        number = {float: wp.float32, int: wp.int32}.get(dtype) or getattr(dtype, "_wp_scalar_type_", dtype)
        rows = np.frombuffer(_pages(count * wp.types.type_size_in_bytes(dtype)), wp.dtype_to_numpy(number))
        return wp.array(
            rows if len(rows) == count else rows.reshape(count, -1), dtype=dtype, device=self.name, copy=False
        )

    def compile(self, kernel: Any) -> float:
        """Load a kernel's module, compiling it if the cache has no intact build; return the seconds.

        If another thread is loading it already, wait for that thread. After KeyboardInterrupt, a compile that has begun
        continues in its own thread; a later call for the same kernel waits for it.

        Raises:
            OSError: where there is not enough disk space to compile it.
        """
        start = time.perf_counter()
        if is_lean() or kernel_cache.is_loaded(kernel.module, self.name):
            self._load(kernel)
        else:
            loading = _LOADER.submit(self._load, kernel)
            try:
                _finish({loading})
            finally:
                loading.cancel()
        seconds = time.perf_counter() - start
        self.seconds_compile += seconds
        return seconds

    def _load(self, kernel: Any) -> float:
        """Load a kernel's module in this thread; see `compile`."""
        import warp as wp

        start = time.perf_counter()
        with _LOADING.setdefault(kernel.module.name, threading.Lock()):
            kernel_cache.provide(kernel.module, self.name)
            wp.load_module(kernel.module, device=self.name)
        seconds = time.perf_counter() - start
        if seconds > LOAD_SECONDS:
            trim()
            forget_code(*_libraries())
        return seconds

    @contextmanager
    def compiling(self) -> Iterator[Callable[[Any], None]]:
        """Within the context, compile the kernels that the function it gives is called with; at its end all are.

        On the CPU another thread does so beside what else goes on, if there is to be more than one: Warp lets one
        thread at a time write code for its compiler, which then takes most of the time and no interpreter lock.
        After an exception no further compile begins, and one that has begun is not waited for.
        """
        if not self.is_cpu or self.threads == 1:
            kernels: list[Any] = []
            yield kernels.append
            for kernel in kernels:
                self.compile(kernel)
            return
        workers: set[Future[float]] = set()
        try:
            yield lambda kernel: workers.add(_COMPILER.submit(self._load, kernel))
            start = time.perf_counter()
            _finish(workers)
            self.seconds_compile += time.perf_counter() - start
        finally:
            for worker in workers:
                worker.cancel()

    def launch(self, kernel: Any, count: int, inputs: list[Any], *, spared: int = 0, least: int = 1) -> None:
        """Run `kernel` over indices 0 to count − 1 and wait for it, on all threads but those to be spared.

        The kernel's first argument is the index of its thread 0. On the CPU, where Warp runs one
        launch on one core, slices of the range run side by side. After KeyboardInterrupt the
        running slices end, no other starts, and the interrupt goes on to the caller. Where indices
        take so little that starting their slices would take longer, `least` tells of how many a slice must be.
        """
        import warp as wp

        # Before the threads start: otherwise each would compile the kernel, and read the headers for it.
        self.compile(kernel)
        if not self.is_cpu:
            wp.launch(kernel, dim=count, inputs=[0, *inputs], device=self.name)
            wp.synchronize_device(self.name)
            return
        slices = Slices(count, self.threads, least)
        stop = threading.Event()

        def work() -> None:
            while not stop.is_set() and (taken := slices.take()) is not None:
                start, size = taken
                began = time.perf_counter()
                wp.launch(kernel, dim=size, inputs=[start, *inputs], device="cpu")
                slices.ended(size, time.perf_counter() - began)

        workers: set[Future[None]] = set()
        try:
            for _ in range(max(1, self.threads - spared)):
                workers.add(self._workers.submit(work))
            _finish(set(workers))
        finally:
            stop.set()
            wait(workers)


class Slices:
    """The slices that a launch is cut into, which threads take one after the other.

    All have the same size, except that none exceeds one thread's share of the remaining indices (Polychronopoulos and
    Kuck 1987), or what should take SLICE_SECONDS, estimated from earlier slices.
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
            left = self._count - self._start
            size = min(self._most, self._limit, max(self._smallest, left // self._threads), left)
            start, self._start = self._start, self._start + size
            return (start, size) if size else None

    def ended(self, size: int, seconds: float) -> None:
        """Record how long a slice took."""
        with self._lock:
            # Adapt to slower slices at once and to faster ones gradually, since neighbours are often as slow.
            self._seconds_each = max(seconds / size, 0.5 * self._seconds_each)
            in_time = int(SLICE_SECONDS / max(self._seconds_each, 1e-12))
            self._limit = max(self._least, min(in_time, SLICE_GROWTH * max(size, self._limit)))


def _finish(workers: set[Future[Any]]) -> None:
    """Wait until all have ended or one has failed, whose exception is raised."""
    # Not without a timeout: such a wait cannot be interrupted on every system.
    while workers:
        ended, workers = wait(workers, timeout=INTERRUPT_SECONDS, return_when=FIRST_EXCEPTION)
        for worker in ended:
            worker.result()
