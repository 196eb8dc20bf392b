"""How much more a file may become in memory than it is on the disk: few bytes can stand for more than a machine holds.

Images are compressed, scenes name one file many times and put one shape into many places. Each of these is honest, and
nobody can tell by one of them where it ends. So what is made is counted, over all files of one load, and held against
their size.
"""

from __future__ import annotations

import contextvars
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from wrt.errors import InputError
from wrt.files import counting_sizes
from wrt.mesh import Mesh


@dataclass(frozen=True)
class Limit:
    """How many bytes of memory one kind of content may take.

    Attributes:
        what: the content, for messages.
        free: bytes that a load may take whatever the size of its files.
        per_byte: bytes more for each byte of its files.
    """

    what: str
    free: int
    per_byte: int


IMAGES = Limit("images", 2**29, 512)
"""32 million pixels, such as 8192x4096, of any file; beyond, 32 for each byte of the files. Photographs have 1 to 15 a
byte, whatever the format; a picture of one colour has 40 as JPEG, and thousands in other formats."""

MESHES = Limit("meshes", 2**28, 128)
"""A mesh that is written out takes up to ten times its file; the rest is for copies of it. In glTF files many
primitives may share one large array of vertices, of which each gets a copy."""

SHAPES = Limit("shapes", 2**28, 256)
"""A shape takes some hundred bytes of a scene file, an instance fifty: 65,000 places, and five for each of these."""

MADE = Limit("spheres and other round shapes", 2**29, 256)
"""19 million triangles. A sphere that is seen from afar has 4,000, another five times as many."""

TEXT = Limit("XML elements and texts", 2**26, 128)
"""The shortest element has four bytes and takes 300."""

BYTES_PER_PIXEL = 16
"""Memory of a pixel that is decoded: what the decoder makes of it, and three numbers in single precision."""

BYTES_PER_SHAPE = 4096
"""A shape without its mesh. That is more than it takes, so that all that are free take no more than 2 s."""

BYTES_PER_ELEMENT = 2**14
"""A shape that is made from an element of XML, likewise: each takes 0.3 ms."""

PATIENCE = 200_000_000
"""Steps, a few seconds, of a load for all work that takes longer than its data are large, such as concave polygons."""


@dataclass
class _Load:
    """What has been read so far.

    Attributes:
        sizes: bytes of each file, which counts once, by whichever path it is named.
        made: bytes of memory by their limits.
        patience: see `patience`.
        counted: the number of files and their bytes, when they were last added up.
    """

    sizes: dict[str, int]
    made: dict[Limit, int] = field(default_factory=dict)
    patience: int = PATIENCE
    counted: tuple[int, int] = (0, 0)

    @property
    def size(self) -> int:
        """Bytes of all files."""
        if len(self.sizes) != self.counted[0]:  # a sum for each thing that is made would be quadratic
            self.counted = len(self.sizes), sum(self.sizes.values())
        return self.counted[1]


_LOAD: contextvars.ContextVar[_Load | None] = contextvars.ContextVar("wrt_load", default=None)


@contextmanager
def one_load() -> Iterator[None]:
    """Within the context, or the function that it decorates, count together what is read.

    Within another such context it belongs to that.
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


def require(limit: Limit, size: int) -> None:
    """Raise InputError where so many bytes of memory more were too many for the files that are being read."""
    load = _LOAD.get()
    if load is None:
        return  # what comes of arrays in memory
    total = load.made.get(limit, 0) + size
    most = limit.free + limit.per_byte * load.size
    if total > most:
        raise InputError(
            f"its {limit.what} would take {_amount(total)}; from files of {_amount(load.size)} they may take "
            f"{_amount(most)} ({_amount(limit.free)}, and {limit.per_byte} times the files)"
        )


def take(limit: Limit, size: int) -> None:
    """Count so many bytes of memory more.

    Raises:
        InputError: where they are too many for the files that are being read.
    """
    require(limit, size)
    load = _LOAD.get()
    if load is not None:
        load.made[limit] = load.made.get(limit, 0) + size


def patience() -> int:
    """Return how many steps are left of PATIENCE, for work that may be given up."""
    load = _LOAD.get()
    return PATIENCE if load is None else load.patience


def spend(steps: int) -> None:
    """Take steps off the patience of this load."""
    load = _LOAD.get()
    if load is not None:
        load.patience -= steps


def size_of(mesh: Mesh) -> int:
    """Return how many bytes the arrays of a mesh take."""
    arrays = (mesh.vertices, mesh.faces, mesh.normals, mesh.uvs, mesh.colors)
    return sum(array.nbytes for array in arrays if array is not None)


def _amount(size: int) -> str:
    for unit, factor in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size >= factor:
            return f"{size / factor:.3g} {unit}"
    return f"{size} bytes"
