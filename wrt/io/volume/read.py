"""Read volumes from files: NumPy arrays, Mitsuba's `.vol`, and NanoVDB.

Format of `.vol`: the documentation of Mitsuba 3, plugin `gridvolume`: "VOL", version 3, the encoding, numbers of cells
along x, y and z, the number of channels, a bounding box, then float32 numbers, channels first, then x, y and z.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.io import memory_limits
from wrt.io.npy import read_archive, read_array
from wrt.io.safe_read import PathLike, naming_file, read_file
from wrt.io.volume.nanovdb import chosen_name, read_nanovdb
from wrt.scene.medium import DensityGrid

SUFFIXES = (".npy", ".npz", ".vol", ".nvdb")
_PLACES = ("lower", "upper", "transform")
_FACTORS = ("albedo", "emission")

_VOL_HEADER = struct.Struct("<3sB5i6f")
_VOL_VERSION, _FLOAT32 = 3, 1


@dataclass(frozen=True)
class Volume:
    """Values in a box.

    Attributes:
        values: (nz, ny, nx) numbers or (nz, ny, nx, 3) colours at the centres of cells.
        places: `lower`, `upper` and `transform` of the box, as a DensityGrid takes them, where the file has them.
        factors: `albedo` and `emission`, where the file has them.
    """

    values: NDArray[Any]
    places: dict[str, Any] = field(default_factory=dict)
    factors: dict[str, NDArray[Any]] = field(default_factory=dict)


def read_volume(file: Path, grid: str | None = None) -> Volume:
    """Return the values of a file, and where they are; `grid` is the name of one of several arrays or grids in it.

    Raises:
        InputError: when it cannot be read, or would take too much memory.
    """
    suffix = file.suffix.lower()
    if suffix == ".vdb":
        raise InputError(
            f"{file}: OpenVDB files cannot be read; convert it to NanoVDB, as OpenVDB's nanovdb_convert does: "
            f"nanovdb_convert {file.name} {file.stem}.nvdb"
        )
    if suffix not in SUFFIXES:
        raise InputError(f"{file}: a volume must be a file of {', '.join(SUFFIXES)}")
    data = read_file(file)
    with naming_file(file):
        if suffix == ".nvdb":
            return Volume(*read_nanovdb(data, grid))
        if suffix == ".npz":
            return _of_archive(read_archive(data), grid)
        if grid is not None:
            raise InputError(f"holds one grid alone, without a name; leave grid = {grid!r} out")
        if suffix == ".vol":
            return _of_vol(data)
        values = read_array(data)
        memory_limits.take(memory_limits.VOLUMES, 4 * values.size)
        return Volume(values)


@memory_limits.one_load()
def load_density(path: PathLike, *, grid: str | None = None, **arguments: Any) -> DensityGrid:
    """Return a file as the density of a medium.

    NumPy arrays (.npy) are (nz, ny, nx). Archives (.npz) hold `density`, and may hold any other array that DensityGrid
    takes. Mitsuba's volumes (.vol) and NanoVDB (.nvdb) say where their box is.

    Args:
        path: ends in .npy, .npz, .vol or .nvdb.
        grid: name of the array or grid in a file of several; None for "density", or the only one.
        arguments: those of `DensityGrid`, in place of those in the file. With a lower or upper corner the file's place
            does not count.

    Raises:
        InputError: when it cannot be read, or would take too much memory.
    """
    file = Path(path)
    volume = read_volume(file, grid)
    places = {} if {"lower", "upper"} & set(arguments) else volume.places
    with naming_file(file):
        return DensityGrid(volume.values, **{**places, **volume.factors, **arguments}, name=file.name)


def _of_archive(arrays: dict[str, NDArray[Any]], grid: str | None) -> Volume:
    """Return the volume of an archive of arrays."""
    names = [name for name in arrays if name not in (*_PLACES, *_FACTORS)]
    name = chosen_name(names, grid)
    if name not in arrays:
        raise InputError(f"there is no array {grid or 'density'!r} in it, but {', '.join(map(repr, arrays)) or 'none'}")
    memory_limits.take(memory_limits.VOLUMES, sum(4 * array.size for array in arrays.values()))
    return Volume(
        arrays[name],
        {name: arrays[name] for name in _PLACES if name in arrays},
        {name: arrays[name] for name in _FACTORS if name in arrays},
    )


def _of_vol(data: bytes) -> Volume:
    """Return the values of a .vol file, and its bounding box."""
    if len(data) < _VOL_HEADER.size or data[:3] != b"VOL":
        raise InputError("not a grid volume of Mitsuba: it must begin with 'VOL'")
    _, version, encoding, nx, ny, nz, channels, *box = _VOL_HEADER.unpack_from(data)
    if version != _VOL_VERSION or encoding != _FLOAT32:
        raise InputError(f"version {version} with encoding {encoding}; only version 3 with float32 numbers can be read")
    if min(nx, ny, nz) < 1 or channels not in (1, 3):
        raise InputError(f"{nx} x {ny} x {nz} cells of {channels} channels; there must be cells of 1 or 3 channels")
    size = math.prod((nx, ny, nz, channels)) * 4
    if len(data) - _VOL_HEADER.size < size:
        raise InputError(f"{nx} x {ny} x {nz} cells of {channels} channels take {size} bytes, but it is shorter")
    memory_limits.take(memory_limits.VOLUMES, size)
    values = np.frombuffer(data, "<f4", size // 4, _VOL_HEADER.size)
    shape = (nz, ny, nx) if channels == 1 else (nz, ny, nx, channels)
    return Volume(values.reshape(shape), {"lower": tuple(box[:3]), "upper": tuple(box[3:])})
