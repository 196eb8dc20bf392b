"""NumPy array files. The size of an array is checked before memory is allocated for it.

Format: NumPy Enhancement Proposal 1, "A simple file format for NumPy arrays", 2007.
"""

from __future__ import annotations

import io
import math
import struct
import warnings
import zlib
from collections.abc import Collection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.io.safe_read import first_line

# Exceptions from damaged archives besides zipfile's own. RuntimeError stands for encryption, and its subclass
# NotImplementedError for unknown compression.
_DAMAGE = (OSError, ValueError, KeyError, EOFError, TypeError, RuntimeError, zlib.error, struct.error)

_SMALL, _GAIN = 2**28, 20
"""An archive may expand to this many bytes, or to this many times its size if that is more."""


def read_archive(data: bytes, names: Collection[str] | None = None) -> dict[str, NDArray[Any]]:
    """Return arrays of an archive (.npz) by name.

    Args:
        data: the whole file.
        names: the arrays to read, where present; None reads all.

    Raises:
        InputError: when it is not an archive, is damaged, or expands to far more than its size.
    """
    import zipfile

    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            entries = {entry.filename.removesuffix(".npy"): entry for entry in archive.infolist()}
            wanted = {name: entry for name, entry in entries.items() if names is None or name in names}
            total, most = sum(entry.file_size for entry in wanted.values()), max(_SMALL, _GAIN * len(data))
            if total > most:
                raise InputError(
                    f"its content, {total} bytes, is many times larger than the file; the limit is {most} bytes, "
                    f"the larger of {_SMALL} and {_GAIN} times the file size"
                )
            return {name: read_array(archive.read(entry)) for name, entry in wanted.items()}
    except (*_DAMAGE, zipfile.BadZipFile) as error:
        raise InputError(first_line(error)) from None


def read_array(data: bytes) -> NDArray[Any]:
    """Return the array of numbers or text in an .npy file.

    Args:
        data: the whole file.

    Raises:
        InputError: when it is no array, its length contradicts its header, or it holds Python objects.
    """
    file = io.BytesIO(data)
    readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about headers that Python 2 wrote
            version = np.lib.format.read_magic(file)
            if version not in readers:
                raise InputError(f"an array in version {version[0]}.{version[1]} of the format, which is not supported")
            shape, by_columns, dtype = readers[version](file)
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001 - the header is a Python literal, which can be malformed in many ways
        raise InputError(f"not a NumPy file: {first_line(error)}") from None
    if dtype.kind not in "biufU":
        raise InputError(f"an array must hold numbers, not {dtype}")
    rest = memoryview(data)[file.tell() :]
    size = math.prod(shape) * dtype.itemsize
    if any(not 0 <= n < 2**40 for n in shape) or len(rest) != size:
        raise InputError(f"an array of {shape} {dtype} takes {size} bytes, but the file has {len(rest)}")
    return np.ndarray(shape, dtype, bytearray(rest), order="F" if by_columns else "C")
