"""Wavefront OBJ: its faces, with the materials of MTL files.

Format: Wavefront, "Advanced Visualizer Manual", appendix B1.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, warn
from wrt.io.account import warn_of_unused
from wrt.io.mesh.mtl import MtlMaterials, Statements, statements_of
from wrt.io.mesh.obj_text import ObjText
from wrt.io.mesh.parts import FloatArray, Part, decoded, points_of
from wrt.io.mesh.polygons import outer_sides, triangulate
from wrt.io.mesh.sidecars import Sidecars, in_any_case
from wrt.io.safe_read import as_text, as_utf8, naming_file, read_file

_BETWEEN_FILES = re.compile(r"(?<=\.mtl)\s+", re.IGNORECASE)

WITHOUT_EFFECT = {
    "[go]": "names",
    "mg": "of free-form surfaces",
    "bevel": "how other renderers interpolate over faces",
    "[cd]_interp": "the same",
    "lod": "the level of detail of a display",
}
"""Statements that do not change a picture, and the reason."""


def read_obj(path: Path, data: bytes) -> list[Part]:
    """Return a part for each material, and for faces with and without texture coordinates and normals.

    Raises:
        InputError: on what is no number where one should be, and on faces that name nothing.
    """
    text = ObjText(path, as_utf8(data))
    sidecars = Sidecars(path)
    described = _materials(path, text, sidecars)
    materials = MtlMaterials(path, sidecars.find)
    parts, names = [], list(text.materials)
    for number, part in _parts(path, text):
        part.name = names[number] if names[number] in described else path.stem
        statements = described.get(names[number])
        parts.append(materials.dressed(part, names[number], statements) if statements else part)
    materials.warn_of_unused()
    if not parts and len(text.rows["v"]):
        parts = [points_of(path.stem, text.rows["v"][:, :3], _colors(path, text))]
    if not parts and not len(text.rows["v"]):
        raise InputError(f"{path}: not an OBJ file: none of its lines is a vertex, v x y z")
    if parts:
        warn_of_unused(path, text.others.elements(), WITHOUT_EFFECT)
    return parts


def _parts(path: Path, text: ObjText) -> Iterator[tuple[int, Part]]:
    """Yield the number of a material and its triangles, in the order of the file."""
    if short := np.count_nonzero(text.counts < 3) + text.others.pop("f", 0):
        warn(f"{path}: {short} face(s) with fewer than 3 corners left out")
    if not (text.counts >= 3).any():
        return
    # A face has texture coordinates or normals if all of its corners have.
    starts, groups = np.cumsum(text.counts) - text.counts, text.face_materials * 4
    for column in (1, 2):
        named = np.logical_and.reduceat(text.corners[:, column] >= 0, starts)
        if not named.all():
            text.corners[~np.repeat(named, text.counts), column] = -1
        groups += column * named
    corners, sources = _vertices(text.corners, len(text.rows["v"]))
    rows = {kind: values.take(sources[k], axis=0) for k, (kind, values) in enumerate(text.rows.items()) if len(values)}
    positions, colors = rows["v"][:, :3], _colors(path, text)
    if colors is not None:
        colors = colors.take(sources[0], axis=0)
    uvs = rows.get("vt")
    if uvs is not None and uvs.shape[1] == 1:
        uvs = np.pad(uvs, ((0, 0), (0, 1)))
    triangles, owners = triangulate(path, positions, corners, text.counts)
    faces, of_faces, sides = corners[triangles], groups[owners], outer_sides(triangles, owners, text.counts)
    present, first = np.unique(of_faces, return_index=True)
    order = np.argsort(of_faces, kind="stable") if len(present) > 1 else None
    ends = np.searchsorted(of_faces[order], present, side="right") if order is not None else [len(of_faces)]
    pieces = zip(first.tolist(), present.tolist(), [0, *ends[:-1]], ends, strict=True)
    for _, group, begin, end in sorted(pieces):
        used: Any = slice(None)
        chosen: Any = slice(None)
        if order is None:
            part = Part(path.stem, positions, faces)
        else:
            chosen = order[begin:end]
            used, some = np.unique(faces[chosen], return_inverse=True)
            part = Part(path.stem, positions[used], some.reshape(-1, 3))
        if text.face_smoothing is not None:
            part.smoothing = text.face_smoothing[owners[chosen]]
        part.sides = None if sides is None else sides[chosen]
        part.vertex_format = "a vertex"
        part.uvs = uvs[used] if uvs is not None and group & 1 else None
        part.normals = rows["vn"][used] if group & 2 else None
        part.colors = None if colors is None else colors[used]
        yield group >> 2, part


def _colors(path: Path, text: ObjText) -> FloatArray | None:
    """Return the colours of positions, if all have one."""
    if text.colors_are_partial:
        warn(f"{path}: vertex colours are left out, as some vertices have none")
    return decoded(text.rows["v"][:, 3:6]) if text.rows["v"].shape[1] >= 6 else None


def _vertices(corners: NDArray[np.int32], count: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return (C,) a vertex for each corner, and (3, V) what each vertex is made of: position, coordinates, normal.

    Vertices of `count` positions keep their numbers. Where corners at a position name different coordinates or normals,
    further vertices follow, in the order of what they are made of.
    """
    position, *others = corners.T
    example = np.zeros(count, np.int32)
    example[position] = np.arange(len(position), dtype=np.int32)
    sources = np.stack([np.arange(count, dtype=np.int32), *(each[example] for each in others)])
    different = np.zeros(len(position), bool)
    for own, found in zip(others, sources[1:], strict=True):
        different |= own != found[position]
    vertices = np.ascontiguousarray(position)
    if different.any():
        made = corners[different]
        keys = made[:, 0].astype(np.int64)
        for each in made.T[1:]:  # numbers of what is equal so far, as three indices might not fit 64 bits
            keys = np.unique(keys, return_inverse=True)[1] * (int(each.max()) + 2) + each
        _, first, further = np.unique(keys, return_index=True, return_inverse=True)
        vertices[different] = count + further
        sources = np.concatenate([sources, made[first].T], axis=1)
    return vertices, sources


def _materials(path: Path, text: ObjText, sidecars: Sidecars) -> dict[str, Statements]:
    """Return the statements of each material that an OBJ file uses, from the files that it names or the one like it."""
    own_name = f"{path.stem}.mtl"  # people rename a mesh file and forget the name in it
    names: list[str] = []
    for line in dict.fromkeys(text.libraries):
        line = line.replace("\\ ", " ")
        has_spaces = in_any_case(path.parent, line.replace("\\", "/").split("/"))
        names += [line] if has_spaces else _BETWEEN_FILES.split(line)
    used = [name for name in text.materials if name]
    if used and not names:
        guess = in_any_case(path.parent, [own_name])
        names = [] if guess is None else [guess.name]
        instead = "they are left out" if guess is None else f"{str(guess)!r} is taken"
        warn(f"{path}: it names no file (mtllib) that describes its materials, {_and_more(used)}; {instead}")
    found: dict[str, Statements] = {}
    files = 0
    for name in names:
        try:
            is_alone = len(names) == 1 and name.lower().rstrip('" ').endswith(".mtl")
            file = sidecars.find(name, [own_name] if is_alone else [])
            with naming_file(file):
                content = as_text(read_file(file))
        except InputError as error:
            warn(f"{error}; it is left out")
            continue
        files += 1
        sidecars.folders.append(file.parent)  # images of materials lie beside the mesh or beside their own file
        described = statements_of(content)
        warn_of_unused(file, (f"{key} before the first material" for key in described.pop("")), {})
        found |= described
    in_lower_case = {name.lower(): name for name in reversed(found)}
    others = {name: in_lower_case[name.lower()] for name in used if name not in found and name.lower() in in_lower_case}
    for name, other in others.items():
        warn(f"{path}: material {name!r} is not described; {other!r} is taken")
    missing = [name for name in used if name not in found and name not in others]
    if files and missing:
        warn(f"{path}: no material file describes {_and_more(missing)}; the default material is taken")
    return {name: found[others.get(name, name)] for name in used if name in found or name in others}


def _and_more(names: list[str]) -> str:
    return f"{names[0]!r} and {len(names) - 1} more" if len(names) > 1 else repr(names[0])
