"""The wide render kernel for CPUs: whether to compile it, in another process, and when to switch to it.

`wrt/spmd` translates the scalar kernel to it. Films have the same bits, so a picture can switch from one to the other
between two passes. The wide kernel takes longer to compile; until it is loaded, the scalar one renders.
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
from pathlib import Path
from typing import Any

from wrt.backend import cache_folders, current_backend
from wrt.backend.builds import Builds, NotCompiled
from wrt.backend.device import Device
from wrt.backend.lanes import lanes_here
from wrt.backend.recording import call_name, compiled_by_warp

LOADING_SECONDS, COMPILED_LOADING_SECONDS = 2.0, 0.3
"""Skip loading if fewer than this many seconds remain to render. Warp must generate the code again (0.5 s); the
compiled backend need not."""

COMPILING_SECONDS = 30.0
"""Skip compiling if fewer than this many seconds remain to render: it takes 8 to 20 s of one core.

The compiler runs at normal priority, and one render thread is left idle for it. At a lower priority (`nice`) on two
cores, it had not finished after 60 s (Cornell box: 232 samples; 343 at normal priority, even with no thread idle)."""

MOST_BYTES = 2**31 - 1
"""Largest array that the kernel can read, because its offsets are 32-bit numbers."""

_PR_SET_PDEATHSIG = 1  # of Linux's prctl.h

_MAKE = "wrt.spmd.kernel", "make_wide_render_kernel"
"""Module and name of the function that declares the kernel for some features and lanes."""

_UNLIKE_PATHS = ("whitted", "ao", "aov")
"""Integrators whose kernels do not trace paths."""


class WideKernel:
    """The wide kernel for one scene, if it has one.

    Attributes:
        kernel: The compiled kernel, or None until it is loaded.
        tile: Pixels along each side of the square that one of its threads renders.
    """

    def __init__(self, device: Device, features: Any, records: tuple[Any, ...]) -> None:
        """Start without a kernel; `features` and `records` are those of the scalar kernel (see RenderKernel)."""
        self.kernel: Any = None
        self.tile = 0
        self._device, self._features, self._records = device, features, records
        self._lanes = 0
        self._possible: bool | None = None if device.is_cpu else False  # None: not known yet
        self._compiler: subprocess.Popen[bytes] | None = None
        self._builds: Builds | None = None
        self._compiling_since: float | None = None
        self._seconds = 0.0

    def prepare(self, seconds_left: float) -> None:
        """Load the kernel, or start compiling it, if enough seconds remain to render."""
        if self._possible is False or self.kernel is not None:
            return
        if self._compiler is not None:
            if self._compiler.poll() is None:
                return
            self._compiled()
        if (
            seconds_left > (LOADING_SECONDS if self._device.backend.builds is None else COMPILED_LOADING_SECONDS)
            and self._is_usable()
        ):
            if self._is_compiled():
                self._load()
            elif seconds_left > COMPILING_SECONDS:
                self._compile()

    @property
    def is_being_compiled(self) -> bool:
        """True while another process compiles the kernel."""
        return self._compiler is not None

    @property
    def seconds(self) -> float:
        """Seconds that another process has spent compiling the kernel so far."""
        since = self._compiling_since
        return self._seconds + (0.0 if since is None else time.perf_counter() - since)

    def wait(self) -> None:
        """Compile the kernel if necessary, and load it if possible."""
        if self.kernel is None and self._is_usable():
            if self._compiler is None and not self._is_compiled():
                self._compile()
            if self._compiler is not None:
                self._compiler.wait()
            self.prepare(math.inf)

    def _is_usable(self) -> bool:
        if self._possible is None:
            self._lanes = lanes_here()
            suits = self._lanes > 0 and self._features.integrator not in _UNLIKE_PATHS
            if suits and max(map(largest_array, self._records)) <= MOST_BYTES:
                self._builds = self._device.backend.builds or Builds.known()
            self._possible = self._builds is not None
        return self._possible

    def _is_compiled(self) -> bool:
        call = call_name(*_MAKE, (self._features, self._lanes))
        return self._builds is not None and self._builds.has(call)

    def _load(self) -> None:
        self._possible = False  # do not try again, whatever happens
        with contextlib.suppress(NotCompiled, OSError):  # the scalar kernel continues, with the same bits
            kernel = self._device.backend.call(*_MAKE, self._features, self._lanes)
            self.tile = self._device.backend.kernels("wrt.kernels.native.constants").TILE
            self._device.compile(kernel)
            self.kernel = kernel

    def _compile(self) -> None:
        """Start compiling the kernel in another process."""
        package = str(Path(__file__).resolve().parents[2])
        features = json.dumps(dataclasses.asdict(self._features))
        # `-m` would import a `wrt` in the user's current folder.
        module = f"from {__name__} import main"
        begin = f"import sys; sys.path[0] = {package!r}; {module}; sys.exit(main(sys.argv))"
        try:
            command = [sys.executable, "-c", begin, features, str(self._lanes), str(os.getpid()), *self._folders()]
        except OSError:  # no folder has room
            self._possible = False
            return
        nothing = subprocess.DEVNULL
        try:
            self._compiler = subprocess.Popen(command, stdin=nothing, stdout=nothing, stderr=nothing)
        except (OSError, TypeError):  # TypeError if sys.executable is None
            self._possible = False
            return
        self._compiling_since = time.perf_counter()
        weakref.finalize(self, _end, self._compiler)  # nothing else would end it

    def _folders(self) -> list[str]:
        """Return the folders for the compiler's work, for its kernels, and for notes if their usual folder fails."""
        work = cache_folders.work_folder()
        folders = [work, work / "warp", work / "wrt"]
        try:
            warp = sys.modules.get("warp")
            known = warp and warp.config.kernel_cache_dir
            kernels = Path(known).parent if known else cache_folders.warp_folder()  # Warp adds its version to the path
            cache_folders.require_writable(kernels / self._device.backend.version)
            folders[1] = kernels
        except OSError as error:
            cache_folders.say_unwritable(Path(error.filename or folders[1]).parent, error)
        if self._builds is not None:
            self._builds.folders.append(folders[2])
        return [str(folder) for folder in folders]

    def _compiled(self) -> None:
        """Record the result of compiling."""
        self._seconds, self._compiling_since = self.seconds, None
        self._compiler = None
        if self._builds is not None:
            self._builds.refresh()
        self._possible = self._is_compiled()


def _end(compiler: subprocess.Popen[bytes]) -> None:
    compiler.kill()
    compiler.wait()


def largest_array(record: Any) -> int:
    """Return the bytes of the largest array in a record, except for the ray tree, which has 64-bit offsets."""
    backend, most = current_backend(), 0
    for name, value in backend.fields(record).items():
        if hasattr(value, "ptr"):
            most = max(most, value.numpy().nbytes)
        elif name != "bvh":
            most = max(most, largest_array(value))
    return most


def main(arguments: list[str]) -> int:
    """Compile the kernel for features given as JSON, and note it for other processes.

    The arguments are the program's name, the features, the lanes, the id of the parent process, and the folders of
    `WideKernel._folders`. This process ends with its parent. Concurrent processes compile one after the other.
    """
    import warp as wp

    from wrt.backend.warp_backend import WarpBackend
    from wrt.kernels.features import Features

    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C reaches every process of the terminal's foreground group
    _end_with_parent()
    if os.getppid() != int(arguments[3]):
        return 1  # the parent ended before the line above
    if arguments[4:]:
        work, kernels, notes = map(Path, arguments[4:])
        cache_folders.work_within(work)
        wp.config.kernel_cache_dir = str(kernels)
    described, lanes = json.loads(arguments[1]), int(arguments[2])
    features = Features(
        **{name: tuple(value) if isinstance(value, list) else value for name, value in described.items()}
    )
    builds = Builds.known()
    if builds is None:
        return 1
    if arguments[4:]:
        builds.folders.append(notes)
    with builds.alone():
        builds.refresh()
        if not builds.has(call_name(*_MAKE, (features, lanes))):
            backend = WarpBackend()
            backend.kernels("wrt.kernels.native.constants")
            Device("cpu").compile(backend.call(*_MAKE, features, lanes))
            builds.note(compiled_by_warp(backend))
    return 0


def _end_with_parent() -> None:
    """Ask the system to kill this process when its parent ends for any reason."""
    prctl = getattr(ctypes.CDLL(None), "prctl", None)
    if prctl is not None:
        prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)  # a background job may ignore other signals


if __name__ == "__main__":
    sys.exit(main(sys.argv))
