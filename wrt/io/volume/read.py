"""Read volumes from files, by their suffix."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.io import memory_limits
from wrt.io.npy import read_archive, read_array
from wrt.io.safe_read import PathLike, naming_file, read_file
from wrt.io.volume.nanovdb import read_nanovdb
from wrt.io.volume.vol import read_vol
from wrt.io.volume.volume import Volume, take_memory
from wrt.scene.medium import DensityGrid

SUFFIXES = (".npy", ".npz", ".vol", ".nvdb")
_PLACES = ("lower", "upper", "transform")
_OTHERS = ("albedo", "emission")


def read_volume(file: Path, grid: str | None = None) -> Volume:
    """Return the values of a file, and where they are.

    Args:
        file: ends in one of SUFFIXES.
        grid: name of the array or the grid, in files that hold several; None for "density", or the only one.

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
            return read_nanovdb(data, grid)
        if suffix == ".npz":
            return _of_archive(read_archive(data), grid)
        if grid is not None:
            raise InputError(f"holds one grid alone, without a name; leave grid = {grid!r} out")
        if suffix == ".vol":
            return read_vol(data)
        values = read_array(data)
        take_memory(values.size)
        return Volume(values)


@memory_limits.one_load()
def load_density(path: PathLike, *, grid: str | None = None, **given: Any) -> DensityGrid:
    """Return a file as the density of a medium.

    NumPy arrays (.npy) are (nz, ny, nx). Archives (.npz) hold `density`, and may hold any other array that DensityGrid
    takes. Mitsuba's volumes (.vol) and NanoVDB (.nvdb) say where their box is.

    Args:
        path: ends in .npy, .npz, .vol or .nvdb.
        grid: name of the array or grid in a file of several; None for "density", or the only one.
        given: arguments of DensityGrid, in place of those in the file. With a `lower` or `upper` corner, nothing of
            the place in the file counts.

    Raises:
        InputError: when it cannot be read, or would take too much memory.
    """
    file = Path(path)
    volume = read_volume(file, grid)
    places = {} if {"lower", "upper"} & set(given) else volume.places
    with naming_file(file):
        return DensityGrid(volume.values, **{**places, **volume.others, **given}, name=file.name)


def _of_archive(arrays: dict[str, NDArray[Any]], grid: str | None) -> Volume:
    """Return the volume of an archive of arrays."""
    names = [name for name in arrays if name not in (*_PLACES, *_OTHERS)]
    wanted = grid if grid is not None else "density" if "density" in names else names[0] if len(names) == 1 else None
    if wanted not in arrays:
        raise InputError(f"there is no array {grid or 'density'!r} in it, but {', '.join(map(repr, arrays)) or 'none'}")
    take_memory(sum(array.size for array in arrays.values()))
    return Volume(
        arrays[wanted],
        {name: arrays[name] for name in _PLACES if name in arrays},
        {name: arrays[name] for name in _OTHERS if name in arrays},
    )
