"""Stanford PLY: ascii and binary, polygons of any size, triangle strips, colours, textures.

Format: Turk 1994, "The PLY Polygon File Format". Read here because trimesh knows neither
triangle strips nor, in binary files, polygons of different sizes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.formats.images import linear_from_srgb, load_image
from wrt.formats.parts import Part, warn
from wrt.formats.polygons import split_strips, triangulate, unify
from wrt.textures import ImageTexture

_TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"}
_TYPES |= {"float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2"}
_TYPES |= {"int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8", "float32": "f4", "float64": "f8"}

_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}

_UV_NAMES = (("u", "v"), ("s", "t"), ("texture_u", "texture_v"), ("texture_s", "texture_t"))
_COLOR_NAMES = (("red", "green", "blue"), ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue"))


@dataclass
class _Property:
    name: str
    type: str  # numpy type without byte order
    count_type: str = ""  # of lists only


@dataclass
class _Element:
    name: str
    count: int
    properties: list[_Property] = field(default_factory=list)


@dataclass
class _List:
    """The values of a list property of all rows, one after the other."""

    values: NDArray[Any]
    counts: NDArray[np.int64]


_Columns = dict[str, "NDArray[Any] | _List"]


def read_ply(path: Path, data: bytes) -> list[Part]:
    """Return the file's surface as one part; none where it has no faces or strips.

    Raises:
        InputError: on a header that cannot be read and on data that end too soon.
    """
    order, elements, texture_file, body = _header(path, data)
    tables: dict[str, _Columns] = {}
    if order:
        position = 0
        for element in elements:
            tables[element.name], position = _binary(path, body, position, element, order)
    else:
        tokens = _tokens(path, body)
        position = 0
        for element in elements:
            tables[element.name], position = _ascii(path, tokens, position, element)
    vertex = tables.get("vertex", {})
    xyz = _stacked(vertex, [("x", "y", "z")])
    if xyz is None:
        return []
    part = Part(path.stem, xyz.astype(np.float64), np.zeros((0, 3), np.int64))
    part.normals = _stacked(vertex, [("nx", "ny", "nz")])
    part.uvs = _stacked(vertex, _UV_NAMES)
    part.colors = _colors(vertex)
    _add_faces(path, part, tables)
    if texture_file and part.uvs is not None:
        try:
            pixels = np.clip(load_image(path.parent / texture_file), 0.0, 1.0)
            part.reflectance = ImageTexture(pixels, Path(texture_file).name)
        except InputError as error:
            warn(f"{path}: texture left out: {error}")
    return [part]


def _add_faces(path: Path, part: Part, tables: dict[str, _Columns]) -> None:
    """Fill in the triangles of polygons and strips, and what hangs on faces and their corners."""
    strips = tables.get("tristrips", {}).get("vertex_indices", tables.get("tristrips", {}).get("vertex_index"))
    pieces = []
    if isinstance(strips, _List):
        ends = np.cumsum(strips.counts)[:-1]
        # Each row is a strip of its own, and -1 starts another within it.
        pieces.append(split_strips(np.insert(strips.values.astype(np.int64), ends, -1)))
    face = tables.get("face", {})
    polygons = face.get("vertex_indices", face.get("vertex_index"))
    if isinstance(polygons, _List) and len(polygons.values):
        corners = polygons.values.astype(np.int64)
        low, high = int(corners.min()), int(corners.max())
        if low < 0 or high >= len(part.vertices):
            bad = low if low < 0 else high
            raise InputError(f"{path}: a face names vertex {bad}, but there are {len(part.vertices)} (counted from 0)")
        triangles, owner = triangulate(part.vertices, corners, polygons.counts)
        face_colors = _colors(face)
        if face_colors is not None and part.colors is None and not pieces:
            part.face_colors = face_colors[owner]
        uv_list = face.get("texcoord")
        if isinstance(uv_list, _List) and not pieces and (uv_list.counts == 2 * polygons.counts).all():
            corner_uvs = uv_list.values.reshape(-1, 2).astype(np.float64)
            _, uv_index = np.unique(corner_uvs, axis=0, return_inverse=True)
            faces, first = unify(corners[triangles.reshape(-1)], uv_index.reshape(-1)[triangles.reshape(-1)])
            chosen = triangles.reshape(-1)[first]
            source = corners[chosen]
            part.vertices, part.uvs = part.vertices[source], corner_uvs[chosen]
            part.normals = None if part.normals is None else part.normals[source]
            part.colors = None if part.colors is None else part.colors[source]
            part.faces = faces.reshape(-1, 3)
            return
        pieces.append(corners[triangles])
    if pieces:
        part.faces = np.concatenate(pieces)


def _stacked(columns: _Columns, choices: Any) -> NDArray[Any] | None:
    """Return the first choice of scalar properties that is there, as columns of one array."""
    for names in choices:
        found = [columns.get(name) for name in names]
        arrays = [column for column in found if isinstance(column, np.ndarray)]
        if len(arrays) == len(names):
            return np.stack(arrays, axis=1)
    return None


def _colors(columns: _Columns) -> NDArray[np.float64] | None:
    """Return linear colours; whole numbers span the range of their type, and all are sRGB."""
    for names in _COLOR_NAMES:
        found = [columns.get(name) for name in names]
        arrays = [column for column in found if isinstance(column, np.ndarray)]
        if len(arrays) == 3:
            scales = [np.iinfo(a.dtype).max if a.dtype.kind in "iu" else 1 for a in arrays]
            values = np.stack([a.astype(np.float64) / s for a, s in zip(arrays, scales, strict=True)], axis=1)
            return linear_from_srgb(values)
    return None


def _header(path: Path, data: bytes) -> tuple[str, list[_Element], str, bytes]:
    """Return byte order ("" is ascii), elements, texture file, and what follows the header."""
    if not data.startswith(b"ply"):
        raise InputError(f"{path}: not a PLY file: it does not begin with 'ply'")
    order: str | None = None
    elements: list[_Element] = []
    texture, position = "", 0
    while True:
        end = data.find(b"\n", position)
        if end < 0 or end - position > 10_000:
            raise InputError(f"{path}: the PLY header does not end; the file is damaged")
        line = data[position:end].decode("utf-8", "replace").strip()
        position = end + 1
        words = line.split()
        if not words:
            continue
        if words[0] == "end_header":
            break
        try:
            if words[0] == "format":
                order = _ORDERS[words[1]]
            elif words[0] == "element":
                elements.append(_Element(words[1], int(words[2])))
                if elements[-1].count < 0:
                    raise ValueError
            elif words[0] == "property" and words[1] == "list":
                elements[-1].properties.append(_Property(words[4], _TYPES[words[3]], _TYPES[words[2]]))
            elif words[0] == "property":
                elements[-1].properties.append(_Property(words[2], _TYPES[words[1]]))
            elif words[0] == "comment" and len(words) > 2 and words[1].lower() == "texturefile":
                texture = line.split(None, 2)[2]
        except (IndexError, KeyError, ValueError):
            raise InputError(f"{path}: the PLY header line {line!r} cannot be read") from None
    if order is None:
        raise InputError(f"{path}: the PLY header names no format; the file is damaged")
    return order, elements, texture, data[position:]


def _too_short(path: Path, element: _Element) -> InputError:
    return InputError(f"{path}: the file ends inside element {element.name!r} of {element.count} rows; it is truncated")


def _binary(path: Path, body: bytes, position: int, element: _Element, order: str) -> tuple[_Columns, int]:
    """Return an element's columns and where the next element begins."""
    if not element.properties or element.count == 0:
        return {}, position
    # Most files have the same list lengths in every row: read as fixed records, and check that.
    fields: list[Any] = []
    lengths = []
    cursor = position
    for k, prop in enumerate(element.properties):
        length = None
        if prop.count_type:
            length, cursor = _count_at(path, body, cursor, element, order + prop.count_type)
            fields.append((f"n{k}", order + prop.count_type))
            cursor += length * int(prop.type[1])
            fields.append((f"p{k}", order + prop.type, (length,)))
        else:
            cursor += int(prop.type[1])
            fields.append((f"p{k}", order + prop.type))
        lengths.append(length)
    size = cursor - position
    if position + size * element.count <= len(body):
        rows = np.frombuffer(body, np.dtype(fields), element.count, position)
        if all(n is None or (rows[f"n{k}"] == n).all() for k, n in enumerate(lengths)):
            columns: _Columns = {}
            for k, prop in enumerate(element.properties):
                values = rows[f"p{k}"].astype(prop.type)
                if lengths[k] is not None:
                    counts = np.full(element.count, lengths[k], np.int64)
                    columns[prop.name] = _List(values.reshape(-1), counts)
                else:
                    columns[prop.name] = values
            return columns, position + size * element.count
    elif all(n is None for n in lengths):
        raise _too_short(path, element)
    return _binary_rows(path, body, position, element, order)


def _count_at(path: Path, body: bytes, position: int, element: _Element, type_: str) -> tuple[int, int]:
    size = int(type_[2])
    if position + size > len(body):
        raise _too_short(path, element)
    count = int(np.frombuffer(body, type_, 1, position)[0])
    if count < 0 or position + count > len(body):
        raise InputError(f"{path}: a list of {count} in element {element.name!r}; the file is damaged")
    return count, position + size


def _binary_rows(path: Path, body: bytes, position: int, element: _Element, order: str) -> tuple[_Columns, int]:
    """Read rows whose lists differ in length: walk the lengths, then gather all values at once."""
    small: Literal["little", "big"] = "little" if order == "<" else "big"
    begins: list[list[int]] = [[] for _ in element.properties]
    counts: list[list[int]] = [[] for _ in element.properties]
    plan = [(k, int(p.count_type[1]) if p.count_type else 0, int(p.type[1])) for k, p in enumerate(element.properties)]
    end = len(body)
    for _ in range(element.count):
        for k, count_size, size in plan:
            count = 1
            if count_size:
                count = int.from_bytes(body[position : position + count_size], small)
                counts[k].append(count)
                position += count_size
            begins[k].append(position)
            position += count * size
        if position > end:
            raise _too_short(path, element)
    raw = np.frombuffer(body, np.uint8)
    columns: _Columns = {}
    for k, prop in enumerate(element.properties):
        size = int(prop.type[1])
        each = np.array(counts[k] if prop.count_type else [1] * element.count, np.int64)
        first = np.repeat(np.array(begins[k], np.int64) - (np.cumsum(each) - each) * size, each)
        offsets = first + np.arange(int(each.sum())) * size
        values = raw[offsets[:, None] + np.arange(size)].reshape(-1).view(order + prop.type).astype(prop.type)
        columns[prop.name] = _List(values, each) if prop.count_type else values
    return columns, position


def _tokens(path: Path, body: bytes) -> NDArray[np.float64]:
    words = body.split()
    try:
        return np.array([float(word) for word in words])
    except ValueError:
        for word in words:
            try:
                float(word)
            except ValueError:
                text = word[:40].decode("utf-8", "replace")
                raise InputError(f"{path}: {text!r} is not a number; the file is damaged") from None
        raise


def _ascii(path: Path, tokens: NDArray[np.float64], position: int, element: _Element) -> tuple[_Columns, int]:
    """Return an element's columns and where the next begins, for rows of any list lengths."""
    if not element.properties or element.count == 0:
        return {}, position
    if not any(p.count_type for p in element.properties):
        end = position + element.count * len(element.properties)
        if end > len(tokens):
            raise _too_short(path, element)
        rows = tokens[position:end].reshape(element.count, -1)
        return {p.name: _typed(rows[:, k], p.type) for k, p in enumerate(element.properties)}, end
    begins: list[list[int]] = [[] for _ in element.properties]
    counts: list[list[int]] = [[] for _ in element.properties]
    values = tokens.tolist()  # reading single items from a list is several times faster
    for _ in range(element.count):
        for k, prop in enumerate(element.properties):
            count = 1
            if prop.count_type:
                if position >= len(values):
                    raise _too_short(path, element)
                if not 0 <= values[position] <= len(values):
                    raise InputError(f"{path}: a list of {values[position]:g} in element {element.name!r}")
                count = int(values[position])
                position += 1
            begins[k].append(position)
            counts[k].append(count)
            position += count
        if position > len(values):
            raise _too_short(path, element)
    columns: _Columns = {}
    for k, prop in enumerate(element.properties):
        each = np.array(counts[k], np.int64)
        offsets = np.repeat(np.array(begins[k], np.int64) - (np.cumsum(each) - each), each) + np.arange(int(each.sum()))
        column = _typed(tokens[offsets], prop.type)
        columns[prop.name] = _List(column, each) if prop.count_type else column
    return columns, position


def _typed(values: NDArray[np.float64], type_: str) -> NDArray[Any]:
    """Return text values in the type the header gives; whole numbers that do not fit become its limits."""
    if type_[0] == "f":
        with np.errstate(over="ignore"):
            return values.astype(type_)
    limits = np.iinfo(type_)
    # 64-bit limits are not float64 values; 53 bits are more than any index here.
    low, high = max(limits.min, -(2**53)), min(limits.max, 2**53)
    return np.clip(np.nan_to_num(values, nan=-1.0), low, high).astype(type_)
