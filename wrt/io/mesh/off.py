"""OFF: the Object File Format."""

from __future__ import annotations

from pathlib import Path

from wrt.errors import warn
from wrt.io.encodings import as_text
from wrt.io.mesh.parts import Part
from wrt.io.mesh.trimesh_loaders import load, part_of


def read_off(path: Path, data: bytes) -> list[Part]:
    """Return the one part of the file, or none if it has no triangles."""
    text = as_text(data)
    if text.lstrip()[:4].upper() == "COFF":
        warn(f"{path}: the vertex colours of the OFF file are left out")
    part = part_of(path, path.stem, load(path, text, "off"))
    return [] if part is None else [part]
