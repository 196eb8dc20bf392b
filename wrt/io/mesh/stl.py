"""STL, binary and as text, with the colours that programs keep in binary files.

Colours: VisCAM's and SolidView's (Burns 1993, "Automated Fabrication", section 6.5, and their extension), and Magics'
(Materialise, "Magics RP", binary STL header). Both put 5 bits a channel into the attribute word of a triangle.
"""

from __future__ import annotations

import contextlib
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, warn
from wrt.io.account import warn_of_unused
from wrt.io.mesh.parts import DEFAULT_REFLECTANCE, FloatArray, Part, decoded
from wrt.io.mesh.trimesh_loaders import load, part_of
from wrt.io.safe_read import as_text, as_utf8
from wrt.scene.normals import same_positions

_OF_PART = re.compile(rb"COLOR=(.{3})(?: (?=MATERIAL=)|(.))(?:.?MATERIAL=(.{4}))?", re.DOTALL)
"""Colour, alpha and material of the part in a header of Magics; MeshLab writes no alpha, and spaces in its place.

Of a material the diffuse colour is read. Those of ambient light and of highlights have no effect: there is no ambient
light, and without an exponent a highlight has no size.
"""

_SPACES = 0x2020  # the attribute word of old versions of Blender, which have no colours

_NO_COLOR = 0x8000  # of all faces where Autodesk's programs have none, by the rule of Magics but without its header

_UNKNOWN = re.compile(rb"^[ \t]*(?!(?:end)?(?:solid|facet|loop)|outer|vertex)([a-z_]\w*)", re.IGNORECASE | re.MULTILINE)
"""The first word of a line of a text file that is not of the format."""


def read_stl(path: Path, data: bytes) -> list[Part]:
    """Return a part for each solid, corners at one position merged, with the colours of faces."""
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
        unknown = (word.decode("latin-1").lower() for word in _UNKNOWN.findall(data))
        warn_of_unused(path, (f"statement {word!r}" for word in unknown), {})
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
            if "face_attributes" in fields:
                part.face_colors = colors_of(path, fields["face_attributes"]["stl"], data[:80])
            with np.errstate(over="ignore", invalid="ignore"):  # of positions that are refused later
                same = same_positions(np.asarray(part.vertices, np.float32))
            _, first = np.unique(same, return_index=True)
            corner = "a corner of a triangle"
            merged = replace(part, vertices=part.vertices[first], faces=same[part.faces], vertex_format=corner)
            parts.append(merged)
    return parts


def colors_of(source: object, words: NDArray[np.uint16], header: bytes) -> FloatArray | None:
    """Return (M, 3 or 4) linear colours of faces from their attribute words, or None where the words are not colours.

    Bit 15 means that a face has a colour, or with Magics that it has none. MeshLab writes the header of Magics and sets
    the bit in all faces: colours, if they differ.
    """
    flagged = (words >> 15).astype(bool)
    channels = np.column_stack([(words >> shift & 31) / 31.0 for shift in (10, 5, 0)])
    of_part = _OF_PART.search(header)
    if of_part is None:
        if not flagged.any() or (words == _NO_COLOR).all():
            unknown = ~np.isin(words, (0, _SPACES, _NO_COLOR))
            warn_of_unused(source, ["an attribute word that is not a colour"] * np.count_nonzero(unknown), {})
            return None
        colors = decoded(channels)
        colors[~flagged] = DEFAULT_REFLECTANCE
        return colors
    color, alpha, material = of_part.groups()
    shown = material if material and any(material[:3]) else color + (alpha or b"")
    whole = np.frombuffer(shown if alpha else shown[:3] + b"\xff", np.uint8) / 255.0
    own = flagged if flagged.all() and np.ptp(words) else ~flagged & words.any()
    rgba = np.column_stack([channels[:, ::-1], np.ones(len(words))])
    rgba[~own] = *whole[:3], whole[3] or 1.0  # some programs leave alpha at 0
    return decoded(rgba)
