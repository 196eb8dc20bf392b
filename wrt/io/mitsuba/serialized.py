"""Read Mitsuba's binary meshes, `.serialized`.

Several meshes stand in one file, each a header of four bytes and a zlib stream; a table of their offsets ends the file.
Format: Jakob 2014, "Mitsuba documentation", version 0.5, section 8.1.6, for versions 3 and 4; the documentation of the
plugin `serialized` of Mitsuba 3.9 (`src/shapes/serialized.cpp`) for version 5.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.io import memory_limits
from wrt.io.mesh.parts import Part, checked_faces

MAGIC = 0x041C
VERSIONS = (3, 4, 5)

_NORMALS, _UVS, _COLORS, _FACE_NORMALS, _DOUBLE = 0x1, 0x2, 0x8, 0x10, 0x2000
"""Flags of versions 3 and 4; _FACE_NORMALS also of version 5."""

_PACKED_NORMALS, _PACKED_TANGENTS, _PACKED_UVS = 0x1, 0x2, 0x4
"""Flags of version 5, whose vertices always have eight numbers."""


@dataclass
class SerializedMesh:
    """A mesh of a file.

    Attributes:
        part: its triangles; colours are linear.
        face_normals: whether it is flat, though it may have normals.
        attributes: arrays of "vertex_NAME" and "face_NAME", with a row for each vertex or face.
    """

    part: Part
    face_normals: bool = False
    attributes: dict[str, NDArray[Any]] = field(default_factory=dict)


def read_serialized(path: Path, data: bytes, index: int = 0) -> SerializedMesh:
    """Return the mesh with a number, from 0, of a file's content."""
    if len(data) < 8 or struct.unpack_from("<H", data)[0] != MAGIC:
        raise InputError(f"{path}: not a serialized mesh of Mitsuba: it does not begin with 1C 04")
    start = _offset(path, data, index)
    if start < 0 or start + 4 > len(data) or struct.unpack_from("<H", data, start)[0] != MAGIC:
        raise InputError(f"{path}: its table says that mesh {index} begins at byte {start}, where there is none")
    version = struct.unpack_from("<H", data, start + 2)[0]
    if version not in VERSIONS:
        raise InputError(f"{path}: version {version} of serialized meshes is not known; 3, 4 and 5 are")
    stream = _Stream(path, data, start + 4)
    mesh = _packed(path, stream) if version == 5 else _plain(path, stream, version)
    checked_faces(path, mesh.part.faces, len(mesh.part.vertices))
    return mesh


def _offset(path: Path, data: bytes, index: int) -> int:
    """Return where a mesh begins. The first needs no table, so that it can be read from a file without one."""
    if index == 0:
        return 0
    version = struct.unpack_from("<H", data, 2)[0]
    count = struct.unpack_from("<I", data, len(data) - 4)[0]
    size, kind = (4, "<I") if version == 3 else (8, "<Q")
    table = len(data) - 4 - size * count
    if table < 4:
        raise InputError(f"{path}: the table at its end has {count} meshes, more than the file can hold; it is damaged")
    if not 0 <= index < count:
        raise InputError(f"{path}: 'shape_index' is {index}, but its meshes are numbered from 0 to {count - 1}")
    return int(struct.unpack_from(kind, data, table + size * index)[0])


class _Stream:
    """A zlib stream within a file."""

    def __init__(self, path: Path, data: bytes, start: int) -> None:
        """Decompress it, but not beyond the limit of memory."""
        self._path, self._place = path, 0
        try:
            most = max(memory_limits.remaining(memory_limits.MESHES), 1)
            self._data = zlib.decompressobj().decompress(memoryview(data)[start:], most)
        except zlib.error as error:
            raise InputError(f"{path}: a mesh cannot be decompressed: {error}") from None

    def read(self, size: int) -> bytes:
        """Return the next `size` bytes."""
        if size > len(self._data) - self._place:
            raise InputError(f"{self._path}: a mesh ends too soon; the file is truncated")
        self._place += size
        return self._data[self._place - size : self._place]

    def number(self, kind: str) -> int:
        """Return an integer."""
        return int(struct.unpack(f"<{kind}", self.read(struct.calcsize(kind)))[0])

    def text(self, *, has_length: bool) -> str:
        """Return a name, with its length before it or a zero byte after it."""
        if has_length:
            return self.read(self.number("I")).decode("utf-8", "replace")
        end = self._data.find(b"\0", self._place)
        if end < 0:
            raise InputError(f"{self._path}: a name does not end; the file is damaged")
        return self.read(end + 1 - self._place)[:-1].decode("utf-8", "replace")

    def rows(self, kind: str, count: int, width: int) -> NDArray[Any]:
        """Return (count, width) numbers."""
        dtype = np.dtype(kind)
        return np.frombuffer(self.read(count * width * dtype.itemsize), dtype).reshape(count, width)


def _plain(path: Path, stream: _Stream, version: int) -> SerializedMesh:
    """Read versions 3 and 4: an array for each quantity."""
    flags = stream.number("I")
    name = stream.text(has_length=False) if version == 4 else ""
    count, triangles = stream.number("Q"), stream.number("Q")
    kind = "<f8" if flags & _DOUBLE else "<f4"
    index = "<u4" if count <= 0xFFFFFFFF else "<u8"
    vertices = stream.rows(kind, count, 3)
    normals = stream.rows(kind, count, 3) if flags & _NORMALS else None
    uvs = stream.rows(kind, count, 2) if flags & _UVS else None
    colors = stream.rows(kind, count, 3) if flags & _COLORS else None
    faces = stream.rows(index, triangles, 3).astype(np.int64)
    part = Part(name or path.stem, vertices, faces, normals, uvs)
    attributes = {} if colors is None else {"vertex_color": colors}
    return SerializedMesh(part, bool(flags & _FACE_NORMALS), attributes)


def _packed(path: Path, stream: _Stream) -> SerializedMesh:
    """Read version 5: records of eight numbers for each vertex and of four for each face."""
    flags = stream.number("I")
    name = stream.text(has_length=True)
    count, triangles, positions, groups = (stream.number("Q") for _ in range(4))
    records = stream.rows("<f4", count, 8)
    faces = stream.rows("<u4", triangles, 4)[:, :3].astype(np.int64)
    for used in (positions, groups):  # which vertices share a place or a normal: of use for editing only
        if used:
            stream.read(4 * count)
    attributes = {}
    for _ in range(stream.number("I")):
        title = stream.text(has_length=True)
        coefficients, width = stream.number("B") & 1, stream.number("I")
        rows = triangles if title.startswith("face_") else count
        if not 1 <= width <= 4:
            raise InputError(f"{path}: the attribute {title!r} has {width} numbers; it may have 1 to 4")
        values = stream.rows("<f4", rows, width)
        if not coefficients:  # of a spectral variant: not colours
            attributes[title] = values
    # With tangents, the lanes of normals hold an encoded frame.
    has_normals = flags & _PACKED_NORMALS and not flags & _PACKED_TANGENTS
    part = Part(name or path.stem, records[:, :3], faces)
    part.normals = records[:, 3:6] if has_normals else None
    part.uvs = records[:, 6:8] if flags & _PACKED_UVS else None
    return SerializedMesh(part, bool(flags & _FACE_NORMALS), attributes)
