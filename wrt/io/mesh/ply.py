"""Stanford PLY, loaded by trimesh, and its triangle strips, which trimesh leaves as they are.

Format: Turk 1994, "The PLY Polygon File Format".
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.io.encodings import as_utf8
from wrt.io.mesh.parts import Part, only_points
from wrt.io.mesh.ply_lists import triangulated
from wrt.io.mesh.polygons import split_strips
from wrt.io.mesh.trimesh_loaders import is_stand_in, load, part_of, reflectance


def read_ply(path: Path, data: bytes) -> list[Part]:
    """Return the file's surface as one part; none where it has no faces or strips.

    Raises:
        InputError: on what trimesh cannot read and on data that end too soon.
    """
    data = as_utf8(data)
    header = data[: data.find(b"end_header")]
    if b"<this>" in header:  # MeshLab's word for the name of the file itself
        data = header.replace(b"<this>", path.stem.encode()) + data[len(header) :]
    try:
        # Coordinates at corners part vertices. Ones at vertices need not, and trimesh would leave
        # the normals and colours behind.
        # Anywhere: trimesh is content with less than "format ascii", and views are of no use to its reader of text.
        views = b"ascii" not in header.lower()
        fields = load(path, data, "ply", views=views, fix_texture=b"texcoord" in header)
    except InputError as error:
        # NumPy's words where coordinates at corners differ in number from face to face
        ragged = "array element with a sequence" in str(error) and b"format ascii" in header
        if "unexpected length" not in str(error) and not ragged:
            raise
        try:
            data = triangulated(data)
        except ValueError as reason:
            raise InputError(f"{path}: the data are not as long as the PLY header says: {reason}") from None
        header = data[: data.find(b"end_header")]
        fields = load(path, data, "ply", views=True, fix_texture=b"texcoord" in header)
    elements = fields["metadata"]["_ply_raw"]
    for name, element in elements.items():
        # trimesh takes as many lines of text as there are; it makes records of binary data.
        columns = element.get("data", {})
        held = next(iter(columns.values()), ()) if isinstance(columns, dict) else None
        if b"format ascii" in header and held is not None and len(held) < element["length"]:
            raise InputError(f"{path}: {len(held)} of {element['length']} {name!r} rows are there; it is truncated")
    strips = strips_of(elements)
    if len(strips):
        faces = np.asarray(fields.get("faces", np.zeros((0, 3), np.int64)))
        fields["faces"] = np.concatenate([faces, strips]) if faces.shape[1:] == (3,) else strips
    part = part_of(path, path.stem, fields)
    if part is None:
        if count := len(fields.get("vertices", ())):
            raise InputError(f"{path}: {only_points(count)}")
        return []
    image = getattr(getattr(fields.get("visual"), "material", None), "image", None)
    if not is_stand_in(image):
        part.reflectance = reflectance(path, f"{path.name} image", image, None)
    return [part]


def strips_of(elements: dict[str, Any]) -> NDArray[np.int64]:
    """Return (T, 3) triangles of the element that programs of Stanford's school write instead of faces."""
    data = elements.get("tristrips", {}).get("data")
    if isinstance(data, np.ndarray):  # binary: records of a count and that many indices
        lists = [name for name in data.dtype.names or () if data.dtype[name].names]
        rows = [row["f1"] for name in lists for row in data[name]]
    else:
        rows = [row for column in (data or {}).values() for row in column]
    # Each row is a strip of its own, and -1 starts another within it.
    pieces = [np.append(np.asarray(row, np.int64), -1) for row in rows]
    return split_strips(np.concatenate(pieces)) if pieces else np.zeros((0, 3), np.int64)
