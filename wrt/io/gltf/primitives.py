"""Primitives of glTF files as parts: triangles in any mode, compressed by Draco, moved by morph targets and skins.

Format: Khronos Group 2021, "glTF 2.0 Specification", section 3.7; KHR_draco_mesh_compression.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, warn
from wrt.io import memory_limits
from wrt.io.gltf.buffers import TYPES, Buffers, Tree, normalized
from wrt.io.mesh.parts import Part, decoded, matching
from wrt.io.safe_read import first_line
from wrt.linalg import product

Array = NDArray[np.float64]

POINTS, TRIANGLES, STRIP, FAN = 0, 4, 5, 6
"""Modes of primitives."""

_DRACO = "KHR_draco_mesh_compression"
_WIDTHS = {"NORMAL": (3,), "TANGENT": (4,), "TEXCOORD": (2,), "COLOR": (3, 4)}
"""Numbers of an attribute at each vertex (section 3.7.2.1)."""


@dataclass(frozen=True, eq=False)
class Deformation:
    """How a node moves the vertices of its mesh.

    Attributes:
        weights: of the morph targets.
        joints: (J, 4, 4) transforms by a skin, from the mesh into the world; None without a skin.
    """

    weights: Array
    joints: Array | None


def joint_matrices(skin: Tree, world: dict[int, Array], buffers: Buffers) -> Array:
    """Return (J, 4, 4) what moves vertices with each joint of a skin, given the transforms of all nodes."""
    joints = np.stack([world[number] for number in skin["joints"]])
    if "inverseBindMatrices" not in skin:
        return joints
    inverse = buffers.numbers(skin["inverseBindMatrices"]).astype(np.float64).reshape(-1, 4, 4)
    return product(joints, inverse.transpose(0, 2, 1)[: len(joints)])


class Primitive:
    """One primitive of a mesh, decompressed."""

    def __init__(self, described: Tree, buffers: Buffers) -> None:
        """Take the JSON of the primitive, and the file's binary data.

        Raises:
            InputError: on data that are compressed in a way that cannot be read.
        """
        self._described, self._buffers = described, buffers
        self._unpacked: dict[str, NDArray[Any]] = {}
        self._unpacked_faces: NDArray[Any] | None = None
        if _DRACO in described.get("extensions", {}):
            self._unpack(described["extensions"][_DRACO])

    def part(
        self, name: str, uv_sets: list[int], deformation: Deformation | None
    ) -> tuple[Part, dict[int, NDArray[np.float32]]]:
        """Return the primitive without its material, and (N, 2) texture coordinates, v up, by the number of their set.

        Those of `uv_sets` that it lacks, or that are damaged, are left out.

        Raises:
            InputError: on damaged data.
        """
        # Normals need no unit length, so that integers are not scaled unless they are added to others.
        positions = self._rows("POSITION")
        assert positions is not None  # the reader leaves out others
        count = len(positions)
        normals = self._matching("NORMAL", count, scaled=deformation is not None)
        tangents = None if normals is None else self._matching("TANGENT", count)  # section 3.7.2.1
        if deformation is not None:
            positions, normals, tangents = self._deformed(deformation, positions, normals, tangents)
        faces = self._faces(count)
        if faces.shape[1] == 1:  # points: spheres have normals of their own, and no place for a texture
            uv_sets, normals, tangents = [], None, None
        part = Part(name, positions, faces, normals, tangents=tangents, smoothing=0)
        read = {number: self._matching(f"TEXCOORD_{number}", count) for number in uv_sets}
        if (colors := self._matching("COLOR_0", count, scaled=False)) is not None:
            part.colors = decoded(colors, linear=True)
        sets = {number: rows.astype(np.float32) for number, rows in read.items() if rows is not None}
        return part, {number: np.column_stack([rows[:, 0], 1.0 - rows[:, 1]]) for number, rows in sets.items()}

    def _rows(self, name: str, *, scaled: bool = True) -> NDArray[Any] | None:
        """Return an attribute of the vertices, or None if there is none."""
        if name in self._unpacked:
            return self._unpacked[name]
        index = self._described["attributes"].get(name)
        return None if index is None else self._buffers.numbers(index, scaled=scaled)

    def _matching(self, name: str, count: int, *, scaled: bool = True) -> NDArray[Any] | None:
        """Return an attribute as `_rows` does, unless it does not have its width, or `count` rows."""
        rows = self._rows(name, scaled=scaled)
        if rows is None or (matching(rows, count) is not None and rows.shape[1] in _WIDTHS[name.partition("_")[0]]):
            return rows
        reason = f"it is {' x '.join(map(str, rows.shape))} numbers for {count} vertices"
        warn(f"{self._buffers.path}: {name} of a primitive is left out: {reason}")
        return None

    def _faces(self, count: int) -> NDArray[Any]:
        """Return (T, 3) the triangles of `count` vertices, or (T, 1) the points (section 3.7.2.1)."""
        if self._unpacked_faces is not None:
            return self._unpacked_faces
        indices = self._described.get("indices")
        corners = np.arange(count) if indices is None else self._buffers.numbers(indices).reshape(-1)
        corners = corners if corners.dtype.kind in "iu" else corners.astype(np.int64)
        mode = self._described.get("mode", TRIANGLES)
        if mode in (POINTS, TRIANGLES):
            return corners.reshape(-1, 1 if mode == POINTS else 3)
        first = corners[:-2] if mode == STRIP else np.broadcast_to(corners[:1], len(corners[2:]))
        triangles = np.stack([first, corners[1:-1], corners[2:]], axis=1)
        if mode == STRIP:
            triangles[1::2] = triangles[1::2, ::-1]
        return triangles

    def _unpack(self, packed: Tree) -> None:
        """Decompress the attributes and the triangles by Draco."""
        path, buffers, accessors = self._buffers.path, self._buffers, self._described["attributes"]
        try:
            import DracoPy
        except ImportError:
            reason = "its meshes are compressed by Draco, which needs a decoder: pip install 'wrt[draco]'"
            raise InputError(f"{path}: {reason}") from None
        data = buffers.view(packed["bufferView"])
        try:
            mesh = DracoPy.decode(data)
        except Exception as error:  # noqa: BLE001 - the decoder's exceptions on damaged data are not documented
            raise InputError(f"{path}: data of Draco cannot be decoded: {first_line(error)}") from None
        by_number = {each["unique_id"]: np.asarray(each["data"]) for each in mesh.attributes}
        for name in accessors:
            number = packed["attributes"].get(name)
            if number in by_number:
                values = by_number[number]
                memory_limits.take(memory_limits.MESHES, 4 * values.size)
                accessor = buffers.accessor(accessors[name])
                if accessor.get("normalized"):  # the accessor knows the type; Draco may hold 16 bits in 32
                    values = normalized(values, np.dtype(TYPES[accessor["componentType"]]))
                self._unpacked[name] = values[:, None] if values.ndim == 1 else values
        faces = getattr(mesh, "faces", None)
        if faces is not None:  # otherwise it is a cloud of points
            self._unpacked_faces = np.asarray(faces).astype(np.uint32).reshape(-1, 3)
            memory_limits.take(memory_limits.MESHES, self._unpacked_faces.nbytes)

    # --- Morph targets and skins -------------------------------------------------------------------

    def _deformed(
        self,
        deformation: Deformation,
        positions: NDArray[Any],
        normals: NDArray[Any] | None,
        tangents: NDArray[Any] | None,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32] | None, NDArray[np.float32] | None]:
        """Return moved positions, normals and tangents, whose signs stay."""
        values = {"POSITION": positions.astype(np.float64)}
        if normals is not None:
            values["NORMAL"] = normals.astype(np.float64)
        if tangents is not None:
            values["TANGENT"] = tangents[:, :3].astype(np.float64)
        for weight, target in zip(deformation.weights, self._described.get("targets", []), strict=False):
            for name in values:
                if weight and name in target:
                    values[name] += weight * self._buffers.numbers(target[name])
        if deformation.joints is not None:
            blend = self._blend(deformation.joints, len(positions))
            values["POSITION"] = np.einsum("nij,nj->ni", blend[:, :, :3], values["POSITION"]) + blend[:, :, 3]
            if normals is not None:
                a, b, c = (blend[:, k, :3] for k in range(3))
                cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
                values["NORMAL"] = np.einsum("nij,nj->ni", cofactors, values["NORMAL"])
            if tangents is not None:
                values["TANGENT"] = np.einsum("nij,nj->ni", blend[:, :, :3], values["TANGENT"])
        if tangents is not None:
            values["TANGENT"] = np.column_stack([values["TANGENT"], tangents[:, 3]])
        single = {name: rows.astype(np.float32) for name, rows in values.items()}
        return single["POSITION"], single.get("NORMAL"), single.get("TANGENT")

    def _blend(self, joints: Array, count: int) -> Array:
        """Return (N, 3, 4) the weighted sum of joints for each vertex."""
        blend, total = np.zeros((count, 3, 4)), np.zeros(count)
        for number in itertools.count():  # sets of four joints
            indices, weights = self._rows(f"JOINTS_{number}"), self._rows(f"WEIGHTS_{number}")
            if indices is None or weights is None:
                break
            indices, weights = indices.astype(np.int64), weights.astype(np.float64)
            if indices.max(initial=0) >= len(joints):
                raise InputError(f"{self._buffers.path}: a vertex names a joint that its skin does not have")
            for k in range(4):
                blend += weights[:, k, None, None] * joints[indices[:, k], :3]
                total += weights[:, k]
        blend[total > 0.0] /= total[total > 0.0, None, None]
        blend[total == 0.0] = np.eye(3, 4)
        return blend
