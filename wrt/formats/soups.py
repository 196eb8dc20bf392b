"""Two plain formats: STL, a list of triangles, and OFF, a list of polygons."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from wrt.errors import InputError
from wrt.formats.images import linear_from_srgb
from wrt.formats.parts import Part, checked_positions
from wrt.formats.polygons import triangulate

_STL_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_STL_VERTEX = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)", re.IGNORECASE)


def read_stl(path: Path, data: bytes) -> list[Part]:
    """Return the triangles of a binary or ascii STL file, corners at one position merged.

    Format: 3D Systems 1988, "StereoLithography Interface Specification".

    Raises:
        InputError: when it is neither, or ends too soon.
    """
    count = int.from_bytes(data[80:84], "little") if len(data) >= 84 else 0
    size = 84 + count * _STL_RECORD.itemsize
    # Binary files may begin with "solid" too, so the size decides.
    looks_ascii = data.lstrip()[:5].lower() == b"solid" and b"facet" in data[:4096].lower()
    if len(data) >= 84 and (size == len(data) or (not looks_ascii and size < len(data) and count)):
        corners = np.frombuffer(data, _STL_RECORD, count, 84)["corners"].reshape(-1, 3).astype(np.float64)
    elif looks_ascii:
        words = _STL_VERTEX.findall(data)
        try:
            corners = np.array([float(word) for row in words for word in row]).reshape(-1, 3)
        except ValueError:
            raise InputError(f"{path}: a vertex of the ascii STL file cannot be read as numbers") from None
        if len(corners) % 3 or b"endsolid" not in data[-4096:].lower():
            raise InputError(f"{path}: the ascii STL file ends inside a triangle or solid; it is truncated")
    elif data.lstrip()[:5].lower() == b"solid" and b"endsolid" in data.lower():
        return []
    elif len(data) < 84:
        raise InputError(f"{path}: too short for an STL file ({len(data)} bytes)")
    else:
        held = (len(data) - 84) // _STL_RECORD.itemsize
        raise InputError(f"{path}: the STL header says {count} triangles, but {held} are there; the file is truncated")
    if not len(corners):
        return []
    checked_positions(path, corners, np.ones(len(corners), bool), what="corner")
    vertices, index = np.unique(corners + 0.0, axis=0, return_inverse=True)
    return [Part(path.stem, vertices, index.reshape(-1, 3))]


def read_off(path: Path, data: bytes) -> list[Part]:
    """Return the polygons of an OFF or COFF file, with vertex or face colours.

    Format: The Geometry Center, "Geomview manual", section OFF.

    Raises:
        InputError: on another header, and on data that are missing or no numbers.
    """
    lines = [line.partition(b"#")[0].split() for line in data.splitlines()]
    lines = [words for words in lines if words]
    header = lines[0][0].upper() if lines else b""
    if header not in (b"OFF", b"COFF"):
        raise InputError(f"{path}: an OFF file must begin with OFF or COFF")
    lines[0] = lines[0][1:]  # the counts may follow on the same line
    lines = lines if lines[0] else lines[1:]
    try:
        vertex_count, face_count = int(lines[0][0]), int(lines[0][1])
        if vertex_count < 0 or face_count < 0 or len(lines) < 1 + vertex_count + face_count:
            raise InputError(
                f"{path}: {vertex_count} vertices and {face_count} faces announced, but {len(lines) - 1} lines follow"
            )
        vertex_lines = lines[1 : 1 + vertex_count]
        face_lines = lines[1 + vertex_count : 1 + vertex_count + face_count]
        vertices = np.array([[float(word) for word in words[:3]] for words in vertex_lines]).reshape(-1, 3)
        counts = np.array([int(words[0]) for words in face_lines], np.int64)
        corner_lists = [[int(word) for word in words[1 : 1 + int(words[0])]] for words in face_lines]
        if any(len(corners) != count for corners, count in zip(corner_lists, counts, strict=True)):
            raise ValueError
        colors = _off_colors([words[3:] for words in vertex_lines]) if header == b"COFF" else None
        face_colors = _off_colors([words[1 + int(words[0]) :] for words in face_lines])
    except InputError:
        raise
    except (ValueError, IndexError, OverflowError):
        raise InputError(f"{path}: the OFF file holds a line that cannot be read; it is damaged") from None
    corners = np.array([corner for corner_list in corner_lists for corner in corner_list], np.int64)
    if len(corners) and (corners.min() < 0 or corners.max() >= vertex_count):
        bad = corners.min() if corners.min() < 0 else corners.max()
        raise InputError(f"{path}: a face names vertex {bad}, but there are {vertex_count} (counted from 0)")
    triangles, owner = triangulate(vertices, corners, counts)
    part = Part(path.stem, vertices, corners[triangles], colors=colors)
    if face_colors is not None and colors is None:
        part.face_colors = face_colors[owner]
    return [part]


def _off_colors(rows: list[list[bytes]]) -> np.ndarray | None:
    """Return (N, 3) linear colours where every row has at least three values, else None.

    Whole numbers run to 255, numbers with a point to 1. One number is an index into a colour
    map that the file does not hold.
    """
    if not rows or min(len(row) for row in rows) < 3:
        return None
    values = np.array([[float(word) for word in row[:3]] for row in rows])
    whole = not any(b"." in word for row in rows for word in row[:3])
    return linear_from_srgb(values / 255.0 if whole else values)
