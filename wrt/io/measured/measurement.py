"""Files of the RGL material database (.bsdf): measured reflectances, as colours or as spectra.

Content: Dupuy and Jakob 2018, and the plugin `measured` of Mitsuba 3. Spectra are seen under D65, as all reflectances
that wrt reads from Mitsuba's files.

Format: Mitsuba 3, `mitsuba/python/tensor_io.py`: "tensor_file", a zero byte, the version 1.0, and the number of fields;
for each field its name, number of dimensions, type, offset in the file, and shape; then the arrays. All little-endian.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.io import memory_limits
from wrt.io.measured.observer import REFLECTANCE_RESPONSE, WAVELENGTHS
from wrt.io.safe_read import PathLike, naming_file, read_file
from wrt.linalg import product
from wrt.scene.materials.measured import Measurement
from wrt.values import sealed

_TABLES = ("phi_i", "theta_i", "ndf", "sigma", "vndf", "luminance")
_POLARIZED = ("theta_h", "theta_d", "phi_d", "M")

_MAGIC = b"tensor_file\0"
_VERSION = (1, 0)
_TYPES = (None, "<u1", "<i1", "<u2", "<i2", "<u4", "<i4", "<u8", "<i8", "<f2", "<f4", "<f8")
"""NumPy's names of the types, by their numbers in files."""

_MOST_DIMENSIONS = 16
_LONGEST = 2**40
_ALIGNMENT = 8


@memory_limits.one_load()
def load_measurement(path: PathLike) -> Measurement:
    """Return a measured reflectance from a file of the RGL material database.

    A file of spectra becomes linear Rec. 709 as seen under D65. Colours outside of that space are clipped at 0.

    Args:
        path: a file of colours (`..._rgb.bsdf`) or of spectra (`..._spec.bsdf`).

    Raises:
        InputError: when it cannot be read, lacks an array, or holds numbers that cannot be used.
    """
    file = Path(path)
    data = read_file(file)
    with naming_file(file):
        return _measurement(read_tensors(data), file.name)


def _measurement(fields: dict[str, NDArray[Any]], name: str) -> Measurement:
    if all(key in fields for key in _POLARIZED):
        raise InputError("holds Mueller matrices of a polarised measurement, which are not supported")
    content = "spectra" if "wavelengths" in fields else "rgb"
    names = (*_TABLES, content)
    if missing := [key for key in names if key not in fields]:
        raise InputError(f"is no measured reflectance: it lacks {', '.join(map(repr, missing))}")
    for key in names:
        if fields[key].dtype != np.float32:
            raise InputError(f"{key!r} must be of float32 numbers, not {fields[key].dtype}")
    values = fields[content]
    if values.ndim != 5 or values.size == 0:
        raise InputError(f"{content!r} must have five dimensions, not the shape {values.shape}")
    if not np.isfinite(values).all():
        raise InputError(f"{content!r} has values that are not finite")
    rgb = values if content == "rgb" else _colors(values, fields["wavelengths"])
    tables = {key: sealed(fields[key].copy()) for key in _TABLES}
    has_jacobian = "jacobian" not in fields or bool(fields["jacobian"].any())
    return Measurement(**tables, rgb=sealed(np.maximum(rgb, np.float32(0.0))), jacobian=has_jacobian, name=name)


def _colors(spectra: NDArray[np.float32], wavelengths: NDArray[Any]) -> NDArray[np.float32]:
    """Return (P, T, 3, N, N) linear Rec. 709 of (P, T, L, N, N) spectra, linear between their wavelengths, nm."""
    if wavelengths.shape != spectra.shape[2:3]:
        raise InputError(f"'wavelengths' must be {spectra.shape[2]} numbers, not of the shape {wavelengths.shape}")
    nodes = wavelengths.astype(np.float64)
    if not np.isfinite(nodes).all() or (np.diff(nodes) <= 0.0).any():
        raise InputError("'wavelengths' must ascend")
    shares = np.stack([np.interp(WAVELENGTHS, nodes, row) for row in np.eye(len(nodes))])
    weights = product(shares, REFLECTANCE_RESPONSE)
    rgb = np.empty((*spectra.shape[:2], 3, *spectra.shape[3:]), np.float32)
    for place in np.ndindex(*spectra.shape[:2]):  # a slice at a time: in double precision all may not fit in memory
        rgb[place] = np.einsum("lc,l...->c...", weights, spectra[place].astype(np.float64))
    return rgb


def save_measurement(file: BinaryIO, measurement: Measurement) -> None:
    """Write a measurement as a file of colours, which `load_measurement` reads back bit for bit."""
    text = np.frombuffer(measurement.name.encode(), np.uint8)
    tables = {key: getattr(measurement, key) for key in (*_TABLES, "rgb")}
    jacobian = np.array([measurement.jacobian], np.uint8)
    write_tensors(file, {"description": text, **tables, "jacobian": jacobian})


# --- Files of tensors --------------------------------------------------------------------------------


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
    """Write arrays of numbers by name as a tensor file, at the beginning of an open file."""
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
