"""Start the process in which Pixar's library reads a USD file (`wrt/io/usd/stage.py`), and take what it sends."""

from __future__ import annotations

import signal
import subprocess
from pathlib import Path
from typing import Any

from wrt import child
from wrt.errors import InputError
from wrt.io import memory_limits
from wrt.io.safe_read import confinement_folder, require_file
from wrt.io.usd import message

SECONDS = 60
"""Seconds of CPU that the process may take; a hundred times as much as it takes for a small file."""

SECONDS_PER_MEGABYTE = 10

_CODE = "from wrt.io.usd.stage import main; main()"


def description(path: Path) -> dict[str, Any]:
    """Return the plain description of a file's stage that `wrt/io/usd/stage.py` makes.

    Raises:
        InputError: where Pixar's library cannot read the file, or takes too much memory or time for it, and on files
            that it may not read.
    """
    folder = confinement_folder()
    command = child.command(_CODE, str(path), "" if folder is None else str(folder))
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, check=False)
    if done.returncode:
        raise _failure(path, done.returncode, done.stderr.decode(errors="replace"))
    content: dict[str, Any] = message.read(done.stdout)
    if "error" in content:
        raise InputError(content["error"])
    for file in content["files"]:
        require_file(Path(file))
    return content


def _failure(path: Path, status: int, told: str) -> Exception:
    """Return the error of a process that ended before it sent anything."""
    limit = memory_limits.COMPOSED
    much = (
        f"its layers and prims would take more than {limit.free >> 20} MB plus {limit.per_byte} times its files' size"
    )
    if "bad_alloc" in told or "MemoryError" in told:
        return InputError(f"{path}: {much}")
    if status == -signal.SIGXCPU:
        return InputError(f"{path}: reading it takes more than {SECONDS} s, plus {SECONDS_PER_MEGABYTE} for each MB")
    if status < 0:
        name = signal.Signals(-status).name  # also SIGSEGV for lack of memory
        return InputError(f"{path}: damaged, nested too deeply, or {much}: Pixar's library ended with {name}")
    if "ImportError" in told:
        return InputError(f"{path}: Pixar's library cannot be loaded: {told.strip().splitlines()[-1]}")
    return RuntimeError(f"the process that reads {path} failed: {told}")
