"""Meshes and other arrays in NumPy archives (.npz): kept as they are, to the bit."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.files import naming, read_file
from wrt.formats import growth
from wrt.formats.npy import read_archive
from wrt.mesh import Mesh


def read_arrays(file: Path, *, required: Iterable[str], optional: Iterable[str] = ()) -> dict[str, NDArray[Any]]:
    """Return arrays of an archive by name.

    Raises:
        InputError: where there is no such file, it is damaged, or a required array is not in it.
    """
    data = read_file(file)
    try:
        found = read_archive(data, (*required, *optional))
    except InputError as error:
        raise InputError(f"{file}: not a NumPy archive, or damaged ({error})") from None
    growth.take(growth.MESHES, sum(array.nbytes for array in found.values()))
    for name in required:
        if name not in found:
            raise InputError(f"{file}: there is no array {name!r} in it")
    return found


def read_mesh_arrays(file: Path) -> Mesh:
    """Return the mesh of the arrays `vertices` and `faces`, and of `normals`, `uvs` and `colors` if they are there.

    Raises:
        InputError: where they are no mesh.
    """
    arrays = read_arrays(file, required=("vertices", "faces"), optional=("normals", "uvs", "colors"))
    with naming(file):
        return Mesh.taking(**arrays, name=file.name)
