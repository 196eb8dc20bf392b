"""What the process that reads USD files sends: JSON, and arrays as their bytes. Nothing in it can run code.

A line describes the arrays, [format of struct, shape] each; the next is the content, in which {"array": N} stands for
an array; then come the arrays' bytes, all padded to whole ALIGNMENT.
"""

from __future__ import annotations

import json
from typing import IO, TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

ALIGNMENT = 8

_FORMATS = frozenset("?bBhHiIlLqQefd")
"""Types of numbers that an array may have."""


def write(stream: IO[bytes], content: object, arrays: list[memoryview[Any]]) -> None:
    """Write a message; no NumPy is needed for it, which takes a process 0.1 s to import."""
    described = [[array.format, array.shape] for array in arrays]
    head = f"{json.dumps(described)}\n{json.dumps(content)}\n".encode()
    stream.write(head + b" " * (-len(head) % ALIGNMENT))
    for array in arrays:
        stream.write(array)
        stream.write(bytes(-array.nbytes % ALIGNMENT))
    stream.flush()


def read(data: bytes) -> Any:
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
        data[first + 1 : second], object_hook=lambda given: arrays[given["array"]] if "array" in given else given
    )
