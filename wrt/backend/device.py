"""Devices: the only place on the host that distinguishes CPU and CUDA."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from wrt.backend import current_backend
from wrt.backend.cuda.gpus import require_gpus
from wrt.backend.memory import memory_left
from wrt.errors import InputError, NotEnoughMemory, did_you_mean
from wrt.slices import Threads, available_threads, finish, run_slices
from wrt.values import integer

_LOADING: dict[str, threading.Lock] = {}
"""Locks by kernel module, each held by the thread that loads the module."""

os.register_at_fork(after_in_child=_LOADING.clear)  # a fork lacks the threads that hold these locks

_COMPILER = Threads(1, "wrt-compile")
"""The thread that compiles for the CPU in the background."""

_GPU_COMPILERS = Threads(min(available_threads(), 8), "wrt-nvrtc")
"""The threads that compile for GPUs in the background."""

_LOADER = Threads(1, "wrt-load")
"""The thread that compiles while the caller waits, so that the caller can be interrupted; native code cannot."""


class Device:
    """A device, which compiles and launches kernels.

    Attributes:
        name: "cpu", or "cuda:N".
        threads: CPU threads that share a launch; 1 on CUDA.
        backend: the backend that runs the kernels.
        seconds_compile: time that callers have waited for kernels to be compiled or loaded.
        cancelled: set by another thread to leave out the rest of a cancellable launch.
    """

    def __init__(self, name: str = "cpu", *, threads: int | None = None) -> None:
        """Open a device.

        Args:
            name: "cpu", "cuda" (the first GPU) or "cuda:N".
            threads: CPU threads; by default every core this process may use.

        Raises:
            InputError: on an unknown device, a missing GPU, or a bad thread count.
        """
        if threads is not None:
            threads = integer(threads, "threads", minimum=1, maximum=1024)
        kind, colon, number = str(name).partition(":")
        if kind not in ("cpu", "cuda") or (kind == "cpu" and colon) or (colon and not number.isdecimal()):
            hint = did_you_mean("cuda" if name == "gpu" else name, ("cpu", "cuda", "cuda:0"))
            raise InputError(f"unknown device {name!r}: use cpu, cuda or cuda:N{hint}")
        self.backend = current_backend()
        if kind == "cuda":
            index = int(number or 0)
            require_gpus(self.backend, name, [index])
            self.name = f"cuda:{index}"
            self.threads = 1
        else:
            self.name = "cpu"
            self.threads = threads or available_threads()
        self.seconds_compile = 0.0
        self.cancelled = threading.Event()
        self._workers = Threads(self.threads, "wrt")

    @property
    def is_cpu(self) -> bool:
        """True if kernels run on the CPU."""
        return self.name == "cpu"

    def require_memory(self, size: int, what: str, *, copies: int = 0, advice: str = "") -> None:
        """Raise NotEnoughMemory when `what` needs more memory than is available.

        On the CPU such an allocation may succeed, but using it can get the process killed.

        Args:
            size: bytes on the device.
            what: the object that needs them, for the message.
            copies: additional bytes for temporary copies in host memory.
            advice: what to do about it, for the message.
        """
        places = {"cpu": (size if self.is_cpu else 0) + copies}
        if not self.is_cpu:
            places[self.name] = size
        for name, required in places.items():
            available = memory_left() if name == "cpu" else self.backend.memory_of(name)
            if required > available:
                need, room = required / 1e9, available / 1e9
                text = f"{what} needs {need:.1f} GB, more than the {room:.1f} GB that {name} has left"
                raise NotEnoughMemory(f"{text}; {advice}" if advice else text)

    def empty_large(self, count: int, dtype: Any = float) -> Any:
        """Return an uninitialised array for large data such as a ray tree.

        On the CPU it asks for huge pages: with small ones, most reads of a tree over millions of triangles also miss
        the TLB (docs/performance.md has the gain).
        """
        return self.backend.empty(count, dtype, self.name)

    def compile(self, kernel: Any) -> float:
        """Load a kernel's module, compiling it if the cache has no intact build; return the seconds.

        If another thread is loading it already, wait for that thread. After KeyboardInterrupt, a compile that has begun
        continues in its own thread; a later call for the same kernel waits for it.

        Raises:
            OSError: when there is not enough disk space to compile it.
        """
        start = time.perf_counter()
        if not self.backend.is_loaded(kernel, self.name):
            loading = _LOADER.submit(self._load, kernel)
            try:
                finish({loading})
            finally:
                loading.cancel()
        seconds = time.perf_counter() - start
        self.seconds_compile += seconds
        return seconds

    def _load(self, kernel: Any) -> None:
        """Load a kernel's module in this thread; see `compile`."""
        with _LOADING.setdefault(self.backend.kernel_of(kernel).module, threading.Lock()):
            self.backend.load(kernel, self.name)

    @contextmanager
    def compiling(self, kernels: Iterable[Any]) -> Iterator[None]:
        """Compile kernels in the background, in this order; all are compiled when the context ends.

        For the CPU another thread compiles, unless the device has a single thread. One is enough: Warp generates code
        in one thread at a time, and the compiler then takes most of the time, without the interpreter lock. For GPUs
        several threads do. After an exception no further compile begins, and the running ones are not waited for.
        """
        if self.is_cpu and self.threads == 1:
            yield
            for kernel in kernels:
                self.compile(kernel)
            return
        compilers = _COMPILER if self.is_cpu else _GPU_COMPILERS
        workers = {compilers.submit(self._load, kernel) for kernel in kernels}
        try:
            yield
            start = time.perf_counter()
            finish(workers)
            self.seconds_compile += time.perf_counter() - start
        finally:
            for worker in workers:
                worker.cancel()

    def launch(
        self,
        kernel: Any,
        count: int,
        inputs: list[Any],
        *,
        spared: int = 0,
        least: int = 1,
        cancellable: bool = False,
        waits: bool = True,
    ) -> None:
        """Run `kernel` over indices 0 to count − 1 on all threads but `spared`, and wait for it.

        The kernel's first argument is the index of its thread 0. On the CPU slices of the range run in parallel; for
        interrupts and for `least` see `run_slices`. A cancellable launch on the CPU ends early when `cancelled` is set.
        On CUDA a launch with `waits` unset returns at once; launches run in order.
        """
        # Compile before the threads start: otherwise each would compile the kernel.
        self.compile(kernel)
        if not self.is_cpu:
            self.backend.launch(kernel, 0, count, inputs, self.name, waits=waits)
            return

        def run(start: int, size: int) -> None:
            self.backend.launch(kernel, start, size, inputs, "cpu")

        cancelled = self.cancelled if cancellable else None
        run_slices(run, count, self._workers, self.threads, spared=spared, least=least, cancelled=cancelled)
