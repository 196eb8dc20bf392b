"""STL, binary and as text."""

from __future__ import annotations

import contextlib
from pathlib import Path

import numpy as np

from wrt.errors import InputError, warn
from wrt.io.mesh.parts import Part
from wrt.io.mesh.trimesh_loaders import load, part_of
from wrt.io.safe_read import as_text, as_utf8
from wrt.scene.normals import same_positions


def read_stl(path: Path, data: bytes) -> list[Part]:
    """Return a part for each solid, corners at one position merged."""
    with contextlib.suppress(InputError):  # a binary file may begin with the bytes of a mark
        plain = as_utf8(data)
        data = plain if plain.lstrip()[:5].lower() == b"solid" else data
    count = int.from_bytes(data[80:84], "little")
    size = 84 + 50 * count
    text = data.lstrip()[:5].lower() == b"solid" and b"facet" in data[:4096].lower()
    if not text and count and len(data) < size:
        raise InputError(f"{path}: the STL header says {count} triangles, which the file is too short for: truncated")
    if text and b"endsolid" not in data[-4096:].lower():
        raise InputError(f"{path}: the text of the STL file ends inside a solid; it is truncated")
    if not text and not count and len(data) >= size:
        return []
    # trimesh takes a binary file with something behind the triangles for text.
    if not text and count:
        data = data[:size]
    if text:
        data = as_text(data).replace("\r\n", "\n").replace("\r", "\n").encode("utf-8", "replace")
    loaded = load(path, data, "stl")
    parts, solids = [], loaded.get("geometry", {path.stem: loaded}).values()
    with np.errstate(invalid="ignore"):  # signalling NaN
        has_normals = any(np.any(fields.get("face_normals", 1.0)) for fields in solids)
    if not has_normals:
        warn(f"{path}: the STL file has no normals; which side is the front is taken from the order of corners")
    for fields in solids:
        name = fields.get("metadata", {}).get("name") or path.stem
        part = part_of(path, str(name), fields)
        if part is not None:
            with np.errstate(over="ignore", invalid="ignore"):  # of positions that are refused later
                same = same_positions(np.asarray(part.vertices, np.float32))
            _, first = np.unique(same, return_index=True)
            corner = "a corner of a triangle"
            parts.append(Part(part.name, part.vertices[first], same[part.faces], vertex_format=corner))
    return parts
