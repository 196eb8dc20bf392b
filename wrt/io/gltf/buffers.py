"""The numbers of a glTF file: buffers, views of them and accessors, compressed, sparse or quantised.

Format: Khronos Group 2021, "glTF 2.0 Specification", section 3.6; KHR_mesh_quantization and EXT_meshopt_compression.
"""

from __future__ import annotations

import base64
import binascii
from pathlib import Path
from typing import Any, TypeAlias
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.io import memory_limits
from wrt.io.safe_read import read_file, reason_alone

Tree: TypeAlias = dict[str, Any]

MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")

TYPES = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_FLOAT, _UNSIGNED = 5126, 5125


class Buffers:
    """The binary data of one file: its own, those beside it, and those in data URIs."""

    def __init__(self, path: Path, tree: Tree, binary: bytes) -> None:
        """Take the JSON of a file, and the binary chunk if it is a GLB."""
        self.path, self._tree, self._binary = path, tree, binary
        self._read: dict[int, bytes] = {}
        self._views: dict[int, bytes] = {}
        self._added = bytearray()

    def located(self, uri: str) -> bytes:
        """Return the bytes of a data URI, or of a file beside this one.

        Raises:
            InputError: naming the file, when it cannot be read.
        """
        if uri.startswith("data:"):
            try:
                return base64.b64decode(uri.partition(",")[2], validate=True)
            except binascii.Error as error:
                raise InputError(f"{self.path}: a data URI in it is damaged: {error}") from None
        file = self.path.parent / unquote(uri)
        try:
            return read_file(file)
        except InputError as error:
            raise InputError(f"{self.path}: {str(file)!r}, which it refers to: {reason_alone(file, error)}") from None

    def view(self, number: int) -> bytes:
        """Return the bytes of a buffer view, decompressed."""
        view = self._tree["bufferViews"][number]
        packed = compression_of(view)
        if packed is None:
            return self._part(view)
        if number not in self._views:
            count, stride = packed["count"], packed["byteStride"]
            memory_limits.take(memory_limits.MESHES, count * stride)
            from wrt.io.gltf.meshopt import decoded

            try:
                self._views[number] = decoded(
                    self._part(packed), count, stride, packed["mode"], packed.get("filter", "NONE")
                )
            except InputError as error:
                raise InputError(f"{self.path}: {error}") from None
        return self._views[number]

    def _part(self, place: Tree) -> bytes:
        number, start = place["buffer"], place.get("byteOffset", 0)
        if self._added and number == len(self._tree["buffers"]):  # by `add`
            return bytes(self._added[start : start + place["byteLength"]])
        if number not in self._read:
            buffer = self._tree["buffers"][number]
            self._read[number] = self.located(buffer["uri"]) if "uri" in buffer else self._binary
        return self._read[number][start : start + place["byteLength"]]

    def numbers(self, index: int) -> NDArray[Any]:
        """Return an accessor's elements as (N, components) or, of scalars, (N,); normalised integers as float32."""
        accessor = self._tree["accessors"][index]
        kind, width, count = (
            np.dtype(TYPES[accessor["componentType"]]),
            _COMPONENTS[accessor["type"]],
            accessor["count"],
        )
        memory_limits.take(memory_limits.MESHES, count * width * kind.itemsize)
        values = np.zeros((count, width), kind)
        if "bufferView" in accessor:
            values[:] = self._rows(accessor, kind, width, count)
        if sparse := accessor.get("sparse"):
            which = sparse["indices"]
            rows = self._rows(which, np.dtype(TYPES[which["componentType"]]), 1, sparse["count"])[:, 0]
            values[rows] = self._rows(sparse["values"], kind, width, sparse["count"])
        if accessor.get("normalized") and kind.kind in "iu":
            values = np.maximum(values.astype(np.float32) / float(np.iinfo(kind.name).max), -1.0)
        return values[:, 0] if width == 1 else values

    def _rows(self, place: Tree, kind: np.dtype[Any], width: int, count: int) -> NDArray[Any]:
        data = self.view(place["bufferView"])
        stride = self._tree["bufferViews"][place["bufferView"]].get("byteStride") or width * kind.itemsize
        start = place.get("byteOffset", 0)
        if start < 0 or count < 0 or (count and start + (count - 1) * stride + width * kind.itemsize > len(data)):
            raise InputError(f"{self.path}: an accessor reaches beyond its data")
        return np.ndarray((count, width), kind, data, start, (stride, kind.itemsize))

    def add(self, values: NDArray[Any]) -> int:
        """Add an array, (N, components) or (N,), to the file as float32 or uint32, and return its accessor's number."""
        whole = values.dtype.kind in "iu"
        data = np.ascontiguousarray(values, np.uint32 if whole else np.float32).tobytes()
        tree = self._tree
        start = len(self._added)
        self._added += data
        tree.setdefault("bufferViews", []).append(
            {"buffer": len(tree["buffers"]), "byteOffset": start, "byteLength": len(data)}
        )
        names = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
        tree["accessors"].append(
            {
                "bufferView": len(tree["bufferViews"]) - 1,
                "componentType": _UNSIGNED if whole else _FLOAT,
                "count": len(values),
                "type": names[1 if values.ndim == 1 else values.shape[1]],
            }
        )
        return len(tree["accessors"]) - 1

    def finish(self) -> None:
        """Put what was added into the tree as one more buffer, and leave no view to be decompressed."""
        tree = self._tree
        for number, view in enumerate(tree.get("bufferViews", [])):
            if compression_of(view) is not None:
                data = self.view(number)
                stride = {"byteStride": view["byteStride"]} if "byteStride" in view else {}
                place = {"buffer": len(tree["buffers"]), "byteOffset": len(self._added), "byteLength": len(data)}
                tree["bufferViews"][number] = {**place, **stride}
                self._added += data
        for buffer in tree.get("buffers", [])[1 if self._binary else 0 :]:
            buffer.setdefault("uri", "data:application/octet-stream;base64,")  # stood in for by compressed views
        for accessor in tree.get("accessors", []):
            if "bufferView" not in accessor:  # trimesh makes zeros of it, even where Draco's data have taken its place
                size = np.dtype(TYPES[accessor["componentType"]]).itemsize
                memory_limits.take(memory_limits.MESHES, accessor["count"] * _COMPONENTS[accessor["type"]] * size)
        if self._added:
            text = base64.b64encode(bytes(self._added)).decode("ascii")
            tree["buffers"].append(
                {"uri": f"data:application/octet-stream;base64,{text}", "byteLength": len(self._added)}
            )


def compression_of(view: Tree) -> Tree | None:
    """Return how a buffer view is compressed, or None."""
    extensions = view.get("extensions", {})
    return next((extensions[name] for name in MESHOPT if name in extensions), None)
