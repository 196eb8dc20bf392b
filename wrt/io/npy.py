"""NumPy files of arrays, and the meshes of their archives. Sizes are checked before memory is allocated.

Format: NumPy Enhancement Proposal 1, "A simple file format for NumPy arrays", 2007.
"""

from __future__ import annotations

import io
import math
import struct
import warnings
import zlib
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.io import memory_limits
from wrt.io.safe_read import first_line, naming_file, read_file

if TYPE_CHECKING:
    from wrt.scene.exact.analytic import Analytic
    from wrt.scene.mesh import Mesh

# Exceptions from damaged archives besides zipfile's own. RuntimeError stands for encryption, and its subclass
# NotImplementedError for unknown compression.
_DAMAGE = (OSError, ValueError, KeyError, EOFError, TypeError, RuntimeError, zlib.error, struct.error)

_SMALL, _GAIN = 2**28, 20  # an archive may expand to this many bytes, or to this many times its size if that is more


def read_archive(data: bytes, names: Collection[str] | None = None) -> dict[str, NDArray[Any]]:
    """Return arrays of an archive (.npz) by name: those of `names` that it has, or all."""
    import zipfile

    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            entries = {entry.filename.removesuffix(".npy"): entry for entry in archive.infolist()}
            entries = {name: entry for name, entry in entries.items() if names is None or name in names}
            total, most = sum(entry.file_size for entry in entries.values()), max(_SMALL, _GAIN * len(data))
            if total > most:
                raise InputError(
                    f"its content, {total} bytes, is many times larger than the file; the limit is {most} bytes, "
                    f"the larger of {_SMALL} and {_GAIN} times the file size"
                )
            return {name: read_array(archive.read(entry)) for name, entry in entries.items()}
    except (*_DAMAGE, zipfile.BadZipFile) as error:
        raise InputError(first_line(error)) from None


def read_array(data: bytes) -> NDArray[Any]:
    """Return the array of numbers or text in the data of an .npy file."""
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
    content = memoryview(data)[file.tell() :]
    size = math.prod(shape) * dtype.itemsize
    if any(not 0 <= n < 2**40 for n in shape) or len(content) != size:
        raise InputError(f"an array of {shape} {dtype} takes {size} bytes, but the file has {len(content)}")
    return np.ndarray(shape, dtype, bytearray(content), order="F" if by_columns else "C")


# --- Meshes ----------------------------------------------------------------------------------------


def read_arrays(file: Path, required: Iterable[str], optional: Iterable[str] = ()) -> dict[str, NDArray[Any]]:
    """Return arrays of an archive by name."""
    data = read_file(file)
    try:
        arrays = read_archive(data, (*required, *optional))
    except InputError as error:
        raise InputError(f"{file}: not a NumPy archive, or damaged ({error})") from None
    memory_limits.take(memory_limits.MESHES, sum(array.nbytes for array in arrays.values()))
    for name in required:
        if name not in arrays:
            raise InputError(f"{file}: there is no array {name!r} in it")
    return arrays


def read_mesh_arrays(file: Path) -> Mesh:
    """Return the mesh of `vertices` and `faces`, with `sides` and those of VERTEX_ATTRIBUTES that are present."""
    from wrt.scene.mesh import VERTEX_ATTRIBUTES, Mesh

    arrays = read_arrays(file, ("vertices", "faces"), (*VERTEX_ATTRIBUTES, "sides"))
    with naming_file(file):
        return Mesh.taking(**arrays, name=file.name)


def read_exact(file: Path, cls: type[Analytic]) -> Analytic:
    """Return the exact shapes of `arrays_of_exact`, or spheres of `centers` and `radii`, with `colors` if present."""
    from wrt.scene.exact.analytic import stored_in
    from wrt.scene.exact.spheres import Spheres, spheres

    arrays = read_arrays(file, (), ("centers", "radii", "colors", "boxes", "axes"))
    is_stored = cls is not Spheres or {"boxes", "axes"} <= set(arrays)
    for name in ("boxes", "axes") if is_stored else ("centers", "radii"):
        if name not in arrays:
            raise InputError(f"{file}: there is no array {name!r} in it")
    with naming_file(file):
        if is_stored:
            return stored_in(cls, arrays["boxes"], arrays["axes"], arrays.get("colors"), file.name)
        return spheres(arrays["centers"], arrays["radii"], colors=arrays.get("colors"), name=file.name)


def arrays_of_exact(mesh: Analytic) -> dict[str, NDArray[Any]]:
    """Return the arrays from which `read_exact` makes the same shapes, bit for bit."""
    assert mesh.normals is not None
    arrays = {"boxes": mesh.vertices.reshape(-1, 3, 3)[:, :2], "axes": mesh.normals.reshape(-1, 3, 3)}
    return arrays if mesh.colors is None else {**arrays, "colors": mesh.colors[::3]}
