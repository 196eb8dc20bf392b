"""Wavefront OBJ with its MTL materials.

Format: Wavefront, "Advanced Visualizer Manual", appendix B1. Read here rather than by trimesh
because files in the wild count vertices backwards between vertex lists, end lines in comments,
mix corner styles and hold concave polygons, all of which must come out right.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.formats.images import linear_from_srgb, load_image
from wrt.formats.parts import Part, checked_positions, warn
from wrt.formats.polygons import triangulate, unify
from wrt.textures import ColorSource, ImageTexture

_MAP_OPTIONS = {b"-blendu": 1, b"-blendv": 1, b"-cc": 1, b"-clamp": 1, b"-bm": 1, b"-boost": 1, b"-texres": 1}
_MAP_OPTIONS |= {b"-imfchan": 1, b"-type": 1, b"-mm": 2}
_MAP_VECTORS = (b"-o", b"-s", b"-t")  # one to three numbers follow


@dataclass
class _Statements:
    """The lines of a file, sorted by what they are."""

    v: list[list[bytes]] = field(default_factory=list)
    vt: list[list[bytes]] = field(default_factory=list)
    vn: list[list[bytes]] = field(default_factory=list)
    corners: list[bytes] = field(default_factory=list)
    counts: list[int] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)
    relative: dict[int, tuple[int, int, int]] = field(default_factory=dict)
    materials: dict[bytes, int] = field(default_factory=lambda: {b"": 0})
    face_material: list[int] = field(default_factory=list)
    libraries: list[bytes] = field(default_factory=list)


def read_obj(path: Path, data: bytes) -> list[Part]:
    """Return a part for each material.

    Raises:
        InputError: on numbers that cannot be read and on indices that name nothing.
    """
    statements = _scan(data)
    if not statements.corners:
        return []
    vertices, colors = _vertices(path, statements.v)
    uvs = _numbers(path, "vt", statements.vt, 2)
    normals = _numbers(path, "vn", statements.vn, 3)
    counts = np.array(statements.counts, np.int64)
    index = _indices(path, statements, counts, (len(vertices), len(uvs), len(normals)))
    if (counts < 3).any():
        short = int((counts < 3).sum())
        line = statements.lines[int(np.argmax(counts < 3))]
        warn(f"{path}: {short} face(s) with fewer than 3 corners left out, the first in line {line}")
    used = np.zeros(len(vertices), bool)
    used[index[:, 0]] = True
    checked_positions(path, vertices, used, what="'v' number", base=1)
    triangles, owner = triangulate(vertices, index[:, 0], counts)
    materials = _materials(path, statements.libraries)
    face_material = np.array(statements.face_material)[owner]
    parts = []
    for name, number in statements.materials.items():
        chosen = triangles[face_material == number]
        if not len(chosen):
            continue
        v, vt, vn = index[chosen.reshape(-1)].T
        faces, first = unify(v, vt, vn)
        label = name.decode("utf-8", "replace") or path.stem
        part = Part(label, vertices[v[first]], faces.reshape(-1, 3))
        if colors is not None:
            part.colors = colors[v[first]]
        # Attributes that only some corners name are zero elsewhere, which for normals means "compute".
        if (vt >= 0).any():
            part.uvs = np.where(vt[first, None] >= 0, uvs[vt[first]], 0.0)
        if (vn >= 0).any():
            part.normals = np.where(vn[first, None] >= 0, normals[vn[first]], 0.0)
        part.reflectance = materials.get(name)
        parts.append(part)
    return parts


def _scan(data: bytes) -> _Statements:
    found = _Statements()
    v, vt, vn, material = found.v, found.vt, found.vn, 0
    if b"\\" in data:
        data = data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")
    for number, line in enumerate(data.splitlines(), 1):
        if b"#" in line:
            line = line[: line.index(b"#")]
        words = line.split()
        if not words:
            continue
        key = words[0]
        if key == b"v":
            v.append(words[1:])
        elif key == b"f":
            if b"-" in line:
                found.relative[len(found.counts)] = (len(v), len(vt), len(vn))
            found.corners += words[1:]
            found.counts.append(len(words) - 1)
            found.lines.append(number)
            found.face_material.append(material)
        elif key == b"vt":
            vt.append(words[1:3] if len(words) > 2 else [*words[1:2], b"0"])
        elif key == b"vn":
            vn.append(words[1:4])
        elif key == b"usemtl":
            material = found.materials.setdefault(b" ".join(words[1:]), len(found.materials))
        elif key == b"mtllib":
            found.libraries.append(line.split(None, 1)[1].strip() if len(words) > 1 else b"")
    return found


def _numbers(path: Path, key: str, rows: list[list[bytes]], width: int) -> NDArray[np.float64]:
    if not rows:
        return np.zeros((1, width))[:0]
    try:
        return np.array([float(word) for row in rows for word in row]).reshape(len(rows), width)
    except ValueError:
        for number, row in enumerate(rows, 1):
            text = b" ".join(row).decode("utf-8", "replace")
            try:
                good = len([float(word) for word in row]) == width
            except ValueError:
                good = False
            if not good:
                raise InputError(f"{path}: {key!r} number {number} must be {width} numbers, not {text!r}") from None
        raise


def _vertices(path: Path, rows: list[list[bytes]]) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """Return positions, and colours where every line has them: x y z r g b, or x y z w r g b."""
    widths = {len(row) for row in rows}
    if len(widths) == 1 and (width := widths.pop()) in (6, 7):
        values = _numbers(path, "v", rows, width)
        colors = values[:, -3:]
        if np.nanmax(np.where(np.isfinite(colors), colors, 0.0)) > 1.0:
            colors = colors / 255.0
        return values[:, :3], linear_from_srgb(colors)
    return _numbers(path, "v", [row[:3] for row in rows], 3), None


def _indices(
    path: Path, found: _Statements, counts: NDArray[np.int64], sizes: tuple[int, int, int]
) -> NDArray[np.int64]:
    """Return (C, 3) indices from 0 of position, texture coordinate and normal; -1 where not given."""
    slashes = {corner.count(b"/") for corner in found.corners}
    if len(slashes) > 1:
        corners = [corner + b"/0" * (2 - corner.count(b"/")) for corner in found.corners]
    else:
        corners = found.corners
    # "1//3" and "1/2/" leave an index out; 0 stands for that, as no index of the format is 0.
    text = (b" ".join(corners) + b" ").replace(b"//", b"/0/").replace(b"/ ", b"/0 ").replace(b"/", b" ")
    try:
        flat = np.array([int(word) for word in text.split()], np.int64)
        given = flat.reshape(len(found.corners), -1)
        if given.shape[1] > 3:
            raise ValueError
    except (ValueError, OverflowError):
        for corner, line in zip(found.corners, np.repeat(found.lines, counts), strict=True):
            words = corner.split(b"/")
            if len(words) > 3 or not words[0] or any(w and not w.lstrip(b"+-").isdigit() for w in words):
                text_bad = corner.decode("utf-8", "replace")
                raise InputError(f"{path}: line {line}: {text_bad!r} is not a corner of a face") from None
        raise InputError(f"{path}: a face holds an index that cannot be read") from None
    index = np.zeros((len(given), 3), np.int64)
    index[:, : given.shape[1]] = given
    if found.relative:
        polygons = np.array(list(found.relative))
        base = np.zeros((len(counts), 3), np.int64)
        base[polygons] = np.array(list(found.relative.values()))
        index = np.where(index < 0, index + np.repeat(base, counts, axis=0) + 1, index)
        below = (index <= 0) & (np.pad(given, ((0, 0), (0, 3 - given.shape[1]))) < 0)
    else:
        below = np.zeros(index.shape, bool)
    wrong = below | (index > np.array(sizes))
    wrong[:, 0] |= index[:, 0] == 0
    if wrong.any():
        corner_number, which = (int(x) for x in np.argwhere(wrong)[0])
        line = int(np.repeat(found.lines, counts)[corner_number])
        what = ("v", "vt", "vn")[which]
        corner_text = found.corners[corner_number].decode()
        raise InputError(
            f"{path}: line {line}: face corner {corner_text!r} names a {what!r} that is not there ({sizes[which]} are)"
        )
    return index - 1


def _materials(path: Path, libraries: list[bytes]) -> dict[bytes, ColorSource]:
    result: dict[bytes, ColorSource] = {}
    for library in dict.fromkeys(libraries):
        # A name may hold spaces, but several names may also share the line.
        whole = path.parent / _file_name(library)
        files = [whole] if whole.is_file() else [path.parent / _file_name(word) for word in library.split()]
        for file in files:
            try:
                data = file.read_bytes()
            except (OSError, ValueError):
                warn(f"{path}: material file {str(file)!r} cannot be read; the default reflectance is used")
                continue
            result.update(_read_mtl(file, data))
    return result


def _read_mtl(path: Path, data: bytes) -> dict[bytes, ColorSource]:
    colors: dict[bytes, tuple[float, float, float]] = {}
    images: dict[bytes, bytes] = {}
    name: bytes | None = None
    names = []
    for line in data.splitlines():
        words = line.split()
        if not words:
            continue
        key = words[0].lower()
        if key == b"newmtl":
            name = b" ".join(words[1:])
            names.append(name)
        elif name is not None and key == b"kd":
            try:
                values = [float(word) for word in words[1:4]]
            except ValueError:
                continue  # a spectral curve or CIE XYZ; nobody writes those
            values = values * 3 if len(values) == 1 else values
            if len(values) == 3 and np.isfinite(values).all():
                r, g, b = np.clip(values, 0.0, 1.0)
                colors[name] = (float(r), float(g), float(b))
        elif name is not None and key == b"map_kd":
            images[name] = _without_options(line.split(None, 1)[1]) if len(words) > 1 else b""
    result: dict[bytes, ColorSource] = {}
    loaded: dict[bytes, NDArray[np.float32]] = {}
    for name in names:
        if name in colors:
            result[name] = colors[name]
        if not images.get(name):
            continue
        file_name = images[name]
        file = path.parent / _file_name(file_name)
        try:
            if file_name not in loaded:
                loaded[file_name] = load_image(file)
        except InputError as error:
            warn(f"{path}: texture left out: {error}")
            continue
        # Many exporters write Kd 0 0 0 beside an image; black would hide it.
        factor = np.array(colors.get(name, (1.0, 1.0, 1.0)), np.float32)
        pixels = np.clip(loaded[file_name], 0.0, 1.0)
        result[name] = ImageTexture(pixels * factor if factor.any() else pixels, file.name)
    return result


def _without_options(text: bytes) -> bytes:
    """Return the file name of a map statement: what follows its options, spaces included."""
    text = text.strip()
    while text.startswith(b"-"):
        words = text.split()
        take = 1 + _MAP_OPTIONS.get(words[0], 0)
        if words[0] in _MAP_VECTORS:
            while take < min(4, len(words)) and _is_number(words[take]):
                take += 1
        elif words[0] not in _MAP_OPTIONS:
            break
        for _ in range(take):
            text = text.split(None, 1)[1] if len(text.split(None, 1)) > 1 else b""
    return text


def _is_number(word: bytes) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _file_name(name: bytes) -> str:
    """Return a file name from a statement: quotes dropped, Windows' separators turned round."""
    return name.strip().strip(b'"').decode("utf-8", "surrogateescape").replace("\\", "/")
