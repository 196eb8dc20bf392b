"""The faster render kernel of CPUs: when it is worth compiling, in a process of its own, and when to go over to it.

`kernels/wide` makes it of the usual one, and the film's bits are the same, so a picture can change from one to the
other between two passes. It takes longer to compile, so the usual one renders until it is there.
"""

from __future__ import annotations

import contextlib
import ctypes
import dataclasses
import json
import math
import os
import signal
import subprocess
import sys
import time
import weakref
from functools import partial
from pathlib import Path
from typing import Any

from wrt import cache_folders
from wrt.device import Device, is_lean
from wrt.lean.builds import Builds, Missing, loaded_by_warp

NEEDED = frozenset(("avx512f", "avx512bw", "avx512dq", "avx512vl", "bmi2"))
"""What the processor must know: sixteen numbers in a register, and masks for them."""

SWITCH = "WRT_WIDE"
"""A variable of the environment: 0 leaves all to the usual kernel."""

LOADING_SECONDS, LEAN_LOADING_SECONDS = 2.0, 0.3
"""Less rendering is not worth loading it: it must be written anew to be known again (0.5 s), but not without Warp."""

COMPILING_SECONDS = 30.0
"""Less rendering is not worth compiling it, which takes 8 to 20 s of one core.

It is not put behind the threads that render in the system's order (`nice`), and one of them rests. Behind them, on two
cores, it had not ended after 60 s (Cornell box: 232 samples; 343 where it was not behind, even with none at rest)."""

MOST_BYTES = 2**31 - 1
"""Of an array that kernels look into: places are 32-bit numbers."""

_PR_SET_PDEATHSIG = 1  # of Linux's prctl.h

_UNLIKE_PATHS = ("whitted", "ao", "aov")
"""Integrators whose kernels are not made of paths."""


class WideKernel:
    """The kernel for one scene, if it can be had.

    Attributes:
        kernel: it, once it is loaded.
    """

    def __init__(self, device: Device, features: Any, records: tuple[Any, ...]) -> None:
        """Take what the usual kernel was made for, and those of its arguments that lead to arrays."""
        self.kernel: Any = None
        self._device, self._features, self._records = device, features, records
        self._possible: bool | None = None if device.is_cpu else False  # None: not asked yet
        self._compiler: subprocess.Popen[bytes] | None = None
        self._builds: Builds | None = None
        self._compiling_since: float | None = None
        self._seconds = 0.0

    def prepare(self, seconds_left: float) -> None:
        """Load it, or have it compiled, if that is worth it for what is left to render."""
        if self._possible is False or self.kernel is not None:
            return
        if self._compiler is not None:
            if self._compiler.poll() is None:
                return
            self._compiled()
        if seconds_left > (LEAN_LOADING_SECONDS if is_lean() else LOADING_SECONDS) and self._can_be_had():
            if self._is_compiled():
                self._load()
            elif seconds_left > COMPILING_SECONDS:
                self._compile()

    @property
    def is_being_compiled(self) -> bool:
        """Whether another process is at it."""
        return self._compiler is not None

    @property
    def seconds(self) -> float:
        """Seconds that another process has spent compiling the kernel so far."""
        since = self._compiling_since
        return self._seconds + (0.0 if since is None else time.perf_counter() - since)

    def wait(self) -> None:
        """Have it compiled if it is not, and load it; return when it is there or cannot be had."""
        if self.kernel is None and self._can_be_had():
            if self._compiler is None and not self._is_compiled():
                self._compile()
            if self._compiler is not None:
                self._compiler.wait()
            self.prepare(math.inf)

    def _can_be_had(self) -> bool:
        if self._possible is None:
            suits = os.environ.get(SWITCH) != "0" and self._features.integrator not in _UNLIKE_PATHS
            suits = suits and processor_flags() >= NEEDED
            if suits and max(map(largest_array, self._records)) <= MOST_BYTES:
                self._builds = sys.modules["warp"].builds if is_lean() else Builds.known()
            self._possible = self._builds is not None
        return self._possible

    def _is_compiled(self) -> bool:
        from wrt.kernels.wide.render import module_name

        return self._builds is not None and self._builds.has(module_name(self._features))

    def _load(self) -> None:
        from wrt.kernels.wide.render import declare_wide_render_kernel, make_wide_render_kernel

        self._possible = False  # whatever happens, not again
        make = partial(declare_wide_render_kernel, code="") if is_lean() else make_wide_render_kernel
        with contextlib.suppress(Missing, OSError):  # the scalar kernel goes on, with the same bits
            kernel = make(self._features)
            self._device.compile(kernel)
            self.kernel = kernel

    def _compile(self) -> None:
        """Begin compiling it, in another process."""
        package = str(Path(__file__).resolve().parent.parent)
        features = json.dumps(dataclasses.asdict(self._features))
        # Not `-m`, which would import what is called `wrt` in the folder that the user is in.
        begin = f"import sys; sys.path[0] = {package!r}; from wrt.wide import main; sys.exit(main(sys.argv))"
        try:
            command = [sys.executable, "-c", begin, features, str(os.getpid()), *self._folders()]
        except OSError:  # no folder has room
            self._possible = False
            return
        nothing = subprocess.DEVNULL
        try:
            self._compiler = subprocess.Popen(command, stdin=nothing, stdout=nothing, stderr=nothing)
        except (OSError, TypeError):  # the latter where no Python is known
            self._possible = False
            return
        self._compiling_since = time.perf_counter()
        weakref.finalize(self, _end, self._compiler)  # nobody else waits for it

    def _folders(self) -> list[str]:
        """Return the folders for the compiler to work in, for its kernels, and for notes if their usual place fails."""
        work = cache_folders.work_folder()
        folders = [work, work / "warp", work / "wrt"]
        config = sys.modules["warp"].config
        try:
            known = getattr(config, "kernel_cache_dir", None)
            kernels = Path(known).parent if known else cache_folders.warp_folder()  # Warp adds its version to the path
            cache_folders.require_writable(kernels / config.version)
            folders[1] = kernels
        except OSError as error:
            cache_folders.say_unwritable(Path(error.filename or folders[1]).parent, error)
        if self._builds is not None:
            self._builds.elsewhere = folders[2]
        return [str(folder) for folder in folders]

    def _compiled(self) -> None:
        """Take note of how compiling has ended."""
        self._seconds, self._compiling_since = self.seconds, None
        self._compiler = None
        if self._builds is not None:
            self._builds.refresh()
        self._possible = self._is_compiled()


def _end(compiler: subprocess.Popen[bytes]) -> None:
    compiler.kill()
    compiler.wait()


def largest_array(record: Any) -> int:
    """Return the bytes of the largest array that a record leads to, the ray tree's apart: rays count in 64 bits."""
    import warp as wp

    most = 0
    for name in record._cls.vars if hasattr(record, "_cls") else record._record.fields:
        value = getattr(record, name)
        if hasattr(value, "_cls") or hasattr(value, "_record"):
            most = max(most, largest_array(value) if name != "bvh" else 0)
        elif hasattr(value, "ptr"):
            most = max(most, math.prod(value.shape) * wp.types.type_size_in_bytes(value.dtype))
    return most


def processor_flags() -> frozenset[str]:
    """Return what the processor says it knows; nothing where it cannot be asked."""
    # A line at a time: there is a paragraph for each of what may be hundreds of cores.
    with contextlib.suppress(OSError), open("/proc/cpuinfo", encoding="utf-8", errors="replace") as file:
        for line in file:
            if line.startswith("flags"):
                return frozenset(line.partition(":")[2].split())
    return frozenset()


def main(arguments: list[str]) -> int:
    """Compile the kernel for features given as JSON, and note it for other processes.

    The arguments are the program's name, the features, the id of the parent process, and the folders of
    `WideKernel._folders`. This process ends with its parent. Processes that start at the same time compile one after
    the other.
    """
    import warp as wp

    from wrt.kernels.features import Features
    from wrt.kernels.wide.render import make_wide_render_kernel, module_name

    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C reaches every process of the terminal's foreground group
    _end_with_parent()
    if os.getppid() != int(arguments[2]):
        return 1  # it ended before this
    if arguments[3:]:
        work, kernels, notes = map(Path, arguments[3:])
        cache_folders.work_within(work)
        wp.config.kernel_cache_dir = str(kernels)
    described = json.loads(arguments[1])
    features = Features(
        **{name: tuple(value) if isinstance(value, list) else value for name, value in described.items()}
    )
    builds = Builds.known()
    if builds is None:
        return 1
    if arguments[3:]:
        builds.elsewhere = notes
    with builds.alone():
        builds.refresh()
        if not builds.has(module_name(features)):
            Device("cpu").compile(make_wide_render_kernel(features))
            builds.note(loaded_by_warp())
    return 0


def _end_with_parent() -> None:
    """Have the system end this process when the one that started it ends, however that does."""
    prctl = getattr(ctypes.CDLL(None), "prctl", None)
    if prctl is not None:
        prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)  # a background job may ignore other signals


if __name__ == "__main__":
    sys.exit(main(sys.argv))
