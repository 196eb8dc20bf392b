"""The text of large OBJ files, parsed by a kernel (`kernels/files/obj_text.py`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

SIZES = range(8 << 20, 1 << 30)
"""Bytes of texts for the kernel. Compiling the kernel, once a machine, takes as long as NumPy for 60 MB. Beyond the
upper limit indices might not fit 32 bits."""

_CHUNK = 1 << 18
"""Bytes that a thread of the kernel parses."""


@dataclass
class ObjLines:
    """The lines of an OBJ file.

    Attributes:
        rows: (N, K) numbers of "v", "vt" and "vn".
        corners: (C, 3) what corners of faces name of each, counted from 0; -1 for nothing.
        sizes: (F,) corners of each face.
        others: All other lines.
        faces_before: (L,) how many faces are before each of them.
    """

    rows: dict[str, NDArray[Any]]
    corners: NDArray[np.int32]
    sizes: NDArray[np.int32]
    others: bytes
    faces_before: NDArray[np.int32]


def read_lines(data: bytes, columns: dict[str, tuple[int, int]]) -> ObjLines | None:
    """Parse a text without carriage returns and continued lines.

    Args:
        data: the text.
        columns: the least and the largest number of columns of each kind of vertex data.

    Returns:
        None where something is not as in most files: lines of "v" that differ in length, numbers of more than 19
        digits, a mistake; and where there is no space to compile the kernel.
    """
    from wrt.backend.device import Device

    device = Device("cpu", threads=1)
    backend = device.backend
    kernels = backend.kernels("wrt.kernels.files.obj_text")
    data = data if data.endswith(b"\n") else data + b"\n"
    starts = [0]
    while starts[-1] < len(data):
        starts.append(data.find(b"\n", min(starts[-1] + _CHUNK, len(data) - 1)) + 1)
    chunks = len(starts) - 1
    text = kernels.Text()
    text.letters = backend.array(np.frombuffer(data, np.uint8), "uint8", copy=False)
    text.starts = backend.array(starts, int)
    text.counts = backend.empty(9 * chunks, int)
    text.is_read = backend.empty(chunks, int)
    try:
        device.launch(kernels.count_text, chunks, [text])
    except OSError:
        return None
    backend.artefacts.save()  # for processes that only load files

    counts = text.counts.numpy().reshape(-1, 9)
    words = [next((n for n in column.tolist() if n), 0) for column in counts[:, 6:].T]
    *lines, faces, others, corners = (int(total) for total in counts[:, [0, 1, 2, 3, 4, 5]].sum(axis=0, dtype=np.int64))
    if any(n and found < least for n, found, (least, _) in zip(lines, words, columns.values(), strict=True)):
        return None
    counts[:, :6] = np.cumsum(counts[:, :6], axis=0) - counts[:, :6]
    most = [largest for _, largest in columns.values()]
    kept = [min(pair) for pair in zip(words, most, strict=True)]
    text.columns, text.most = kept, most
    for (kind, count), width in zip(zip(columns, lines, strict=True), kept, strict=True):
        setattr(text, kind, backend.empty(count * width, "float64" if kind == "v" else float))
    text.corners, text.sizes = backend.empty(3 * corners, int), backend.empty(faces, int)
    text.others = backend.empty(2 * others, int)
    device.launch(kernels.read_text, chunks, [text])
    if not text.is_read.numpy().all():
        return None
    begins, faces_before = text.others.numpy().reshape(-1, 2).T
    return ObjLines(
        {kind: getattr(text, kind).numpy().reshape(-1, width or 3) for kind, width in zip(columns, kept, strict=True)},
        text.corners.numpy().reshape(-1, 3),
        text.sizes.numpy(),
        b"".join(data[begin : data.find(b"\n", begin) + 1] for begin in begins.tolist()),
        faces_before,
    )
