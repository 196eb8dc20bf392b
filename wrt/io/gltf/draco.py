"""Meshes of glTF files that Draco has compressed, turned into plain accessors.

Format: Khronos Group 2018, KHR_draco_mesh_compression.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.io import memory_limits
from wrt.io.gltf.buffers import TYPES, Buffers, Tree
from wrt.io.safe_read import first_line

_NAME = "KHR_draco_mesh_compression"
_TRIANGLES = 4


def decompress(tree: Tree, buffers: Buffers) -> None:
    """Replace the compressed primitives of all meshes by plain ones, whose attributes may then be moved by skins.

    Raises:
        InputError: where the decoder is not installed, or data are damaged.
    """
    for mesh in tree.get("meshes", []):
        for primitive in mesh["primitives"]:
            if _NAME in primitive.get("extensions", {}):
                _decompress(tree, primitive, buffers)


def _decompress(tree: Tree, primitive: Tree, buffers: Buffers) -> None:
    try:
        import DracoPy
    except ImportError:
        raise InputError(
            f"{buffers.path}: its meshes are compressed by Draco, which needs a decoder: pip install 'wrt[draco]'"
        ) from None
    packed, attributes = primitive["extensions"].pop(_NAME), primitive["attributes"]
    try:
        held = DracoPy.decode(buffers.view(packed["bufferView"]))
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001 - the decoder's exceptions on damaged data are not documented
        raise InputError(f"{buffers.path}: data of Draco cannot be decoded: {first_line(error)}") from None
    rows = {each["unique_id"]: each["data"] for each in held.attributes}
    for name, number in packed["attributes"].items():
        if name in attributes and number in rows:
            accessor = tree["accessors"][attributes[name]]
            attributes[name] = _added(buffers, _as_described(np.asarray(rows[number]), accessor))
    faces = getattr(held, "faces", None)
    if faces is not None:  # otherwise it is a cloud of points
        primitive["indices"] = _added(buffers, np.asarray(faces).astype(np.uint32).ravel())
        primitive["mode"] = _TRIANGLES


def _as_described(values: NDArray[Any], accessor: Tree) -> NDArray[Any]:
    """Return the rows of an attribute as the accessor counts them: Draco may hold 16 bits in 32."""
    kind = np.dtype(TYPES[accessor["componentType"]])
    if values.ndim == 1:
        values = values[:, None]
    if accessor.get("normalized") and kind.kind in "iu" and values.dtype.kind in "iu":
        return np.maximum(values / float(np.iinfo(kind.name).max), -1.0).astype(np.float32)
    return values


def _added(buffers: Buffers, values: NDArray[Any]) -> int:
    memory_limits.take(memory_limits.MESHES, 4 * values.size)
    return buffers.add(values)
