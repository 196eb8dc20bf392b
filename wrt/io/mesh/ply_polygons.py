"""PLY files whose polygons differ in their number of corners, rewritten as binary files of triangles.

trimesh assumes that all lists of a property are as long as the first one; in text, where several kinds exist.
Format: Turk 1994, "The PLY Polygon File Format".
"""

from __future__ import annotations

import struct
import warnings
from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.io import memory_limits
from wrt.io.mesh.polygons import triangulate

_TYPES = {
    **dict.fromkeys(("char", "int8"), "b"),
    **dict.fromkeys(("uchar", "uint8"), "B"),
    **dict.fromkeys(("short", "int16"), "h"),
    **dict.fromkeys(("ushort", "uint16"), "H"),
    **dict.fromkeys(("int", "int32"), "i"),
    **dict.fromkeys(("uint", "uint32"), "I"),
    **dict.fromkeys(("float", "float32"), "f"),
    **dict.fromkeys(("double", "float64"), "d"),
}
"""Format characters of `struct` and NumPy."""

_LENGTHS = {word for word, code in _TYPES.items() if code not in "fd"}

_CORNERS = ("vertex_indices", "vertex_index")
_COORDINATES = ("texcoord", "texcoords")

_Column = tuple[NDArray[np.float64], NDArray[np.int64]]
"""The values of a property in all rows, and their number in each row; double precision holds all types of PLY."""


@dataclass
class _Element:
    """An element of the header.

    Attributes:
        properties: for each name the type of its length, which is empty for a number, and the type of its values.
    """

    name: str
    count: int
    properties: dict[str, tuple[str, str]] = field(default_factory=dict)


def with_triangles(path: Path, data: bytes) -> bytes:
    """Return a binary PLY file whose polygons are cut into triangles, which keep colours and texture coordinates.

    Elements other than vertices and faces are left out.

    Raises:
        ValueError: if the data end too soon, or the header is not as specified.
    """
    end = data.index(b"\n", data.index(b"end_header")) + 1
    comments, elements, format_name = _header(data[:end].decode("latin-1"))
    numbers = _Text(data[end:]) if format_name == "ascii" else _Binary(data[end:], format_name)
    columns: dict[str, dict[str, _Column]] = {}
    for element in elements:
        columns[element.name] = _columns(element, numbers)
        if {"vertex", "face"} <= set(columns):
            break
    kinds = {element.name: element.properties for element in elements}
    vertices = _records([(key, code, columns["vertex"][key][0]) for key, code in _scalars(kinds["vertex"])])
    faces = _triangles(path, vertices, columns["face"], kinds["face"])
    head = ["ply", "format binary_little_endian 1.0", *comments]
    for name, records in (("vertex", vertices), ("face", faces)):
        head.append(f"element {name} {len(records)}")
        for key in records.dtype.names or ():
            base, shape = records.dtype[key].base, records.dtype[key].shape
            word = next(word for word, code in _TYPES.items() if np.dtype(code) == base)
            if not key.endswith("#"):
                head.append(f"property list uchar {word} {key}" if shape else f"property {word} {key}")
    return ("\n".join([*head, "end_header"]) + "\n").encode("latin-1") + vertices.tobytes() + faces.tobytes()


def _header(text: str) -> tuple[list[str], list[_Element], str]:
    """Return the comments, the elements, and the format."""
    comments: list[str] = []
    elements: list[_Element] = []
    format_name = ""
    for line in text.splitlines():
        match line.split():
            case ["format", format_name, *_]:
                pass
            case ["comment" | "obj_info", *_]:
                comments.append(line)
            case ["element", name, count]:
                elements.append(_Element(name, int(count)))
            case ["property", "list", count, kind, name] if elements and count in _LENGTHS and kind in _TYPES:
                elements[-1].properties[name] = _TYPES[count], _TYPES[kind]
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1].properties[name] = "", _TYPES[kind]
            case ["property", *_]:
                raise ValueError(f"the header has {line.strip()!r}")
    if {"vertex", "face"} - {element.name for element in elements}:
        raise ValueError("it is truncated, or there is something behind them")
    return comments, elements, format_name


class _Text:
    """The numbers of a text file, one after the other."""

    def __init__(self, text: bytes) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)  # of a word that is not a number
            try:
                self._values = np.fromstring(text, sep=" ")
            except DeprecationWarning:
                raise ValueError("it has a word where a number should be") from None
        memory_limits.take(memory_limits.MESHES, 32 * len(self._values))
        self._place = 0

    def take(self, code: str, count: int) -> Sequence[float]:
        """Return the next `count` numbers of a type."""
        if not 0 <= count <= len(self._values) - self._place:
            raise ValueError("it is truncated")
        values = self._values[self._place : self._place + count]
        self._place += count
        if code not in "fd":
            limits = np.iinfo(code)
            if not ((values >= limits.min) & (values <= limits.max)).all():
                raise ValueError("a number does not fit its type")
            values = np.trunc(values)
        result: list[float] = values.tolist()
        return result


class _Binary:
    """The numbers of a binary file, one after the other."""

    def __init__(self, data: bytes, format_name: str) -> None:
        self._data, self._place = data, 0
        self._order = ">" if "big" in format_name else "<"

    def take(self, code: str, count: int) -> Sequence[float]:
        """Return the next `count` numbers of a type."""
        size = count * struct.calcsize(code)
        if not 0 <= size <= len(self._data) - self._place:
            raise ValueError("it is truncated")
        self._place += size
        return struct.unpack_from(f"{self._order}{count}{code}", self._data, self._place - size)


def _columns(element: _Element, numbers: _Text | _Binary) -> dict[str, _Column]:
    """Return the values of each property of an element."""
    values = {name: array("d") for name in element.properties}
    counts = {name: array("q") for name in element.properties}
    for _ in range(element.count if element.properties else 0):
        for name, (count_code, code) in element.properties.items():
            count = int(numbers.take(count_code, 1)[0]) if count_code else 1
            values[name].extend(numbers.take(code, count))
            counts[name].append(count)
    return {name: (np.array(values[name]), np.array(counts[name], np.int64)) for name in element.properties}


def _scalars(properties: dict[str, tuple[str, str]]) -> list[tuple[str, str]]:
    """Return the names and types of properties that are numbers and not lists."""
    return [(name, code) for name, (count_code, code) in properties.items() if not count_code]


def _records(columns: list[tuple[str, str, NDArray[Any]]]) -> NDArray[Any]:
    """Return little-endian records of columns, each with its name, its type and its (N,) or (N, width) values."""
    kind = np.dtype([(name, f"<{np.dtype(code).str[1:]}", values.shape[1:]) for name, code, values in columns])
    records = np.zeros(len(columns[0][2]) if columns else 0, kind)
    with np.errstate(over="ignore"):  # of a coordinate, which is refused later
        for name, _, values in columns:
            records[name] = values
    return records


def _triangles(
    path: Path, vertices: NDArray[Any], columns: dict[str, _Column], kinds: dict[str, tuple[str, str]]
) -> NDArray[Any]:
    """Return a record for each triangle; the name of a list's length ends in #."""
    name = next((each for each in _CORNERS if each in columns), None)
    if name is None:
        raise ValueError("its faces name no vertices")
    corners, counts = columns[name][0].astype(np.int64), columns[name][1]
    memory_limits.take(memory_limits.MESHES, 32 * len(corners))
    points = np.stack([vertices[axis] for axis in "xyz"], axis=1)
    triangles, owner = triangulate(path, points, corners, counts)
    result: list[tuple[str, str, NDArray[Any]]] = [(key, code, columns[key][0][owner]) for key, code in _scalars(kinds)]
    result += [(f"{name}#", "B", np.full(len(triangles), 3)), (name, "i", corners[triangles])]
    for key in _COORDINATES:
        if key in columns and (columns[key][1] == 2 * counts).all():
            uvs = columns[key][0].reshape(-1, 2)[triangles].reshape(-1, 6)
            return _records([*result, (f"{key}#", "B", np.full(len(uvs), 6)), (key, kinds[key][1], uvs)])
    return _records(result)
