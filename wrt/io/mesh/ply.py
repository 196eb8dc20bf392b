"""Stanford PLY, loaded by trimesh, and its triangle strips, which trimesh does not triangulate.

Format: Turk 1994, "The PLY Polygon File Format". Files whose polygons differ in their number of corners are rewritten
as triangles by `ply_polygons.py` first.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.io.mesh.parts import Part, only_points
from wrt.io.mesh.ply_polygons import with_triangles
from wrt.io.mesh.polygons import split_strips
from wrt.io.mesh.trimesh_loaders import is_stand_in, load, part_of
from wrt.io.safe_read import as_utf8
from wrt.io.texture_images import TextureImages
from wrt.scene.textures import ImageTexture


def read_ply(path: Path, data: bytes) -> list[Part]:
    """Return the file's surface as one part; none where it has no faces or strips.

    Raises:
        InputError: on what trimesh cannot read and on data that end too soon.
    """
    data = as_utf8(data)
    header = data[: data.find(b"end_header")]
    if b"<this>" in header:  # MeshLab's placeholder for the name of the file itself
        data = header.replace(b"<this>", path.stem.encode()) + data[len(header) :]
    try:
        fields = _load(path, data)
    except InputError as error:
        # NumPy's words where coordinates at corners differ in number from face to face
        ragged = "array element with a sequence" in str(error) and b"format ascii" in header
        if "unexpected length" not in str(error) and not ragged:
            raise
        try:
            data = with_triangles(path, data)
        except ValueError as reason:
            raise InputError(f"{path}: the data are not as long as the PLY header says: {reason}") from None
        fields = _load(path, data)
    elements = fields["metadata"]["_ply_raw"]
    if b"format ascii" in data[: data.find(b"end_header")]:
        _check_text_is_complete(path, elements)
    strips = strips_of(elements)
    if len(strips):
        faces = np.asarray(fields.get("faces", np.zeros((0, 3), np.int64)))
        fields["faces"] = np.concatenate([faces, strips]) if faces.shape[1:] == (3,) else strips
    part = part_of(path, path.stem, fields)
    if part is None:
        if count := len(fields.get("vertices", ())):
            raise only_points(path, count)
        return []
    image = getattr(getattr(fields.get("visual"), "material", None), "image", None)
    if image is not None and not is_stand_in(image):
        pixels = TextureImages(path).pixels(0, "color", f"texture {path.name} image", lambda: image)
        part.reflectance = None if pixels is None else ImageTexture(pixels, f"{path.name} image")
    return [part]


def _load(path: Path, data: bytes) -> dict[str, Any]:
    header = data[: data.find(b"end_header")]
    # trimesh reads text where "ascii" stands anywhere, and its reader of text cannot use views. Coordinates at corners
    # split vertices; for coordinates at vertices that is not needed, and trimesh would drop the normals and colours.
    views = b"ascii" not in header.lower()
    return load(path, data, "ply", views=views, fix_texture=b"texcoord" in header)


def _check_text_is_complete(path: Path, elements: dict[str, Any]) -> None:
    """Raise InputError where there are fewer lines than the header says: trimesh takes as many as there are."""
    for name, element in elements.items():
        columns = element.get("data", {})
        first = next(iter(columns.values()), None) if isinstance(columns, dict) else None
        if first is not None and len(first) < element["length"]:
            raise InputError(f"{path}: {len(first)} of {element['length']} {name!r} rows are there; it is truncated")


def strips_of(elements: dict[str, Any]) -> NDArray[np.int64]:
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
