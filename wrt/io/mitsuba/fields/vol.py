"""Read Mitsuba's volume files (.vol): a grid of numbers.

Format: documentation of Mitsuba 3, plugin `gridvolume`: "VOL", the version 3, then as little-endian int32 the encoding
(1 for float32), the counts along x, y and z and the number of channels, as float32 the bounds, and then the values,
channels first, then x, y and z.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.io import memory_limits
from wrt.io.safe_read import read_file

_HEADER = 48


def read_vol(path: Path) -> NDArray[np.float32]:
    """Return the (z, y, x, channels) values of a volume file.

    Raises:
        InputError: when it cannot be read.
    """
    data = read_file(path)
    if len(data) < _HEADER or data[:3] != b"VOL" or data[3] != 3:
        raise InputError(f"{path.name}: not a volume file of version 3")
    encoding, x, y, z, channels = np.frombuffer(data, "<i4", 5, 4).tolist()
    if encoding != 1:
        raise InputError(f"{path.name}: only volume files of float32 can be read")
    if min(x, y, z, channels) < 1:
        raise InputError(f"{path.name}: its size is {x} x {y} x {z} x {channels}")
    count = x * y * z * channels
    if len(data) < _HEADER + 4 * count:
        raise InputError(
            f"{path.name}: {len(data) - _HEADER} of {4 * count} bytes of values are there; it is truncated"
        )
    memory_limits.take(memory_limits.MESHES, 4 * count)
    values = np.frombuffer(data, "<f4", count, _HEADER).reshape(z, y, x, channels).astype(np.float32)
    if not np.isfinite(values).all():
        raise InputError(f"{path.name}: its values must be finite")
    return values
