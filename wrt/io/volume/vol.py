"""Mitsuba's grid volumes (.vol).

Format: the documentation of Mitsuba 3, plugin `gridvolume`: "VOL", version 3, the encoding, numbers of cells along x,
y and z, the number of channels, a bounding box, then float32 numbers, channels first, then x, y and z.
"""

from __future__ import annotations

import math
import struct

import numpy as np

from wrt.errors import InputError
from wrt.io.volume.volume import Volume, take_memory

_HEADER = struct.Struct("<3sB5i6f")
_VERSION, _FLOAT32 = 3, 1


def read_vol(data: bytes) -> Volume:
    """Return the values of a .vol file, and its bounding box.

    Args:
        data: the whole file.

    Raises:
        InputError: when it is damaged, or holds something other than float32 numbers or colours.
    """
    if len(data) < _HEADER.size or data[:3] != b"VOL":
        raise InputError("not a grid volume of Mitsuba: it must begin with 'VOL'")
    _, version, encoding, nx, ny, nz, channels, *box = _HEADER.unpack_from(data)
    if version != _VERSION or encoding != _FLOAT32:
        raise InputError(f"version {version} with encoding {encoding}; only version 3 with float32 numbers can be read")
    if min(nx, ny, nz) < 1 or channels not in (1, 3):
        raise InputError(f"{nx} x {ny} x {nz} cells of {channels} channels; there must be cells of 1 or 3 channels")
    size = math.prod((nx, ny, nz, channels)) * 4
    if len(data) - _HEADER.size < size:
        raise InputError(f"{nx} x {ny} x {nz} cells of {channels} channels take {size} bytes, but it is shorter")
    take_memory(nx * ny * nz, channels)
    values = np.frombuffer(data, "<f4", size // 4, _HEADER.size)
    shape = (nz, ny, nx) if channels == 1 else (nz, ny, nx, channels)
    return Volume(values.reshape(shape), {"lower": tuple(box[:3]), "upper": tuple(box[3:])})
