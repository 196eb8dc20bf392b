"""The numbers of a glTF file: buffers, views of them and accessors, compressed, sparse or quantised.

Format: Khronos Group 2021, "glTF 2.0 Specification", section 3.6; KHR_mesh_quantization and EXT_meshopt_compression.
"""

from __future__ import annotations

import base64
import binascii
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.io import memory_limits
from wrt.io.mesh.sidecars import Sidecars
from wrt.io.safe_read import read_file

Tree: TypeAlias = dict[str, Any]

MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")

TYPES = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


class Buffers:
    """The binary data of one file: its own, those of files that it names, and those in data URIs."""

    def __init__(self, path: Path, tree: Tree, binary: bytes) -> None:
        """Take the JSON of a file, and the binary chunk if it is a GLB."""
        self.path, self._tree, self._binary = path, tree, binary
        self._sidecars = Sidecars(path)
        self._buffers: dict[int, bytes] = {}
        self._views: dict[int, bytes] = {}

    def at_uri(self, uri: str) -> bytes:
        """Return the bytes of a data URI, or of a file that this one names.

        Raises:
            InputError: naming the file, when it cannot be read.
        """
        if uri.startswith("data:"):
            try:
                return base64.b64decode(uri.partition(",")[2])
            except binascii.Error as error:
                raise InputError(f"{self.path}: a data URI in it is damaged: {error}") from None
        return read_file(self._sidecars.find(uri))

    def view(self, number: int) -> bytes:
        """Return the bytes of a buffer view, decompressed."""
        view = self._tree["bufferViews"][number]
        extensions = view.get("extensions", {})
        packed = next((extensions[name] for name in MESHOPT if name in extensions), None)
        if packed is None:
            return self._slice(view)
        if number not in self._views:
            count, stride = packed["count"], packed["byteStride"]
            memory_limits.take(memory_limits.MESHES, count * stride)
            from wrt.io.gltf.meshopt import decoded

            data, mode, kind = self._slice(packed), packed["mode"], packed.get("filter", "NONE")
            self._views[number] = decoded(data, count, stride, mode, kind)
        return self._views[number]

    def _slice(self, view: Tree) -> bytes:
        number, start = view["buffer"], view.get("byteOffset", 0)
        if number not in self._buffers:
            buffer = self._tree["buffers"][number]
            self._buffers[number] = self.at_uri(buffer["uri"]) if "uri" in buffer else self._binary
        return self._buffers[number][start : start + view["byteLength"]]

    def accessor(self, index: int) -> Tree:
        """Return the JSON of an accessor."""
        accessor: Tree = self._tree["accessors"][index]
        return accessor

    def numbers(self, index: int, *, scaled: bool = True) -> NDArray[Any]:
        """Return an accessor's elements, read-only: (N, components) or, of scalars, (N,).

        Args:
            index: number of the accessor.
            scaled: whether normalised integers are converted to float32 from −1 to 1.
        """
        accessor = self.accessor(index)
        kind, width = np.dtype(TYPES[accessor["componentType"]]), _COMPONENTS[accessor["type"]]
        count = accessor["count"]
        memory_limits.take(memory_limits.MESHES, count * width * kind.itemsize)
        values = self._rows(accessor, kind, width, count)
        if sparse := accessor.get("sparse"):
            indices = sparse["indices"]
            rows = self._rows(indices, np.dtype(TYPES[indices["componentType"]]), 1, sparse["count"])[:, 0]
            values = values.copy()
            values[rows] = self._rows(sparse["values"], kind, width, sparse["count"])
        if scaled and accessor.get("normalized"):
            values = normalized(values, kind)
        return values[:, 0] if width == 1 else values

    def _rows(self, source: Tree, kind: np.dtype[Any], width: int, count: int) -> NDArray[Any]:
        if "bufferView" not in source:
            return np.zeros((count, width), kind)
        data = self.view(source["bufferView"])
        stride = self._tree["bufferViews"][source["bufferView"]].get("byteStride") or width * kind.itemsize
        start = source.get("byteOffset", 0)
        if start < 0 or count < 0 or (count and start + (count - 1) * stride + width * kind.itemsize > len(data)):
            raise InputError(f"{self.path}: an accessor reaches beyond its data")
        return np.ndarray((count, width), kind, data, start, (stride, kind.itemsize))


def normalized(values: NDArray[Any], kind: np.dtype[Any]) -> NDArray[Any]:
    """Return integers of an accessor's type as float32 from −1 to 1 (section 3.6.2.2), and other numbers unchanged."""
    if kind.kind not in "iu" or values.dtype.kind not in "iu":
        return values
    return np.asarray(np.maximum(values.astype(np.float32) / float(np.iinfo(kind.name).max), -1.0))
