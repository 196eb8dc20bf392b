"""Limits on the memory that a load may take, relative to the size of its files.

A small file can expand to more than the memory of a machine: images are compressed, and scenes can use one file or one
shape many times. Each is legitimate on its own, so the memory of each kind of content is summed over all files of one
load and compared with their total size.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from wrt.errors import InputError
from wrt.io.safe_read import LOAD, Load

if TYPE_CHECKING:
    from wrt.scene.mesh import Mesh


@dataclass(frozen=True)
class Limit:
    """How many bytes of memory one kind of content may take.

    Attributes:
        what: the content, for messages.
        free: bytes that a load may take regardless of the size of its files.
        per_byte: additional bytes for each byte of its files.
    """

    what: str
    free: int
    per_byte: int


IMAGES = Limit("images", 2**29, 512)
"""32 million pixels, such as 8192x4096, plus 32 pixels for each byte of the files. Photographs have 1 to 15 pixels a
byte in any format; an image of one colour has 40 as JPEG, and thousands in other formats."""

MESHES = Limit("meshes", 2**28, 128)
"""A mesh takes up to ten times the size of its file; the rest allows for copies. Many primitives of a glTF file may
share one large array of vertices, and each gets a copy."""

SHAPES = Limit("shapes", 2**28, 256)
"""65,000 shapes, plus one for each 16 bytes of the files: a shape takes about 100 bytes of a file, an instance 50."""

MADE = Limit("spheres and other round shapes", 2**28, 256)
"""10 million triangles. A sphere far from the camera has 4,000, a near one five times as many."""

UNPACKED = Limit("unpacked files", 2**28, 64)
"""Text of meshes shrinks to a tenth when it is compressed; files of one value, to a thousandth."""

TEXT = Limit("XML elements and texts", 2**26, 128)
"""The shortest element has 4 bytes in the file and takes 300 in memory."""

COMPOSED = Limit("USD layers and prims", 2**27, 512)
"""130,000 prims, plus one for each two bytes of the files: Pixar's library takes 1 kB for a prim, and 20 us."""

VOLUMES = Limit("volumes", 2**28, 128)
"""67 million numbers, such as 400 x 400 x 400, plus 32 for each byte of the files: sparse files are small for their
box."""

BYTES_PER_PIXEL = 16  # memory of a decoded pixel: the decoder's own copy, and three float32 numbers

BYTES_PER_SHAPE = 4096
"""Counted per shape, without its mesh. A shape takes less, but this bounds the time of a load without files to 2 s."""

BYTES_PER_ELEMENT = 2**14  # counted for a shape from an XML element, for the same reason: each takes 0.3 ms to load

STEPS = Limit("steps", 200_000_000, 64)
"""Steps of superlinear work, such as triangulating concave polygons, which is then cut short: a few seconds, plus about
as many as concave polygons of a few corners take."""


@contextmanager
def one_load() -> Iterator[None]:
    """Count everything that is read within the context, or the function that it decorates, as one load.

    A nested context belongs to the outer one.
    """
    if LOAD.get() is not None:
        yield
        return
    token = LOAD.set(Load())
    try:
        yield
    finally:
        LOAD.reset(token)


def counted(data: bytes) -> bytes:
    """Return the content of an input that is not a file, counted like one."""
    load = LOAD.get()
    if load is not None:
        load.size += len(data)
    return data


def size_of_files() -> int:
    """Return the bytes of the files that this load has read."""
    load = LOAD.get()
    return 0 if load is None else load.size


def most(limit: Limit) -> int:
    """Return how many bytes of memory one kind of content may take, for the files that have been read so far."""
    return limit.free + limit.per_byte * size_of_files()


def remaining(limit: Limit) -> int:
    """Return how many bytes of memory, or steps, one kind of content may still take."""
    load = LOAD.get()
    return most(limit) - (0 if load is None else load.counts[limit])


def require(limit: Limit, size: int) -> None:
    """Raise InputError if `size` more bytes of a kind of content exceed the limit."""
    load = LOAD.get()
    if load is not None and size > remaining(limit):
        raise InputError(
            f"its {limit.what} would take {_amount(load.counts[limit] + size)}; for files of {_amount(load.size)} the "
            f"limit is {_amount(most(limit))} ({_amount(limit.free)} plus {limit.per_byte} times the file size)"
        )


def count(limit: Limit, size: int) -> None:
    """Count `size` more bytes, or steps, without a check."""
    load = LOAD.get()
    if load is not None:
        load.counts[limit] += size


def take(limit: Limit, size: int) -> None:
    """Count `size` more bytes of memory, or raise InputError if they exceed the limit."""
    require(limit, size)
    count(limit, size)


def size_of(mesh: Mesh) -> int:
    """Return the bytes that the arrays of a mesh take."""
    arrays = (mesh.vertices, mesh.faces, mesh.normals, mesh.uvs, mesh.colors, mesh.tangents, mesh.sides)
    return sum(array.nbytes for array in arrays if array is not None)


def _amount(size: int) -> str:
    for unit, factor in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size >= factor:
            return f"{size / factor:.3g} {unit}"
    return f"{size} bytes"
