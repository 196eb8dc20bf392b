"""Triangle meshes as plain arrays."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrt.errors import InputError
from wrt.values import array, number, owned, sealed


def box_around(points: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Return the (2, 3) lowest and highest corner of the box around (N, 3) points, at least one."""
    # Column by column: NumPy takes several times as long for short rows.
    return np.array([[function(column) for column in points.T] for function in (np.min, np.max)], np.float64)


SMALLEST, LARGEST = 1e-11, 1e12
"""Metres across that a mesh may have, and from the origin: beyond, products of coordinates leave single precision."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles by index, with optional attributes at the vertices.

    A mesh owns its arrays, which are read-only: it copies the arrays it is given unless they are read-only already.

    Attributes:
        vertices: (N, 3) float32 positions, metres.
        faces: (M, 3) int32 vertex indices; counter-clockwise seen from the front.
        normals: (N, 3) float32 shading normals, or None for flat triangles.
        uvs: (N, 2) float32 texture coordinates, v up, or None; (N, 4) are two sets of them.
        colors: (N, 3) float32 linear Rec. 709, or None; (N, 4) with alpha, 0 to 1, which counts where a material's
            opacity asks for it.
        name: where it came from, for messages.

    Raises:
        InputError: on wrong shapes, no triangles, indices out of range, or values not finite.
    """

    vertices: NDArray[Any] = field(repr=False)
    faces: NDArray[Any] = field(repr=False)
    normals: NDArray[Any] | None = field(default=None, repr=False)
    uvs: NDArray[Any] | None = field(default=None, repr=False)
    colors: NDArray[Any] | None = field(default=None, repr=False)
    name: str = "mesh"

    def __post_init__(self) -> None:
        vertices = self._float_array("vertices", self.vertices, (3,))
        count = len(vertices)
        faces = array(self.faces, f"{self.name}: faces")
        if faces.ndim != 2 or faces.shape[1] != 3:
            raise InputError(f"{self.name}: faces must be (M, 3), not {faces.shape}")
        if len(faces) == 0:
            raise InputError(f"{self.name}: the mesh has no triangles")
        if faces.dtype.kind not in "iu":
            raise InputError(f"{self.name}: faces must be integers, not {faces.dtype}")
        low, high = int(faces.min()), int(faces.max())
        if low < 0 or high >= count:
            bad = low if low < 0 else high
            raise InputError(f"{self.name}: a face names vertex {bad}, but there are {count} vertices")
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", owned(self.faces, f"{self.name}: faces", np.int32))
        for name, widths in (("normals", (3,)), ("uvs", (2, 4)), ("colors", (3, 4))):
            value = getattr(self, name)
            if value is None:
                continue
            rows = self._float_array(name, value, widths)
            if len(rows) != count:
                raise InputError(f"{self.name}: {len(rows)} {name} for {count} vertices")
            object.__setattr__(self, name, rows)

    def _float_array(self, what: str, value: ArrayLike, widths: tuple[int, ...]) -> NDArray[np.float32]:
        with np.errstate(over="ignore"):
            rows = owned(value, f"{self.name}: {what}", np.float32)
        if rows.ndim != 2 or rows.shape[1] not in widths:
            shapes = " or ".join(f"(N, {width})" for width in widths)
            raise InputError(f"{self.name}: {what} must be {shapes}, not {rows.shape}")
        if not np.isfinite(rows).all():
            bad = int(np.flatnonzero(~np.isfinite(rows).all(axis=1))[0])
            raise InputError(f"{self.name}: {what} must be finite; number {bad} is {rows[bad].tolist()}")
        return rows

    @classmethod
    def taking(
        cls,
        vertices: NDArray[Any],
        faces: NDArray[Any],
        normals: NDArray[Any] | None = None,
        uvs: NDArray[Any] | None = None,
        colors: NDArray[Any] | None = None,
        name: str = "mesh",
    ) -> Mesh:
        """Make a mesh from arrays that the caller gives up: they become read-only, and are not copied.

        Args:
            vertices: (N, 3); see Mesh for all of them. Arrays of another type than Mesh uses are converted.
            faces: (M, 3).
            normals: (N, 3) or None.
            uvs: (N, 2), (N, 4) or None.
            colors: (N, 3), (N, 4) or None.
            name: where it came from, for messages.
        """
        for given in (vertices, faces, normals, uvs, colors):
            if given is not None:
                sealed(given)
        return cls(vertices, faces, normals, uvs, colors, name)

    def share(self, name: str, array: NDArray[Any]) -> None:
        """Replace the array of that name by a read-only view of `array`, which must have the same values."""
        array = array.view()
        array.flags.writeable = False
        object.__setattr__(self, name, array)

    @cached_property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3) float64 lowest and highest corner of the vertices that faces use."""
        used = np.zeros(len(self.vertices), bool)
        used[self.faces] = True
        points = self.vertices if used.all() else self.vertices[used]
        return box_around(points)

    def transformed(self, matrix: ArrayLike) -> Mesh:
        """Return a copy moved by a (4, 4) or (3, 4) affine matrix, normals and winding kept right."""
        m = array(matrix, f"{self.name}: a transform", np.float64)
        if m.shape not in ((4, 4), (3, 4)) or not np.isfinite(m).all():
            raise InputError(f"{self.name}: a transform must be a finite 4x4 matrix")
        if (m[3:] != (0.0, 0.0, 0.0, 1.0)).any():
            raise InputError(f"{self.name}: a transform must be affine: its last row must be 0 0 0 1")
        linear, offset = m[:3, :3], m[:3, 3]
        determinant = float(np.linalg.det(linear))
        if determinant == 0.0:
            raise InputError(f"{self.name}: the transform is not invertible")
        with np.errstate(all="ignore"):  # told below, where it is not finite
            vertices = (self.vertices.astype(np.float64) @ linear.T + offset).astype(np.float32)
        normals = self.normals
        if normals is not None:
            moved = normals.astype(np.float64) @ np.linalg.inv(linear)
            length = np.linalg.norm(moved, axis=1, keepdims=True)
            normals = (moved / np.where(length > 0.0, length, 1.0)).astype(np.float32)
        faces = self.faces if determinant > 0.0 else self.faces[:, ::-1]
        return Mesh.taking(vertices, faces, normals, self.uvs, self.colors, self.name)

    def scaled(self, factor: float) -> Mesh:
        """Return a copy scaled about the origin."""
        return self.transformed(np.diag([factor, factor, factor, 1.0]))

    def translated(self, offset: ArrayLike) -> Mesh:
        """Return a copy moved by `offset`, metres."""
        m = np.eye(4)
        m[:3, 3] = offset
        return self.transformed(m)

    def standing(self, height: float) -> Mesh:
        """Return a copy scaled to a height in metres, standing on y = 0 and centred above the origin.

        It places a mesh of any unit of length in a scene. A mesh that is flat along y is refused with an InputError.
        """
        low, high = self.bounds
        tall = float(high[1] - low[1])
        if tall == 0.0:
            raise InputError(f"{self.name}: it is flat along y, and has no height that could be scaled")
        factor = number(height, f"{self.name}: height", above=0.0) / tall
        m = np.diag([factor, factor, factor, 1.0])
        m[:3, 3] = -factor * np.array([0.5 * (low[0] + high[0]), low[1], 0.5 * (low[2] + high[2])])
        return self.transformed(m)

    def rotated(self, axis: ArrayLike, degrees: float) -> Mesh:
        """Return a copy turned about an axis through the origin (Rodrigues' formula)."""
        x, y, z = np.asarray(axis, dtype=np.float64) / np.linalg.norm(axis)
        k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        angle = np.deg2rad(degrees)
        m = np.eye(4)
        m[:3, :3] += np.sin(angle) * k + (1.0 - np.cos(angle)) * (k @ k)
        return self.transformed(m)


def columns(mesh: Mesh, name: str, first: int, stop: int, default: float) -> NDArray[np.float32]:
    """Return (N, stop − first) columns of what a mesh has at its vertices, `default` where it has none."""
    given = getattr(mesh, name)
    if given is not None and given.shape[1] >= stop:
        return np.asarray(given[:, first:stop])
    rows = np.full((len(mesh.vertices), stop - first), default, np.float32)
    if given is not None and given.shape[1] > first:
        rows[:, : given.shape[1] - first] = given[:, first:]
    return rows
