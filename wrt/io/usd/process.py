"""The process in which Pixar's library reads a USD file (`wrt/io/usd/stage.py`): starting it, and what it sends.

It sends JSON, and arrays as their bytes; nothing in it can run code. A line describes the arrays, [format of struct,
shape] each; the next is the content, in which {ARRAY: N} stands for an array; then come the arrays' bytes. All are
padded to whole multiples of ALIGNMENT.
"""

from __future__ import annotations

import json
import signal
import subprocess
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from wrt import child
from wrt.errors import InputError
from wrt.io import memory_limits
from wrt.io.account import TrackedObject
from wrt.io.safe_read import confinement_folder, require_file

if TYPE_CHECKING:
    import numpy as np

SECONDS = 60
"""Seconds of CPU that the process may take; a hundred times as much as it takes for a small file."""

SECONDS_PER_MEGABYTE = 10

ALIGNMENT = 8

ARRAY = "#"
"""The key of an array's number; no attribute has this name."""

PREVIEW = "UsdPreviewSurface"
"""The type of the surface shader that is supported."""

_FORMATS = frozenset("?bBhHiIlLqQefd")
"""Types of numbers that an array may have."""

_CODE = "from wrt.io.usd.stage import main; main()"


def description(path: Path, time: float | None = None) -> dict[str, Any]:
    """Return the plain description of a file's stage that `wrt/io/usd/stage.py` makes.

    At `time` seconds after the file's first time, or at that one.

    Raises:
        InputError: where Pixar's library cannot read the file, or takes too much memory or time for it, and on files
            that it may not read.
    """
    folder = confinement_folder()
    command = child.command(_CODE, str(path), str(folder or ""), "" if time is None else repr(time))
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, check=False)
    if done.returncode:
        raise _failure(path, done.returncode, done.stderr.decode(errors="replace"))
    content: dict[str, Any] = read_message(done.stdout)
    if "error" in content:
        raise InputError(content["error"])
    for file in content["files"]:
        require_file(Path(file))
    return content


def _failure(path: Path, status: int, output: str) -> Exception:
    """Return the error of a process that ended before it sent anything."""
    limit = memory_limits.COMPOSED
    reason = f"its layers and prims would take more than {limit.free >> 20} MB plus {limit.per_byte} times"
    reason += " its files' size"
    if "bad_alloc" in output or "MemoryError" in output:
        return InputError(f"{path}: {reason}")
    if status == -signal.SIGXCPU:
        return InputError(f"{path}: reading it takes more than {SECONDS} s, plus {SECONDS_PER_MEGABYTE} for each MB")
    if status < 0:
        name = signal.Signals(-status).name  # also SIGSEGV for lack of memory
        return InputError(f"{path}: damaged, nested too deeply, or {reason}: Pixar's library ended with {name}")
    if "ImportError" in output:
        return InputError(f"{path}: Pixar's library cannot be loaded: {output.strip().splitlines()[-1]}")
    return RuntimeError(f"the process that reads {path} failed: {output}")


def write_message(stream: IO[bytes], content: object, arrays: list[memoryview[Any]]) -> None:
    """Write a message; no NumPy is needed for it, which takes a process 0.1 s to import."""
    head = f"{json.dumps([[array.format, array.shape] for array in arrays])}\n{json.dumps(content)}\n".encode()
    stream.write(head + b" " * (-len(head) % ALIGNMENT))
    for array in arrays:
        stream.write(array)
        stream.write(bytes(-array.nbytes % ALIGNMENT))
    stream.flush()


def read_message(data: bytes) -> Any:
    """Return the content of a message, with its arrays as NumPy's, which share memory with it and are read-only.

    Raises:
        ValueError: if it is not a message.
    """
    import numpy as np

    first, second = data.index(b"\n"), data.index(b"\n", data.index(b"\n") + 1)
    place = second + 1 + -(second + 1) % ALIGNMENT
    arrays: list[np.ndarray[Any, Any]] = []
    for code, shape in json.loads(data[:first]):
        if code not in _FORMATS:
            raise ValueError(f"unknown type of numbers {code!r}")
        kind = np.dtype(code)
        count = int(np.prod(shape, dtype=np.int64))
        arrays.append(np.frombuffer(data, kind, count, place if count else 0).reshape(shape))
        place += count * kind.itemsize + -(count * kind.itemsize) % ALIGNMENT
    return json.loads(
        data[first + 1 : second],
        object_hook=lambda found: arrays[found[ARRAY]] if ARRAY in found else TrackedObject(found),
    )
