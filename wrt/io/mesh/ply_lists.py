"""PLY files whose polygons differ in their number of corners, written anew as triangles.

trimesh takes the length of the first list of each kind for that of all; in text where there are several kinds.
Format: Turk 1994, "The PLY Polygon File Format".
"""

from __future__ import annotations

import dataclasses
import warnings
from array import array
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.io import memory_limits
from wrt.io.mesh.polygons import triangulate

_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_CORNERS = ("vertex_indices", "vertex_index")
_COORDINATES = ("texcoord", "texcoords")
_CHUNK = 1 << 16  # rows that are gathered at once, which takes memory for an index of each byte


@dataclasses.dataclass
class _Element:
    """An element of the header.

    Attributes:
        lines: its properties as they are in the header.
        scalars: NumPy's types of its numbers.
        lists: those of the counts and items of its lists.
        order: names of both, as they follow each other.
    """

    name: str
    count: int
    lines: list[str] = dataclasses.field(default_factory=list)
    scalars: dict[str, str] = dataclasses.field(default_factory=dict)
    lists: dict[str, tuple[str, str]] = dataclasses.field(default_factory=dict)
    order: list[str] = dataclasses.field(default_factory=list)


def triangulated(data: bytes) -> bytes:
    """Return a binary PLY file whose polygons are cut into triangles, which keep colours and texture coordinates.

    Elements other than vertices and faces are left out.

    Raises:
        ValueError: if the data end too soon, or the header is not as specified.
    """
    end = data.index(b"\n", data.index(b"end_header")) + 1
    comments, elements, big = _header(data[:end].decode("latin-1"))
    order, place = ">" if big else "<", end
    if any(line.split()[:2] == [b"format", b"ascii"] for line in data[:end].splitlines()):
        data, place = _as_binary(data[end:], elements), 0
    made: dict[str, tuple[NDArray[Any], dict[str, Any]]] = {}
    for element in elements:
        if not element.lists:
            kind = np.dtype([(name, order + code) for name, code in element.scalars.items()])
            place += element.count * kind.itemsize
            if not 0 <= element.count <= len(data) or place > len(data):
                raise ValueError("it is truncated")
            made[element.name] = np.frombuffer(data, kind, element.count, place - element.count * kind.itemsize), {}
        else:
            place, numbers, lists = _rows(data, place, element, order)
            made[element.name] = numbers, lists
        if {"vertex", "face"} <= set(made):
            break
    vertices, _ = made["vertex"]
    numbers, lists = made["face"]
    faces = _faces(vertices, numbers, lists, order)
    [described] = [each for each in elements if each.name == "vertex"]
    head = ["ply", f"format binary_{'big' if big else 'little'}_endian 1.0", *comments]
    head += [f"element vertex {len(vertices)}", *described.lines, f"element face {len(faces)}"]
    for name in faces.dtype.names or ():
        kind, width = faces.dtype[name], faces.dtype[name].shape
        if not name.endswith("#"):
            code = next(word for word, code in _TYPES.items() if code == kind.base.str[1:])
            head.append(f"property list uchar {code} {name}" if width else f"property {code} {name}")
    return ("\n".join([*head, "end_header"]) + "\n").encode("latin-1") + vertices.tobytes() + faces.tobytes()


def _header(text: str) -> tuple[list[str], list[_Element], bool]:
    """Return the comments, the elements, and whether numbers are big-endian."""
    comments: list[str] = []
    elements: list[_Element] = []
    big = False
    for line in text.splitlines():
        match line.split():
            case ["format", kind, *_]:
                big = "big" in kind
            case ["comment" | "obj_info", *_]:
                comments.append(line)
            case ["element", name, count]:
                elements.append(_Element(name, int(count)))
            case ["property", "list", count, kind, name] if elements and {count, kind} <= set(_TYPES):
                elements[-1].lists[name] = _TYPES[count], _TYPES[kind]
                elements[-1].order.append(name)
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1].scalars[name] = _TYPES[kind]
                elements[-1].order.append(name)
                elements[-1].lines.append(line)
            case ["property", *_]:
                raise ValueError(f"the header has {line.strip()!r}")
    if {"vertex", "face"} - {each.name for each in elements}:
        raise ValueError("it is truncated, or there is something behind them")
    return comments, elements, big


def _as_binary(text: bytes, elements: list[_Element]) -> bytes:
    """Return the numbers of a text file as they stand in a little-endian one."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # of a word that is no number
        try:
            values = np.fromstring(text, sep=" ")
        except DeprecationWarning:
            raise ValueError("a number is none") from None
    memory_limits.take(memory_limits.MESHES, 32 * len(values))
    kinds, place = array("b"), 0  # of each number
    codes = ["<" + code for code in dict.fromkeys(_TYPES.values())]
    numbers = {code: number for number, code in enumerate(codes)}
    for element in elements:
        if not 0 <= element.count <= len(values) - place:
            raise ValueError("it is truncated")
        for _ in range(element.count):
            for name in element.order:
                counted, item = element.lists.get(name, ("", element.scalars.get(name, "")))
                length = 1
                if counted:
                    if place >= len(values) or not 0 <= values[place] <= len(values) - place - 1:
                        raise ValueError("it is truncated")
                    length = int(values[place])
                    kinds.append(numbers["<" + counted])
                kinds.extend([numbers["<" + item]] * length)
                place += length + bool(counted)
        if place > len(values):
            raise ValueError("it is truncated")
    types = np.array(kinds, np.int8)
    sizes = np.array([np.dtype(code).itemsize for code in codes])[types]
    places = np.cumsum(sizes) - sizes
    result = np.zeros(int(sizes.sum()), np.uint8)
    for number, code in enumerate(codes):
        kind, (own,) = np.dtype(code), np.nonzero(types == number)
        found = values[own]
        if kind.kind in "iu" and not ((found >= np.iinfo(kind).min) & (found <= np.iinfo(kind).max)).all():
            raise ValueError("a number does not fit its type")
        with np.errstate(over="ignore"):  # of a coordinate, which is refused
            plain = found.astype(kind).view(np.uint8).reshape(-1, kind.itemsize)
        result[places[own, None] + np.arange(kind.itemsize)] = plain
    return result.tobytes()


def _rows(
    data: bytes, place: int, element: _Element, order: str
) -> tuple[int, NDArray[Any], dict[str, tuple[NDArray[Any], NDArray[np.int64]]]]:
    """Return where an element's rows end, their numbers, and the items and their counts of each list."""
    endian: Any = "big" if order == ">" else "little"
    steps = []
    for name in element.order:
        if name in element.lists:
            counted, items = (np.dtype(code) for code in element.lists[name])
            if counted.kind == "f":
                raise ValueError(f"the length of {name!r} is not a whole number")
            steps.append((counted.itemsize, items.itemsize))
        else:
            steps.append((0, np.dtype(element.scalars[name]).itemsize))
    size = len(data)
    if not 0 <= element.count <= size - place:  # each row has a byte or more
        raise ValueError("it is truncated")
    starts, lengths = array("q"), array("q")
    for _ in range(element.count):
        for width, item in steps:
            length = 1
            if width:
                length = int.from_bytes(data[place : place + width], endian)
                place += width
            starts.append(place)
            lengths.append(length)
            place += length * item
        if place > size:
            raise ValueError("it is truncated")
    places = np.array(starts, np.int64).reshape(-1, len(steps))
    counts = np.array(lengths, np.int64).reshape(-1, len(steps))
    plain = np.frombuffer(data, np.uint8)

    def taken(k: int, code: str) -> NDArray[Any]:
        width, pieces = np.dtype(code).itemsize, [np.zeros(0, np.uint8)]
        for first in range(0, element.count, _CHUNK):
            sizes = counts[first : first + _CHUNK, k] * width
            offset = np.repeat(places[first : first + _CHUNK, k] - (np.cumsum(sizes) - sizes), sizes)
            pieces.append(plain[offset + np.arange(len(offset))])
        return np.concatenate(pieces).view(order + code)

    numbers = np.zeros(element.count, [(name, order + code) for name, code in element.scalars.items()])
    lists = {}
    for k, name in enumerate(element.order):
        if name in element.lists:
            lists[name] = taken(k, element.lists[name][1]), counts[:, k]
        else:
            numbers[name] = taken(k, element.scalars[name])
    return place, numbers, lists


def _faces(vertices: NDArray[Any], numbers: NDArray[Any], lists: dict[str, Any], order: str) -> NDArray[Any]:
    """Return a row for each triangle, as it stands in a file."""
    name = next((each for each in _CORNERS if each in lists), None)
    if name is None:
        raise ValueError("its faces name no vertices")
    corners, counts = lists[name]
    memory_limits.take(memory_limits.MESHES, 32 * len(corners))
    corners = corners.astype(np.int64)
    if len(corners) and not 0 <= corners.min() <= corners.max() < len(vertices):
        raise ValueError(f"a face names vertex {corners.max()}, but there are {len(vertices)}")
    points = np.stack([vertices[axis] for axis in "xyz"], axis=1)
    triangles, owner = triangulate(points, corners, counts)
    kind: list[Any] = [(each, numbers.dtype[each]) for each in numbers.dtype.names or ()]
    kind += [(f"{name}#", "u1"), (name, f"{order}i4", (3,))]
    laid = next((each for each in _COORDINATES if each in lists and (lists[each][1] == 2 * counts).all()), None)
    if laid is not None:
        kind += [(f"{laid}#", "u1"), (laid, lists[laid][0].dtype, (6,))]
    faces = np.zeros(len(triangles), kind)
    for each in numbers.dtype.names or ():
        faces[each] = numbers[each][owner]
    faces[f"{name}#"], faces[name] = 3, corners[triangles]
    if laid is not None:
        faces[f"{laid}#"], faces[laid] = 6, lists[laid][0].reshape(-1, 2)[triangles].reshape(-1, 6)
    return faces
