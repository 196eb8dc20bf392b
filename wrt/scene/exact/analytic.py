"""Shapes that rays meet by formula, stored as triangles that no ray hits."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrt.errors import InputError
from wrt.linalg import product
from wrt.scene.mesh import Mesh
from wrt.values import array, sealed

FloatArray = NDArray[np.float64]

MOST_TRIANGLES = 50_000_000
"""Most triangles into which such shapes are cut, two gigabytes."""

_SIMILAR = 1e-5
"""The relative difference of lengths up to which a matrix still maps spheres to spheres."""

WEIGHTS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], np.float32)
"""Texture coordinates of the vertices, which make those of a shape its weights."""

A = TypeVar("A", bound="Analytic")


@dataclass(frozen=True, eq=False, repr=False)
class Analytic(Mesh, ABC):
    """Spheres, or disks and cylinders, that are not made of triangles.

    Each is stored as a triangle that no ray hits, so code for meshes handles it unchanged. Its corners are two opposite
    corners of the box around the shape, and the first again; which two encodes the kind of shape and its front
    (`kernels/native/exact`). The normals of its vertices are the shape's own vectors. Attributes that a triangle
    interpolates by u and v are interpolated over the shape by its texture coordinates.
    """

    def __repr__(self) -> str:
        counts = ", ".join(f"{count} {noun}{'s' * (count > 1)}" for noun, count in self.counts.items())
        colors = ", colors" if self.colors is not None else ""
        return f"<{type(self).__name__.lower()} {self.name}: {counts}{colors}>"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.normals is None or len(self.vertices) != 3 * len(self.faces):
            raise InputError(f"{self.name}: make exact shapes by wrt.spheres, wrt.disk or wrt.cylinder")

    @property
    @abstractmethod
    def counts(self) -> dict[str, int]:
        """Number of shapes of each kind."""

    @property
    def centers(self) -> FloatArray:
        """(N, 3) float64 centres, metres."""
        return np.asarray(0.5 * (self._corners(0) + self._corners(1)))

    @property
    def axes(self) -> FloatArray:
        """(N, 3, 3) float64 vectors of the shapes, a row each."""
        assert self.normals is not None
        return self.normals.reshape(-1, 3, 3).astype(np.float64)

    @property
    def inside_out(self) -> NDArray[np.bool_]:
        """(N,) whether each shape is turned: its front faces inwards or, for a disk, against its axis."""
        return np.asarray(self.vertices[1::3, 0] < self.vertices[0::3, 0])

    @property
    @abstractmethod
    def areas(self) -> FloatArray:
        """(N,) float64 areas of one side, square metres."""

    @property
    def outline(self) -> NDArray[np.float32]:
        """(P, 3) points whose convex hull contains the shapes: corners of their boxes."""
        boxes = np.stack([self.vertices[0::3], self.vertices[1::3]])
        if len(self.faces) > 10_000:
            boxes = self.bounds.astype(np.float32)[:, None]
        picks = np.array([[k >> axis & 1 for axis in range(3)] for k in range(8)])
        return np.concatenate([boxes[pick, :, np.arange(3)].T for pick in picks])

    def _corners(self, which: int) -> FloatArray:
        return self.vertices[which::3].astype(np.float64)

    @abstractmethod
    def mistakes(self) -> list[tuple[NDArray[np.bool_], str, str]]:
        """Return what may be wrong in a file: (N,) whether shapes are, the array, and what it must be."""

    @abstractmethod
    def keeps(self, matrices: FloatArray) -> bool:
        """Return whether the shapes remain what they are under all maps of a motion, (K, 3 or 4, 4)."""

    def turned_inside_out(self: A) -> A:
        """Return the shapes with front and back exchanged."""
        return stored(type(self), self.vertices.reshape(-1, 3, 3)[:, [1, 0, 1]], self.axes, self.colors, self.name)

    def transformed(self, matrix: ArrayLike) -> Mesh:
        """Return a transformed copy; of triangles if the matrix does not map the shapes to such shapes."""
        m = np.asarray(array(matrix, f"{self.name}: a transform", np.float64))
        if m.shape not in ((4, 4), (3, 4)) or not np.isfinite(m).all() or not self.keeps(m[None]):
            return self.tessellated().transformed(m)
        with np.errstate(all="ignore"):  # Mesh refuses values that are not finite
            return self._mapped(m)

    @abstractmethod
    def _mapped(self, matrix: FloatArray) -> Mesh:
        """Return the shapes mapped by a matrix that keeps them."""

    @abstractmethod
    def tessellated(self, segments: int = 64) -> Mesh:
        """Return triangles with exact normals in place of the shapes, facing to the same sides.

        Args:
            segments: vertices around each circle.

        Raises:
            InputError: if there would be too many.
        """


def keeps_spheres(matrix: FloatArray) -> bool:
    """Return whether an affine matrix maps spheres to spheres: it turns, mirrors and scales alike along all axes."""
    gram = product(matrix[:3, :3].T, matrix[:3, :3])
    square = float(np.trace(gram)) / 3.0
    return square > 0.0 and bool((np.abs(gram - square * np.eye(3)) <= 2.0 * _SIMILAR * square).all())


def stored(
    cls: type[A], corners: NDArray[np.float32], axes: FloatArray, colors: NDArray[np.float32] | None, name: str
) -> A:
    """Return shapes from the corners of their triangles, (N, 3, 3), and their vectors, bit for bit."""
    count = len(corners)
    vertices = np.ascontiguousarray(corners, np.float32).reshape(-1, 3)
    faces = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    normals = np.ascontiguousarray(axes, np.float32).reshape(-1, 3)
    uvs = np.tile(WEIGHTS, (count, 1))
    for each in (vertices, faces, normals, uvs):
        sealed(each)
    return cls(vertices, faces, normals, uvs, colors, name)


def stored_in(cls: type[A], boxes: ArrayLike, axes: ArrayLike, colors: ArrayLike | None, name: str) -> A:
    """Return shapes from first and second corners, (N, 2, 3), vectors, (N, 3, 3), and colours, bit for bit.

    Raises:
        InputError: where the arrays are not those of such shapes.
    """
    arrays: dict[str, NDArray[Any]] = {"boxes": np.asarray(boxes, np.float32), "axes": np.asarray(axes, np.float64)}
    pairs, rows = arrays.values()
    if pairs.ndim != 3 or pairs.shape[1:] != (2, 3) or rows.shape != (len(pairs), 3, 3):
        raise InputError(f"{name}: boxes must be (N, 2, 3) and axes (N, 3, 3), not {pairs.shape} and {rows.shape}")

    def refuse(wrong: NDArray[np.bool_], array_name: str, rule: str) -> None:
        if wrong.any():
            bad = int(np.flatnonzero(wrong)[0])
            raise InputError(f"{name}: {array_name}[{bad}]: {rule}, not {arrays[array_name][bad].tolist()}")

    for array_name, values in arrays.items():
        refuse(~np.isfinite(values).all(axis=(1, 2)), array_name, "must be finite")
    of_corners = None if colors is None else np.repeat(np.asarray(colors, np.float32), 3, axis=0)
    shapes = stored(cls, pairs[:, [0, 1, 0]], rows, of_corners, name)
    for mistake in shapes.mistakes():
        refuse(*mistake)
    return shapes
