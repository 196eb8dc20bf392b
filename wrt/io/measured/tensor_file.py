"""Tensor files: named arrays in one file, as the RGL material database has them.

Format: Mitsuba 3, `mitsuba/python/tensor_io.py`: "tensor_file", a zero byte, the version 1.0, and the number of fields;
for each field its name, number of dimensions, type, offset in the file, and shape; then the arrays. All little-endian.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError

_MAGIC = b"tensor_file\0"
_VERSION = (1, 0)
_TYPES = (None, "<u1", "<i1", "<u2", "<i2", "<u4", "<i4", "<u8", "<i8", "<f2", "<f4", "<f8")
"""NumPy's names of the types, by their numbers in files."""

_MOST_DIMENSIONS = 16
_LONGEST = 2**40
_ALIGNMENT = 8


def read_tensors(data: bytes) -> dict[str, NDArray[Any]]:
    """Return the arrays of a tensor file by name; they are read-only views of `data`.

    Raises:
        InputError: when it is no tensor file, or an array would reach over its end.
    """
    if not data.startswith(_MAGIC):
        raise InputError("not a tensor file: it must begin with 'tensor_file'")
    try:
        *version, count = struct.unpack_from("<BBI", data, len(_MAGIC))
        if tuple(version) != _VERSION:
            raise InputError(f"a tensor file of version {version[0]}.{version[1]}; only 1.0 can be read")
        at = len(_MAGIC) + 6
        fields = {}
        for _ in range(count):
            name, values, at = _field(data, at)
            fields[name] = values
        return fields
    except struct.error:
        raise InputError("ends within the list of its arrays") from None


def _field(data: bytes, at: int) -> tuple[str, NDArray[Any], int]:
    """Return the name and the values of the field that is described at an offset, and the offset of the next one."""
    (length,) = struct.unpack_from("<H", data, at)
    name = data[at + 2 : at + 2 + length].decode("utf-8", "replace")
    at += 2 + length
    dimensions, kind, offset = struct.unpack_from("<HBQ", data, at)
    if not 0 < kind < len(_TYPES) or dimensions > _MOST_DIMENSIONS:
        raise InputError(f"the array {name!r} of {dimensions} dimensions has the type {kind}, which is not known")
    at += 11
    shape = struct.unpack_from(f"<{dimensions}Q", data, at)
    dtype = np.dtype(_TYPES[kind])
    size = math.prod(shape) * dtype.itemsize
    # NumPy refuses an empty array that would be too large without the dimension of 0.
    if math.prod(n for n in shape if n) > _LONGEST or offset + size > len(data):
        raise InputError(f"the array {name!r} of {shape} takes {size} bytes from {offset} on, but it is shorter")
    return name, np.ndarray(shape, dtype, data, offset), at + 8 * dimensions


def write_tensors(file: BinaryIO, fields: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays as a tensor file.

    Args:
        file: open for binary writing, at its beginning.
        fields: arrays of numbers by name.
    """
    arrays = {name: np.ascontiguousarray(array, array.dtype.newbyteorder("<")) for name, array in fields.items()}
    heads = {name: struct.pack("<H", len(name.encode())) + name.encode() for name in arrays}
    offset = len(_MAGIC) + 6 + sum(len(heads[name]) + 11 + 8 * array.ndim for name, array in arrays.items())
    listed, content = _MAGIC + struct.pack("<BBI", *_VERSION, len(arrays)), b""
    for name, array in arrays.items():
        padding = -(offset + len(content)) % _ALIGNMENT
        content += bytes(padding)
        kind = _TYPES.index(array.dtype.str.replace("|", "<"))
        listed += heads[name] + struct.pack("<HBQ", array.ndim, kind, offset + len(content))
        listed += struct.pack(f"<{array.ndim}Q", *array.shape)
        content += array.tobytes()
    file.write(listed + content)
