"""Limits on the memory that a load may take, relative to the size of its files.

A small file can expand to more than the memory of a machine: images are compressed, and scenes can use one file or one
shape many times. Each is legitimate on its own, so the memory of each kind of content is summed over all files of one
load and compared with their total size.
"""

from __future__ import annotations

import contextvars
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from wrt.errors import InputError
from wrt.io.safe_read import counting_sizes

if TYPE_CHECKING:
    from wrt.scene.mesh import Mesh


@dataclass(frozen=True)
class Limit:
    """How many bytes of memory one kind of content may take.

    Attributes:
        what: the content, for messages.
        free: bytes that a load may take whatever the size of its files.
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

MADE = Limit("spheres and other round shapes", 2**29, 256)
"""19 million triangles. A sphere far from the camera has 4,000, a near one five times as many."""

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

PATIENCE = 200_000_000
"""Steps that a load may spend on superlinear work, such as triangulating concave polygons: a few seconds."""

PATIENCE_PER_BYTE = 64
"""Additional steps for each byte of the files: concave polygons of a few corners take about as many."""


@dataclass
class _Load:
    """The files and the memory of a load so far.

    Attributes:
        sizes: bytes of each file; a file counts once, even under different paths.
        made: bytes of memory counted against each limit.
        patience: see `patience`.
        counted: the number of files and their bytes when they were last summed.
    """

    sizes: dict[str, int]
    made: dict[Limit, int] = field(default_factory=dict)
    patience: int = PATIENCE
    counted: tuple[int, int] = (0, 0)

    @property
    def size(self) -> int:
        """Total bytes of the files."""
        if len(self.sizes) != self.counted[0]:  # summing at every call would be quadratic in the files
            self.counted = len(self.sizes), sum(self.sizes.values())
        return self.counted[1]


_LOAD: contextvars.ContextVar[_Load | None] = contextvars.ContextVar("wrt_load", default=None)


@contextmanager
def one_load() -> Iterator[None]:
    """Count everything that is read within the context, or the function that it decorates, as one load.

    A nested context belongs to the outer one.
    """
    if _LOAD.get() is not None:
        yield
        return
    with counting_sizes() as sizes:
        token = _LOAD.set(_Load(sizes))
        try:
            yield
        finally:
            _LOAD.reset(token)


def size_of_files() -> int:
    """Return the bytes of the files that this load has read."""
    load = _LOAD.get()
    return 0 if load is None else load.size


def most(limit: Limit) -> int:
    """Return how many bytes of memory one kind of content may take, for the files that have been read so far."""
    return limit.free + limit.per_byte * size_of_files()


def require(limit: Limit, size: int) -> int:
    """Return the memory of a kind of content with `size` more bytes, or raise InputError if it exceeds the limit."""
    load = _LOAD.get()
    if load is None:
        return size  # the arrays come from memory, not from files
    total = load.made.get(limit, 0) + size
    if total > most(limit):
        raise InputError(
            f"its {limit.what} would take {_amount(total)}; for files of {_amount(load.size)} the limit is "
            f"{_amount(most(limit))} ({_amount(limit.free)} plus {limit.per_byte} times the file size)"
        )
    return total


def take(limit: Limit, size: int) -> None:
    """Count `size` more bytes of memory, or raise InputError if they exceed the limit."""
    total = require(limit, size)
    load = _LOAD.get()
    if load is not None:
        load.made[limit] = total


def patience() -> int:
    """Return the remaining steps of PATIENCE, for work that can be cut short."""
    load = _LOAD.get()
    return PATIENCE if load is None else load.patience + PATIENCE_PER_BYTE * load.size


def spend(steps: int) -> None:
    """Subtract steps from the patience of this load."""
    load = _LOAD.get()
    if load is not None:
        load.patience -= steps


def size_of(mesh: Mesh) -> int:
    """Return the bytes that the arrays of a mesh take."""
    arrays = (mesh.vertices, mesh.faces, mesh.normals, mesh.uvs, mesh.colors)
    return sum(array.nbytes for array in arrays if array is not None)


def _amount(size: int) -> str:
    for unit, factor in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size >= factor:
            return f"{size / factor:.3g} {unit}"
    return f"{size} bytes"
