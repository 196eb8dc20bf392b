"""Meshes and other arrays in NumPy archives (.npz): kept as they are, to the bit."""

from __future__ import annotations

import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.files import first_line
from wrt.mesh import Mesh

# What reading an archive raises when bytes of it are wrong, as in wrt/checkpoint.py.
_DAMAGE = (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, TypeError, RuntimeError, AttributeError)


def read_arrays(file: Path, *, required: Iterable[str], optional: Iterable[str] = ()) -> dict[str, NDArray[Any]]:
    """Return arrays of an archive by name.

    Raises:
        InputError: where there is no such file, it is damaged, or a required array is not in it.
    """
    try:
        with file.open("rb") as handle, np.load(handle, allow_pickle=False) as archive:
            found = {name: archive[name] for name in (*required, *optional) if name in archive.files}
    except FileNotFoundError:
        raise InputError(f"{file}: no such file") from None
    except _DAMAGE as error:
        raise InputError(f"{file}: not a NumPy archive, or damaged ({first_line(error)})") from None
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
    try:
        return Mesh(**arrays, name=file.name)
    except InputError as error:
        raise InputError(f"{file}: {error}") from None
