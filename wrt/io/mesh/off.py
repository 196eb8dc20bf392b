"""OFF: the Object File Format of Geomview, as text and binary, with colours, normals and texture coordinates.

Format: Phillips, Levy and Munzner 1996, "Geomview Manual", section 4.2.2. Of binary files there are two kinds: the
manual's, big-endian with a count of colours behind each face, and little-endian ones without it.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, warn
from wrt.io import memory_limits
from wrt.io.encodings import as_text
from wrt.io.mesh.parts import Part, checked_faces, only_points
from wrt.io.mesh.polygons import triangulate
from wrt.io.mesh.trimesh_loaders import decoded

_HEADER = re.compile(r"\s*(?P<st>ST)?(?P<c>C)?(?P<n>N)?(?P<beyond>4?n?)OFF\b")
_BINARY = re.compile(rb"\s*((?:ST)?C?N?4?n?OFF)[ \t]+BINARY[ \t\r]*\n")

_Int = NDArray[np.int64]


def read_off(path: Path, data: bytes) -> list[Part]:
    """Return the one part of the file, or none if it has no triangles.

    Raises:
        InputError: on a damaged file, on one of points alone, and on points with four or n coordinates.
    """
    binary = _BINARY.match(data)
    text = binary[1].decode() if binary else re.sub(r"#[^\n]*", "", as_text(data))
    header = _HEADER.match(text)
    if header is None:
        raise InputError(f"{path}: not an OFF file: it does not begin with OFF")
    if header["beyond"]:
        raise InputError(f"{path}: an OFF file of points with more than three coordinates; write it with three")
    try:
        # A number that is none ends the array with a warning only.
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("error", DeprecationWarning)
            rows, corners, counts = (
                _of_bytes(data[binary.end() :], header) if binary else _of_text(text[header.end() :])
            )
    except (ValueError, OverflowError, DeprecationWarning) as error:
        raise InputError(f"{path}: not a whole OFF file that can be read: {error}") from None
    part = _part(path, rows, corners, counts, header)
    if part is None and len(rows) and not len(counts):
        raise InputError(f"{path}: {only_points(len(rows))}")
    return [] if part is None else [part]


def _part(path: Path, rows: NDArray[Any], corners: _Int, counts: _Int, header: re.Match[str]) -> Part | None:
    """Return the polygons as triangles; `rows` are the numbers of the vertices."""
    if not len(corners):
        return None
    checked_faces(path, corners, len(rows))
    vertices = rows[:, :3]
    triangles, _ = triangulate(vertices, corners, counts)
    if memory_limits.patience() <= 0:
        warn(f"{path}: its concave polygons take too long to cut into triangles; some of them come out as fans")
    if not len(triangles):
        return None
    part = Part(path.stem, vertices, corners[triangles])
    more = rows[:, 3:]
    if header["n"] and more.shape[1] >= 3:
        part.normals, more = more[:, :3], more[:, 3:]
    if header["st"] and more.shape[1] >= 2:
        part.uvs, more = more[:, -2:], more[:, :-2]
    if header["c"]:
        if more.shape[1] in (3, 4):
            part.colors = decoded(more)
        else:
            warn(f"{path}: the vertex colours of the OFF file are left out: they are not three or four numbers each")
    return part


def _of_text(text: str) -> tuple[NDArray[np.float64], _Int, _Int]:
    """Return (N, columns) numbers of vertices, the corners of all polygons and their count for each polygon."""
    lines = [line for line in text.splitlines() if line and not line.isspace()]
    sizes = [int(word) for word in lines[0].split()] if lines else []
    if len(sizes) < 2 or min(sizes) < 0:
        raise ValueError("the numbers of its vertices and faces are missing")
    vertices, faces = sizes[:2]
    if len(lines) < 1 + vertices + faces:
        raise ValueError(f"{len(lines) - 1} of {vertices + faces} vertices and faces are there; it is truncated")
    values = _numbers(lines[1 : 1 + vertices])
    if vertices and (values.size % vertices or values.size < 3 * vertices):
        # Some vertices have colours, others none.
        values = _numbers([" ".join(line.split()[:3]) for line in lines[1 : 1 + vertices]])
        if values.size != 3 * vertices:
            raise ValueError("a vertex has fewer than three numbers")
    rows = values.reshape(vertices, -1) if vertices else np.zeros((0, 3))
    behind = lines[1 + vertices :]
    found = None if len(behind) == faces else _stream(behind, faces)
    return (rows, *(found or _polygons(behind[:faces])))


def _stream(lines: Sequence[str], faces: int) -> tuple[_Int, _Int] | None:
    """Return the polygons of a file whose faces are not a line each, or None where it is not that."""
    words = " ".join(lines).split()
    if not all(word.isdecimal() for word in words):
        return None
    values = np.array(words, np.int64)
    found = list(_walk(values, faces, colored=False))
    return _taken(values, found) if len(found) == faces and (not found or found[-1][1] == len(values)) else None


def _taken(words: NDArray[Any], found: Sequence[tuple[int, int, int]]) -> tuple[_Int, _Int]:
    """Return the corners of all polygons, which `_walk` found, and their count for each polygon."""
    pieces = [words[start:stop] for start, _, stop in found]
    return np.concatenate([np.zeros(0, np.int64), *pieces]).astype(np.int64), np.array(
        [len(piece) for piece in pieces], np.int64
    )


def _polygons(lines: Sequence[str]) -> tuple[_Int, _Int]:
    values = _numbers(lines)
    if lines and values.size % len(lines) == 0:
        table = values.reshape(len(lines), -1)
        size = int(table[0, 0])
        if 0 < size < table.shape[1] and (table[:, 0] == size).all():
            return table[:, 1 : 1 + size].astype(np.int64).ravel(), np.full(len(lines), size)
    words = [line.split() for line in lines]
    counts = np.array([int(row[0]) for row in words], np.int64)
    if any(count < 0 or count >= len(row) for count, row in zip(counts, words, strict=True)):
        raise ValueError("a face has fewer corners than it says")
    corners = [int(word) for count, row in zip(counts, words, strict=True) for word in row[1 : 1 + count]]
    return np.array(corners, np.int64), counts


def _numbers(lines: Sequence[str]) -> NDArray[np.float64]:
    return np.fromstring(" ".join(lines), np.float64, sep=" ") if lines else np.zeros(0)


def _of_bytes(data: bytes, header: re.Match[str]) -> tuple[NDArray[np.float64], _Int, _Int]:
    """Return the same of a binary file, in the one of the two kinds of which it has the length."""
    columns = 3 + (3 if header["n"] else 0) + (4 if header["c"] else 0) + (2 if header["st"] else 0)
    for order, colored in ((">", True), ("<", False), ("<", True), (">", False)):
        whole = np.frombuffer(data, f"{order}i4", len(data) // 4)
        if len(whole) < 3:
            continue
        vertices, faces = int(whole[0]), int(whole[1])
        end = 3 + vertices * columns
        if vertices < 0 or faces < 0 or end + faces > len(whole):
            continue
        found = list(_walk(whole[end:], faces, colored))
        if len(found) == faces and (not found or found[-1][1] == len(whole) - end):
            rows = whole[3:end].view(f"{order}f4").reshape(vertices, columns).astype(np.float64)
            return (rows, *_taken(whole[end:], found))
    raise ValueError("it is not as long as its numbers of vertices and faces say")


def _walk(words: NDArray[Any], faces: int, colored: bool) -> Iterator[tuple[int, int, int]]:
    """Yield for each face where its corners begin, where the face ends, and where its corners end."""
    values = words.tolist()
    at = 0
    for _ in range(faces):
        if at >= len(values) or not 0 <= values[at] < len(values) - at:
            return
        start, stop = at + 1, at + 1 + values[at]
        at = stop
        if colored:
            if at >= len(values) or not 0 <= values[at] <= 4:
                return
            at += 1 + values[at]
        yield start, at, stop
