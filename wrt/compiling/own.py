"""Wide kernels with models from outside, whose code this process generates and another compiles.

The other process cannot import the models: they may be in a program, or in a cell of a notebook. Code is generated in a
thread, which takes a second; kernels that render at the same time do not hold Python's lock.
"""

from __future__ import annotations

import functools
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wrt.backend import cache_folders, current_backend
from wrt.compiling.kernel import RENDER, declaration, name_of_kernel

if TYPE_CHECKING:
    from concurrent.futures import Future, ThreadPoolExecutor


def models_from_outside(features: Any) -> list[str]:
    """Return the names in features of models that were registered from outside."""
    registry = sys.modules.get("wrt.kernels.core.registry")
    of_rays = (*features.cameras, *features.distances, *features.procedures, features.integrator)
    names = (*features.models, *features.light_shapes, *of_rays)
    return [] if registry is None else list(registry.from_outside(names))


@functools.cache
def code_of(features: Any, lanes: int, part: str = RENDER) -> Future[str]:
    """Return the code of a kernel as JSON, which is ready in a second; see `wrt.backend.generated`.

    Its exception is Unsupported if the kernel cannot be translated. Python ends only after it is ready.
    """
    return _generator().submit(_generate, features, lanes, part)


@functools.cache
def _generator() -> ThreadPoolExecutor:
    import atexit
    from concurrent.futures import ThreadPoolExecutor

    pool = ThreadPoolExecutor(1)
    atexit.register(pool.shutdown)  # which the command line's own end would not wait for otherwise
    return pool


def _generate(features: Any, lanes: int, part: str) -> str:
    from wrt.backend.generated import generate

    kernel = current_backend().call(*declaration(features, lanes, part))
    return json.dumps(generate(name_of_kernel(features, lanes, part), kernel))


def refusal(features: Any, lanes: int) -> str:
    """Return why a kernel with models from outside cannot be translated; empty while that is not known."""
    code = code_of(features, lanes)
    return str(code.exception() or "") if code.done() else ""


class Compiler:
    """What compiles a kernel: first the thread that generates its code, then a process; used as that process is."""

    def __init__(self, features: Any, lanes: int, part: str, start: Callable[[str], subprocess.Popen[bytes]]) -> None:
        """Begin; `start` starts the process, for a file with the code."""
        self._code, self._start = code_of(features, lanes, part), start
        self._process: subprocess.Popen[bytes] | None = None
        self._is_ended = False

    def poll(self) -> int | None:
        """Return None until it has ended."""
        if not self._code.done():
            return None
        return self._begun().poll() if self._code.exception() is None else 1

    def wait(self) -> int:
        """Wait until it has ended."""
        if self._process is None and (self._is_ended or self._code.exception() is not None):
            return 1
        return self._begun().wait()

    def kill(self) -> None:
        """End it."""
        self._is_ended = True
        if self._process is not None:
            self._process.kill()

    def _begun(self) -> subprocess.Popen[bytes]:
        """Return the process, started when the code exists: the system ends it with this thread."""
        if self._process is None:
            path = Path(cache_folders.work_folder(), f"code-{id(self)}.json")
            path.write_text(self._code.result(), encoding="utf-8")
            self._process = self._start(str(path))
        return self._process
