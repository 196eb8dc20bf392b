"""Stanford PLY, loaded by trimesh, except for what trimesh does not read.

That is triangle strips, and polygons that differ in their number of corners.

Format: Turk 1994, "The PLY Polygon File Format".
"""

from __future__ import annotations

import re
import struct
import warnings
from array import array
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, warn
from wrt.io import memory_limits
from wrt.io.account import warn_of_unused
from wrt.io.mesh.parts import Part, decoded, matching, points_of, split_vertices
from wrt.io.mesh.polygons import outer_sides, split_strips, triangulate
from wrt.io.mesh.sidecars import Sidecars
from wrt.io.mesh.trimesh_loaders import Fields, load, part_of
from wrt.io.safe_read import as_utf8
from wrt.io.texture_images import TextureImages
from wrt.scene.textures import ImageTexture

_TEXTURE_FILE = re.compile(rb"^comment\b.*texturefile(.*)$", re.IGNORECASE | re.MULTILINE)

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

_RGBA = ("red", "green", "blue", "alpha")
_NORMAL = ("nx", "ny", "nz")
_COORDINATES = (("texture_u", "texture_v"), ("u", "v"), ("s", "t"))
_INDICES = ("vertex_indices", "vertex_index")

_SYNONYMS = (
    ("rgb", _RGBA[:3]),
    ("rgba", _RGBA),
    (("diffuse_red", "diffuse_green", "diffuse_blue"), _RGBA[:3]),
    (("normal_x", "normal_y", "normal_z"), _NORMAL),
    (("texcoords",), ("texcoord",)),
)
"""Alternative names of the properties of an element, used if all are present, and the names to read them by."""

WITHOUT_EFFECT = {
    "*.quality": "a measurement at a vertex or face, not a colour",
    "*.confidence": "a measurement",
    "*.intensity": "a measurement",
    "*.scalar*": "a measurement, as CloudCompare names it",
    "*.curvature": "a measurement",
    "*.flags": "a selection in MeshLab",
    "face.n[xyz]": "follows from the corners",
    "camera.*": "the place of a scanner",
    "range_grid.*": "the order in which a scanner saw the points",
}
"""What of a file does not change a picture: patterns of "element.property", and the reason."""

_Properties: TypeAlias = dict[str, tuple[str, str]]
"""For each name the type of its length, which is empty for a number, and the type of its values."""

_Take: TypeAlias = Callable[[str, int], Sequence[float]]
"""Returns the next numbers of a file, given their type and how many they are."""

_Columns: TypeAlias = dict[str, tuple[NDArray[Any], NDArray[np.int64]]]
"""The values of each property in all rows, and their number in each row."""


def read_ply(path: Path, data: bytes) -> list[Part]:
    """Return the file's surface as one part; none where it has no faces or strips.

    Raises:
        InputError: on what trimesh cannot read and on data that end too soon.
    """
    data = as_utf8(data)
    end = max(data.find(b"end_header"), 0)
    header, declared = _renamed(data[:end])
    data = header + data[end:]
    if b"<this>" in header:  # MeshLab's placeholder for the name of the file itself
        header = header.replace(b"<this>", path.stem.encode("utf-8", "surrogateescape"))
    # Coordinates at corners split vertices; for coordinates at vertices that is not needed, and trimesh would drop the
    # normals and colours.
    by_corner = b"texcoord" in header
    try:
        fields = load(path, data, "ply", fix_texture=by_corner, skip_materials=True)
    except InputError as error:
        # NumPy's words where coordinates at corners differ in number from face to face
        ragged = "array element with a sequence" in str(error) and b"format ascii" in header
        if "unexpected length" not in str(error) and not ragged:
            raise
        fields = _fields_with_triangles(path, data)
    elements = fields.get("metadata", {}).get("_ply_raw", {})
    if b"format ascii" in data[: data.find(b"end_header")]:
        _check_text_is_complete(path, elements)
    if "face" in elements and len(fields.get("faces", ())) > elements["face"]["length"]:
        fields = _fields_with_triangles(path, data)  # trimesh cuts these, concave ones wrongly
    strips = _strips_of(elements)
    if len(strips):
        faces = np.asarray(fields.get("faces", np.zeros((0, 3), np.int64)))
        fields["faces"] = np.concatenate([faces, strips]) if faces.shape[1:] == (3,) else strips
    part = part_of(path, path.stem, fields)
    if part is None:
        vertices = fields.get("vertices", ())
        colors = matching(fields.get("vertex_colors"), len(vertices))
        if not len(vertices):
            return []
        part = points_of(path.stem, vertices, None if colors is None else decoded(colors))
    if part.uvs is not None and (names := _TEXTURE_FILE.findall(header)):
        name = names[-1].strip().decode("utf-8", "surrogateescape")
        pixels = TextureImages(path).pixels(0, "color", f"texture {name}", lambda: Sidecars(path).find(name))
        part.reflectance = None if pixels is None else ImageTexture(pixels, name)
        if names[1:]:
            warn(f"{path}: of its {len(names)} textures only the last is used")
    warn_of_unused(path, _unused(declared, part, by_corner=by_corner), WITHOUT_EFFECT)
    return [part]


def _renamed(header: bytes) -> tuple[bytes, list[tuple[str, str]]]:
    """Return a header in which properties have the names by which they are read, and their elements and names."""
    lines = header.splitlines(keepends=True)
    words = [line.decode("latin-1").split() for line in lines]
    names: dict[str, list[str]] = {}
    places: list[tuple[int, str, str]] = []
    element = ""
    for number, row in enumerate(words):
        if row[:1] == ["element"] and len(row) > 1:
            element = row[1]
        elif row[:1] == ["property"] and len(row) > 2:
            names.setdefault(element, []).append(row[-1])
            places.append((number, element, row[-1]))
    found: dict[tuple[str, str], str] = {}
    for element in names.keys() & {"vertex", "face"}:
        for others, plain in _SYNONYMS:
            if set(others) <= set(names[element]) and not set(plain) & set(names[element]):
                found |= {(element, other): name for other, name in zip(others, plain, strict=True)}
    for number, element, name in places:
        if (element, name) in found:
            line = lines[number].rstrip()
            lines[number] = line[: -len(name)] + found[element, name].encode() + lines[number][len(line) :]
    return b"".join(lines), [(element, found.get((element, name), name)) for _, element, name in places]


def _unused(declared: list[tuple[str, str]], part: Part, *, by_corner: bool) -> list[str]:
    """Return "element.property" of what a file declares and a part does not have.

    Colours that something else replaces (see `wrt.io.load_mesh.load_file`) count as used. Properties that are numbered
    count as one.
    """
    has_faces = part.faces.shape[1] == 3
    is_colored = part.colors is not None or part.reflectance is not None
    used = {("vertex", name) for name in "xyz"}
    if part.normals is not None or not has_faces:  # spheres have normals of their own
        used |= {("vertex", name) for name in _NORMAL}
    if is_colored:
        used |= {("vertex", name) for name in _RGBA}
    if is_colored or part.face_colors is not None:
        used |= {("face", name) for name in _RGBA}
    if has_faces:
        lists = [name for element, name in declared if element == "face"]
        used |= {("face", name) for name in (_INDICES if len(lists) > 1 else lists)}
        used |= {pair for pair in declared if pair[0] == "tristrips"}
    if isinstance(part.reflectance, ImageTexture):
        used.add(("face", "texnumber"))  # a file with several textures causes a warning of its own
    if part.uvs is not None:
        at_vertices = next(({*pair} for pair in _COORDINATES if {*pair} <= {name for _, name in declared}), set())
        used |= {("face", "texcoord")} if by_corner else {("vertex", name) for name in at_vertices}
    return [f"{element}.{re.sub(r'_?[0-9]+$', '', name)}" for element, name in declared if (element, name) not in used]


def _check_text_is_complete(path: Path, elements: dict[str, Any]) -> None:
    """Raise InputError where there are fewer lines than the header says: trimesh takes as many as there are."""
    for name, element in elements.items():
        columns = element.get("data", {})
        first = next(iter(columns.values()), None) if isinstance(columns, dict) else None
        if first is not None and len(first) < element["length"]:
            raise InputError(f"{path}: {len(first)} of {element['length']} {name!r} rows are there; it is truncated")


def _strips_of(elements: dict[str, Any]) -> NDArray[np.int64]:
    """Return (T, 3) triangles of the element that programs of Stanford's school write instead of faces."""
    data = elements.get("tristrips", {}).get("data")
    if isinstance(data, np.ndarray):  # binary: records of a count and that many indices
        lists = [name for name in data.dtype.names or () if data.dtype[name].names]
        rows = [row["f1"] for name in lists for row in data[name]]
    else:
        rows = [row for column in (data or {}).values() for row in column]
    # Each row is a strip, and -1 starts another within it.
    pieces = [np.append(np.asarray(row, np.int64), -1) for row in rows]
    return split_strips(np.concatenate(pieces)) if pieces else np.zeros((0, 3), np.int64)


# --- Polygons that differ in their number of corners --------------------------------------------------


def _fields_with_triangles(path: Path, data: bytes) -> Fields:
    """Return the fields that trimesh's loader would, with polygons cut into triangles.

    Elements other than vertices and faces are left out.

    Raises:
        InputError: if the data end too soon, or the header is not as specified.
    """
    try:
        return _cut_fields(path, data)
    except ValueError as reason:
        raise InputError(f"{path}: the data are not as long as the PLY header says: {reason}") from None


def _cut_fields(path: Path, data: bytes) -> Fields:
    end = data.index(b"\n", data.index(b"end_header")) + 1
    elements, format_name = _header(data[:end].decode("latin-1"))
    take = _numbers_of_text(data[end:]) if format_name == "ascii" else _numbers_of_bytes(data[end:], format_name)
    columns: dict[str, _Columns] = {}
    for name, count, properties in elements:
        columns[name] = _columns(count, properties, take)
        if {"vertex", "face"} <= set(columns):
            break
    vertex, face = columns["vertex"], columns["face"]
    corners, counts = next((face[key] for key in _INDICES if key in face), (None, None))
    if corners is None or counts is None:
        raise ValueError("its faces name no vertices")
    memory_limits.take(memory_limits.MESHES, 32 * len(corners))
    corners = corners.astype(np.int64)
    vertices = _stacked(vertex, "xyz")
    if vertices is None:
        raise ValueError("its vertices have no x, y and z")
    triangles, owner = triangulate(path, vertices, corners, counts)
    faces = corners[triangles]
    fields: Fields = {"vertices": vertices, "faces": faces, "vertex_normals": _stacked(vertex, _NORMAL)}
    fields["sides"] = outer_sides(triangles, owner, counts)
    for name, colored in (("vertex", vertex), ("face", face)):
        fields[f"{name}_colors"] = _stacked(colored, _RGBA if "alpha" in colored else _RGBA[:3])
    if fields["face_colors"] is not None:
        fields["face_colors"] = fields["face_colors"][owner]
    if "texcoord" in face and (face["texcoord"][1] == 2 * counts).all():
        uvs = face["texcoord"][0].reshape(-1, 2)[triangles].reshape(-1, 2)
        vertices, faces, uvs = split_vertices(vertices, faces, uvs)
        fields |= {"vertices": vertices, "faces": faces, "visual": SimpleNamespace(uv=uvs)}
        return fields | dict.fromkeys(("vertex_normals", "vertex_colors"))  # trimesh drops them, too
    for names in _COORDINATES:
        if (coordinates := _stacked(vertex, names)) is not None:
            return {**fields, "visual": SimpleNamespace(uv=coordinates)}
    return fields


def _header(text: str) -> tuple[list[tuple[str, int, _Properties]], str]:
    """Return the names, counts and properties of elements, and the format."""
    elements: list[tuple[str, int, _Properties]] = []
    format_name = ""
    for line in text.splitlines():
        match line.split():
            case ["format", format_name, *_]:
                pass
            case ["element", name, count]:
                elements.append((name, int(count), {}))
            case ["property", "list", count, kind, name] if elements and count in _LENGTHS and kind in _TYPES:
                elements[-1][2][name] = _TYPES[count], _TYPES[kind]
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1][2][name] = "", _TYPES[kind]
            case ["property", *_]:
                raise ValueError(f"the header has {line.strip()!r}")
    if {"vertex", "face"} - {name for name, _, _ in elements}:
        raise ValueError("it is truncated, or there is something behind them")
    return elements, format_name


def _numbers_of_text(text: bytes) -> _Take:
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # of a word that is not a number
        try:
            numbers = np.fromstring(text, sep=" ")
        except DeprecationWarning:
            raise ValueError("it has a word where a number should be") from None
    memory_limits.take(memory_limits.MESHES, 32 * len(numbers))
    place = 0

    def take(code: str, count: int) -> Sequence[float]:
        nonlocal place
        if not 0 <= count <= len(numbers) - place:
            raise ValueError("it is truncated")
        values, place = numbers[place : place + count], place + count
        if code not in "fd":
            limits = np.iinfo(code)
            if not ((values >= limits.min) & (values <= limits.max)).all():
                raise ValueError("a number does not fit its type")
            values = np.trunc(values)
        result: list[float] = values.tolist()
        return result

    return take


def _numbers_of_bytes(data: bytes, format_name: str) -> _Take:
    order, place = ">" if "big" in format_name else "<", 0

    def take(code: str, count: int) -> Sequence[float]:
        nonlocal place
        size = count * struct.calcsize(code)
        if not 0 <= size <= len(data) - place:
            raise ValueError("it is truncated")
        place += size
        return struct.unpack_from(f"{order}{count}{code}", data, place - size)

    return take


def _columns(rows: int, properties: _Properties, take: _Take) -> _Columns:
    values = {name: array("d") for name in properties}  # double precision holds all types of PLY
    counts = {name: array("q") for name in properties}
    for _ in range(rows if properties else 0):
        for name, (count_code, code) in properties.items():
            count = int(take(count_code, 1)[0]) if count_code else 1
            values[name].extend(take(code, count))
            counts[name].append(count)
    with np.errstate(over="ignore"):  # of a coordinate, which is refused later
        typed = {name: np.array(values[name]).astype(code) for name, (_, code) in properties.items()}
    return {name: (typed[name], np.array(counts[name], np.int64)) for name in properties}


def _stacked(columns: _Columns, names: Sequence[str]) -> NDArray[Any] | None:
    """Return (N, K) numbers of some properties, or None if one is missing or a list."""
    if any(name not in columns or (columns[name][1] != 1).any() for name in names):
        return None
    return np.column_stack([columns[name][0] for name in names])
