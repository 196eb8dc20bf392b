"""The wide render kernel for CPUs: whether to have it compiled, by another process, and when to switch to it.

`wrt/spmd` translates the scalar kernel to it. Films have the same bits, so a picture can switch from one to the other
between two passes. The wide kernel takes longer to compile; until it is loaded, the scalar one renders.
"""

from __future__ import annotations

import contextlib
import math
import os
import subprocess
import threading
import time
import weakref
from pathlib import Path
from typing import Any

from wrt.backend import cache_folders
from wrt.backend.arrays import Array, Struct
from wrt.backend.device import Device
from wrt.backend.processor import lanes_here
from wrt.compiling import kernel as compiler
from wrt.compiling import later, own

LOADING_SECONDS = 0.02
"""Skip loading if fewer than this many seconds remain to render."""

COMPILING_SECONDS = 8.0
"""Seconds of one core that the compiler takes, roughly (6 to 20): see `compiling_pays`."""

SPEEDUP, SPEEDUP_OF_OWN = 2.0, 4.0 / 3.0
"""How much faster the kernel is than the scalar one, and than a general wide kernel."""

MOST_BYTES = 2**31 - 1
"""Largest array that the kernel can read, because its offsets are 32-bit numbers."""

_LOADING = threading.Lock()
"""Held by the thread that loads a wide kernel, as renderers of the same scene share a kernel."""


def threads_of(width: int, height: int, tile: int) -> int:
    """Return how many threads of a wide kernel render a picture: one for each square of `tile` pixels a side."""
    return -(-width // tile) * -(-height // tile)


class WideKernel:
    """The wide kernel for one scene, if it has one.

    Attributes:
        kernel: The compiled kernel, or None until it is loaded.
        tile: Pixels along each side of the square that one of its threads renders.
    """

    def __init__(self, device: Device, features: Any, records: tuple[Any, ...], part: str = compiler.RENDER) -> None:
        """Start without a kernel; `features` and `records` are those of the scalar kernel (see RenderKernel).

        `part` is what the kernel does (see `wrt.compiling.kernel`).
        """
        self.kernel: Any = None
        self.tile = 0
        self._device, self._features, self._records, self._part = device, features, records, part
        self._lanes = 0
        self._possible: bool | None = None if device.is_cpu else False  # None: not known yet
        self._compiler: subprocess.Popen[bytes] | own.Compiler | None = None
        self._compiling_since: float | None = None
        self._seconds = 0.0
        self._is_requested = False
        self._request: Path | None = None

    def prepare(
        self, seconds_left: float, speedup: float = SPEEDUP, *, may_compile: bool = True, waits: bool = False
    ) -> None:
        """Load the kernel if enough seconds remain to render; if it is not compiled, have it compiled.

        It is compiled for this render if that pays, otherwise for the next one.

        Args:
            seconds_left: seconds that the render still takes without this kernel.
            speedup: how much faster this kernel is than the one in use.
            may_compile: False to load it only if it is compiled.
            waits: whether to wait while another thread loads a wide kernel, or else to do nothing.
        """
        if self._possible is False or self.kernel is not None or not _LOADING.acquire(blocking=waits):
            return
        try:
            if self._compiler is not None:
                if self._compiler.poll() is None:
                    return
                self._compiler_ended()
            if self.kernel is not None or seconds_left <= LOADING_SECONDS or not self._is_usable():
                return
            if self._request is not None and later.is_done(self._request):
                self._request = None
                self._device.backend.artefacts.refresh()
                self._say_refused()
            if self._is_compiled():
                self._load()
                return
            serves_next = pays_next_time(seconds_left, self._device.threads, speedup)
            if may_compile and compiling_pays(seconds_left, self._device.threads, speedup):
                self._compile(serves_next)
            elif may_compile and serves_next and not self._is_requested:
                self._is_requested = True
                self._request = later.request(self._features, self._lanes, self._part)
        finally:
            _LOADING.release()

    def expect(self, seconds: float) -> None:
        """Load the kernel if it is compiled and the render, of at least `seconds`, is long enough."""
        self.prepare(seconds, may_compile=False, waits=True)

    @property
    def lanes(self) -> int:
        """Paths that the kernel follows at once; 1, as for the scalar kernel, while it is not loaded."""
        return 1 if self.kernel is None else self._lanes

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
            self.prepare(math.inf, waits=True)

    def _is_usable(self) -> bool:
        if self._possible is None:
            self._lanes = lanes_here()
            suits = self._lanes > 0 and compiler.has_wide(self._features)
            can_launch = self._device.backend.artefacts.can_launch
            self._possible = suits and can_launch and max(map(largest_array, self._records)) <= MOST_BYTES
        return self._possible

    def _is_compiled(self) -> bool:
        return compiler.is_compiled(self._features, self._lanes, self._part)

    def _load(self) -> None:
        self._possible = False  # do not try again, whatever happens
        with contextlib.suppress(OSError):  # the scalar kernel continues, with the same bits
            kernel = self._device.backend.call(*compiler.declaration(self._features, self._lanes, self._part))
            self.tile = self._device.backend.kernels("wrt.kernels.native.constants").TILE
            self._device.compile(kernel)
            self.kernel = kernel

    def _compile(self, serves_next: bool = True) -> None:
        """Start compiling the kernel in another process; if this one ends first, it is for the next that it serves."""
        try:
            environment = {**os.environ, "TMPDIR": str(cache_folders.work_folder())}  # which this process removes
            arguments = [str(self._lanes), self._part, str(os.getpid()), *self._folders()]

            def start(what: str) -> subprocess.Popen[bytes]:
                return compiler.start(compiler.__name__, what, *arguments, env=environment)

            if own.models_from_outside(self._features):
                self._compiler = own.Compiler(self._features, self._lanes, self._part, start)
            else:
                self._compiler = start(compiler.as_json(self._features))
        except OSError:  # no folder has room, or there is no Python
            self._possible = False
            return
        self._compiling_since = time.perf_counter()
        kernel = self._features, self._lanes, self._part
        weakref.finalize(self, _end, self._compiler, serves_next, *kernel)

    def _folders(self) -> list[str]:
        """Return the folders for compiled kernels, and for the table of artefacts if its usual folder fails."""
        kernels, table = (cache_folders.work_folder() / name for name in ("warp", "wrt"))
        try:
            usual = cache_folders.kernels_folder()
            cache_folders.require_writable(usual / self._device.backend.version)
            kernels = usual
        except OSError as error:
            cache_folders.say_unwritable(Path(error.filename or kernels).parent, error)
        self._device.backend.artefacts.folders.append(table)
        return [str(kernels), str(table)]

    def _compiler_ended(self) -> None:
        """Stop the clock, as the compiler has ended, and give up if the table of artefacts lacks the kernel."""
        self._seconds, self._compiling_since = self.seconds, None
        self._compiler = None
        self._device.backend.artefacts.refresh()
        self._possible = self._is_compiled()
        if not self._possible:
            self._say_refused()

    def _say_refused(self) -> None:
        """Warn of what in a model from outside the translator cannot take."""
        refused = own.models_from_outside(self._features) and self._part == compiler.RENDER
        if refused and (why := own.refusal(self._features, self._lanes)):
            self._possible = False
            cache_folders.warn_once(f"{why} (until then renders take twice as long: docs/own.md)")


def _end(
    compiler: subprocess.Popen[bytes] | own.Compiler, serves_next: bool, features: Any, lanes: int, part: str
) -> None:
    """End the compiler of a render that ends before it, which nothing else would; the next may get the kernel."""
    if compiler.poll() is None:
        compiler.kill()
        compiler.wait()
        if serves_next:
            later.request(features, lanes, part)


def compiling_pays(seconds_left: float, threads: int, speedup: float) -> bool:
    """Return whether a render is done earlier if one of its threads gives way to the compiler.

    That costs what the thread would have done while the compiler runs, and saves `1 - 1 / speedup` of the work that is
    left then.
    """
    cost = COMPILING_SECONDS / threads
    left_then = seconds_left - (COMPILING_SECONDS - cost)
    return left_then * (1.0 - 1.0 / speedup) > cost


def pays_next_time(seconds_left: float, threads: int, speedup: float) -> bool:
    """Return whether compiling it after this render is worth its time, if the next takes as long as this still does."""
    return seconds_left * threads * (1.0 - 1.0 / speedup) >= later.WORTH * COMPILING_SECONDS


def largest_array(record: Struct) -> int:
    """Return the bytes of the largest array in a record, except for the ray tree, which has 64-bit offsets."""
    fields = [value for name, value in record.fields().items() if name != "bvh"]
    arrays = [value.rows.nbytes for value in fields if isinstance(value, Array)]
    return max([0, *arrays, *(largest_array(value) for value in fields if isinstance(value, Struct))])
