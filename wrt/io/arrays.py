"""Read meshes and other arrays from NumPy archives (.npz), unchanged to the bit."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.io import memory_limits
from wrt.io.npy import read_archive
from wrt.io.safe_read import naming_file, read_file
from wrt.scene.exact.analytic import Analytic, stored_in
from wrt.scene.exact.quadrics import Quadrics
from wrt.scene.exact.spheres import Spheres, spheres
from wrt.scene.mesh import Mesh


def read_arrays(file: Path, *, required: Iterable[str], optional: Iterable[str] = ()) -> dict[str, NDArray[Any]]:
    """Return arrays of an archive by name.

    Raises:
        InputError: when the file does not exist, is damaged, or lacks a required array.
    """
    data = read_file(file)
    try:
        found = read_archive(data, (*required, *optional))
    except InputError as error:
        raise InputError(f"{file}: not a NumPy archive, or damaged ({error})") from None
    memory_limits.take(memory_limits.MESHES, sum(array.nbytes for array in found.values()))
    for name in required:
        if name not in found:
            raise InputError(f"{file}: there is no array {name!r} in it")
    return found


def read_mesh_arrays(file: Path) -> Mesh:
    """Return the mesh of the arrays `vertices` and `faces`, with `normals`, `uvs` and `colors` if present.

    Raises:
        InputError: when the arrays do not form a mesh.
    """
    arrays = read_arrays(file, required=("vertices", "faces"), optional=("normals", "uvs", "colors"))
    with naming_file(file):
        return Mesh.taking(**arrays, name=file.name)


def read_spheres(file: Path) -> Spheres:
    """Return the spheres of the arrays `centers` and `radii`, with `colors` if present, or of `arrays_of_exact`.

    Raises:
        InputError: when the arrays do not form spheres.
    """
    arrays = read_arrays(file, required=(), optional=("centers", "radii", "colors", "boxes", "axes"))
    colors = arrays.get("colors")
    with naming_file(file):
        if {"boxes", "axes"} <= set(arrays):
            return stored_in(Spheres, arrays["boxes"], arrays["axes"], colors, file.name)
        for name in ("centers", "radii"):
            if name not in arrays:
                raise InputError(f"there is no array {name!r} in it")
        return spheres(arrays["centers"], arrays["radii"], colors=colors, name=file.name)


def read_quadrics(file: Path) -> Quadrics:
    """Return the disks and cylinders of `arrays_of_exact`.

    Raises:
        InputError: when the arrays do not form disks or cylinders.
    """
    arrays = read_arrays(file, required=("boxes", "axes"), optional=("colors",))
    with naming_file(file):
        return stored_in(Quadrics, arrays["boxes"], arrays["axes"], arrays.get("colors"), file.name)


def arrays_of_exact(mesh: Analytic) -> dict[str, NDArray[Any]]:
    """Return the arrays from which `read_spheres` or `read_quadrics` makes the same shapes, bit for bit."""
    assert mesh.normals is not None
    arrays = {"boxes": mesh.vertices.reshape(-1, 3, 3)[:, :2], "axes": mesh.normals.reshape(-1, 3, 3)}
    return arrays if mesh.colors is None else {**arrays, "colors": mesh.colors[::3]}
