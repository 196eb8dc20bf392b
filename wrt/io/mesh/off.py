"""OFF: the Object File Format of Geomview, as text and binary, with colours, normals and texture coordinates.

Format: Phillips, Levy and Munzner 1996, "Geomview Manual", section 4.2.2. Of binary files there are two kinds: the
manual's, big-endian with a count of colours behind each face, and little-endian ones without it.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, warn
from wrt.io.account import warn_of_unused
from wrt.io.mesh.parts import DEFAULT_REFLECTANCE, FloatArray, Part, as_specified, decoded
from wrt.io.mesh.polygons import outer_sides, triangulate
from wrt.io.safe_read import as_text

_HEADER = re.compile(r"\s*(?P<st>ST)?(?P<c>C)?(?P<n>N)?(?P<beyond>4?n?)OFF\b")
_BINARY = re.compile(rb"\s*((?:ST)?C?N?4?n?OFF)[ \t]+BINARY[ \t\r]*\n")

_Int = NDArray[np.int64]
_Polygons = tuple[_Int, _Int, NDArray[np.float64]]
"""The corners of all polygons, one after the other, their number in each polygon, and (P, K) numbers of its colour; NaN
where it has fewer."""


def read_off(path: Path, data: bytes) -> list[Part]:
    """Return the one part of the file, of triangles or of points; none if it has neither.

    Raises:
        InputError: on a damaged file, and on points with four or n coordinates.
    """
    binary = _BINARY.match(data)
    text = binary[1].decode() if binary else re.sub(r"#[^\n]*", "", as_text(data))
    header = _HEADER.match(text)
    if header is None:
        raise InputError(f"{path}: not an OFF file: it does not begin with OFF")
    if header["beyond"]:
        raise InputError(f"{path}: an OFF file of points with more than three coordinates; write it with three")
    unused: list[str] = []
    with warnings.catch_warnings(), np.errstate(all="ignore"), as_specified(path, "OFF", DeprecationWarning):
        warnings.simplefilter("error", DeprecationWarning)  # NumPy only warns about a malformed number
        if binary:
            rows, (corners, counts, colors) = _from_bytes(data[binary.end() :], header)
        else:
            rows, (corners, counts, colors) = _from_text(text[header.end() :], unused)
    if len(rows) and not len(counts):
        part = _part(path, rows, np.arange(len(rows))[:, None], header, unused)
    else:
        triangles, owner = triangulate(path, rows[:, :3], corners, counts)
        part = _part(path, rows, corners[triangles], header, unused)
        part.sides = outer_sides(triangles, owner, counts)
        of_polygons = _face_colors(colors, unused)
        if part.colors is None and of_polygons is not None:
            part.face_colors = of_polygons[owner]
    warn_of_unused(path, unused, {})
    return [part] if len(part.faces) else []


def _face_colors(colors: NDArray[np.float64], unused: list[str]) -> FloatArray | None:
    """Return (P, 3) or (P, 4) linear colours of polygons, or None if there are none; add others to `unused`."""
    sizes = np.isfinite(colors).sum(axis=1)
    has_color = (sizes == 3) | (sizes == 4)
    unused += ["the number of a face's colour in a map"] * int((sizes == 1).sum())
    unused += ["a face's colour that is not three or four numbers"] * int(((sizes > 1) & ~has_color).sum())
    if not has_color.any():
        return None
    rgba = colors[:, :4].copy()
    rgba[~has_color] = 0.0
    rgba[np.isnan(rgba)] = 255.0 if (rgba > 1.0).any() else 1.0  # opaque where the file has no alpha
    found = decoded(rgba)
    found[~has_color] = (*DEFAULT_REFLECTANCE, 1.0)[: found.shape[1]]
    return found


def _part(path: Path, rows: NDArray[Any], faces: _Int, header: re.Match[str], unused: list[str]) -> Part:
    """Return triangles; rows of vertices are positions, normals, colours and texture coordinates in this order."""
    part, columns = Part(path.stem, rows[:, :3], faces), rows[:, 3:]
    if columns.shape[1] < (3 if header["n"] else 0) + (2 if header["st"] else 0):
        warn(f"{path}: normals or texture coordinates are left out: vertices have fewer numbers than its header says")
    if header["n"] and columns.shape[1] >= 3:
        part.normals, columns = columns[:, :3], columns[:, 3:]
    if header["st"] and columns.shape[1] >= 2:
        part.uvs, columns = columns[:, -2:], columns[:, :-2]
    if header["c"]:
        if columns.shape[1] in (3, 4):
            part.colors, columns = decoded(columns), columns[:, :0]
        else:
            warn(f"{path}: the vertex colours of the OFF file are left out: they are not three or four numbers each")
            columns = columns[:, :0]
    unused += ["a number of a vertex beyond those of the header"] * columns.size
    return part


def _from_text(text: str, unused: list[str]) -> tuple[NDArray[np.float64], _Polygons]:
    """Return (N, columns) numbers of vertices, and the polygons; add to `unused` what is neither."""
    lines = [line for line in text.splitlines() if line and not line.isspace()]
    sizes = [int(word) for word in lines[0].split()] if lines else []
    if len(sizes) < 2 or min(sizes) < 0:
        raise ValueError("the numbers of its vertices and faces are missing")
    vertices, faces = sizes[:2]
    if len(lines) < 1 + vertices + faces:
        raise ValueError(f"{len(lines) - 1} of {vertices + faces} vertices and faces are there; it is truncated")
    vertex_lines, face_lines = lines[1 : 1 + vertices], lines[1 + vertices :]
    values = _numbers(vertex_lines)
    if vertices and (values.size % vertices or values.size < 3 * vertices):
        # Some vertices have colours, others none.
        words = [line.split() for line in vertex_lines]
        values = _numbers([" ".join(row[:3]) for row in words])
        unused += ["a number of a vertex that not all have"] * sum(len(row) - 3 for row in words)
        if values.size != 3 * vertices:
            raise ValueError("a vertex has fewer than three numbers")
    rows = values.reshape(vertices, -1) if vertices else np.zeros((0, 3))
    if len(face_lines) != faces:  # then they are not a line each, or something follows them
        flat = " ".join(face_lines).split()
        polygons = _sequence([int(word) for word in flat], faces) if all(map(str.isdecimal, flat)) else None
        if polygons is not None:
            return rows, polygons
        unused += ["a line behind the faces"] * (len(face_lines) - faces)
    return rows, _one_per_line(face_lines[:faces])


def _one_per_line(lines: list[str]) -> _Polygons:
    values = _numbers(lines)
    if lines and values.size % len(lines) == 0:
        table = values.reshape(len(lines), -1)
        size = int(table[0, 0])
        if 0 < size < table.shape[1] and (table[:, 0] == size).all():
            corners = table[:, 1 : 1 + size].astype(np.int64).ravel()
            return corners, np.full(len(lines), size), table[:, 1 + size :]
    words = [line.split() for line in lines]
    counts = [int(row[0]) for row in words]
    if any(count < 0 or count >= len(row) for count, row in zip(counts, words, strict=True)):
        raise ValueError("a face has fewer corners than it says")
    of_faces = [int(word) for count, row in zip(counts, words, strict=True) for word in row[1 : 1 + count]]
    colors = [[float(word) for word in row[1 + count :]] for count, row in zip(counts, words, strict=True)]
    return np.array(of_faces, np.int64), np.array(counts, np.int64), _padded(colors)


def _padded(rows: Sequence[Sequence[float]]) -> NDArray[np.float64]:
    """Return rows of different lengths as one array of up to 5 columns, NaN behind the ends."""
    width = min(max(map(len, rows), default=0), 5)
    return np.array([[*row[:width], *[np.nan] * (width - len(row))] for row in rows]).reshape(len(rows), width)


def _numbers(lines: list[str]) -> NDArray[np.float64]:
    return np.fromstring(" ".join(lines), np.float64, sep=" ") if lines else np.zeros(0)


def _from_bytes(data: bytes, header: re.Match[str]) -> tuple[NDArray[np.float64], _Polygons]:
    """Return what `_from_text` does; which of the two kinds a binary file is follows from its length."""
    columns = 3 + (3 if header["n"] else 0) + (4 if header["c"] else 0) + (2 if header["st"] else 0)
    for order, colored in ((">", True), ("<", False), ("<", True), (">", False)):
        words = np.frombuffer(data, f"{order}i4", len(data) // 4)
        vertices, faces = words[:2].tolist() if len(words) >= 3 else (-1, -1)
        end = 3 + vertices * columns
        if vertices < 0 or faces < 0 or end + faces > len(words):
            continue
        polygons = _sequence(words[end:].tolist(), faces, colored=colored)
        if polygons is not None:
            return words[3:end].view(f"{order}f4").reshape(vertices, columns).astype(np.float64), polygons
    raise ValueError("it is not as long as its numbers of vertices and faces say")


def _sequence(words: list[int], faces: int, *, colored: bool = False) -> _Polygons | None:
    """Return polygons that follow one another, or None unless the words are as many polygons as there are faces.

    Each is its number of corners and the corners; if `colored`, then the number of components of its colour and these.
    """
    corners: list[int] = []
    counts: list[int] = []
    colors: list[NDArray[np.float32]] = []
    at = 0
    for _ in range(faces):
        if at >= len(words) or not 0 <= words[at] < len(words) - at:
            return None
        counts.append(words[at])
        corners += words[at + 1 : at + 1 + words[at]]
        at += 1 + words[at]
        if colored:
            if at >= len(words) or not 0 <= words[at] <= 4:
                return None
            colors.append(np.array(words[at + 1 : at + 1 + words[at]], np.int32).view(np.float32))
            at += 1 + words[at]
    if at != len(words) and faces:
        return None
    return (
        np.array(corners, np.int64),
        np.array(counts, np.int64),
        _padded([color.tolist() for color in colors] or [[]] * faces),
    )
