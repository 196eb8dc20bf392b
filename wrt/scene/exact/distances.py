"""User-defined shapes, by signed distance functions."""

from __future__ import annotations

import dataclasses
import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.linalg import determinant, norm, product
from wrt.scene.description import Kind
from wrt.scene.exact.analytic import WEIGHTS, Analytic, FloatArray
from wrt.scene.mesh import LARGEST, Mesh
from wrt.values import number, vector

_PADDING = 2.0**-21
"""Boxes are larger than what they hold by this share of its size and distance: a few roundings."""

_MARGIN = 2.0**-10
"""The share of its diagonal by which the shape's own box is enlarged, so that surfaces may lie on its walls."""

_CORNERS = np.array([[k >> axis & 1 for axis in range(3)] for k in range(8)])


class DistanceShape(Kind):
    """Base of user-defined shapes, dataclasses that `wrt.register_shape` makes known with a distance function.

    Rays meet where the function is 0. `numbers` are what it takes besides the point.
    """

    lipschitz: ClassVar[float] = 1.0
    """The most by which the function changes with each metre. 1 for a true distance; more makes steps shorter."""

    def bounds(self) -> tuple[Any, Any]:
        """Return the lowest and the highest corner of a box around the shape, metres; what is outside is cut off."""
        raise NotImplementedError

    def numbers(self) -> Sequence[float]:
        """Return the numbers that the function takes: by default all fields in order."""
        return [*_flat(getattr(self, each.name) for each in dataclasses.fields(self))]  # type: ignore[arg-type]

    @cached_property
    def mesh(self) -> Distances:
        """The shape as scenes have it.

        Raises:
            InputError: where its box or numbers cannot be used.
        """
        return Distances.of(self, np.eye(4))


SHAPES: dict[str, type[DistanceShape]] = {}
"""Registered shapes by their `type` in scene files."""


@dataclass(frozen=True, eq=False, repr=False)
class Distances(Analytic):
    """A shape by a distance function; `DistanceShape.mesh` is one.

    Of the corners of its box, the first is the lowest along x and y and the highest along z, or the opposite if the
    front is the inside. The vectors of its vertices are the images of the axes. Further vertices, which no face has,
    hold as normals what kernels read (`kernels/geometry/distances.py`): the image of the origin, the corners of the box
    in the shape's own space, the number of the function in two parts with its Lipschitz constant, and its numbers.

    Attributes:
        description: the shape.
        matrix: (4, 4) affine matrix from its own space to the mesh's.
        turned: whether its front is the inside.
    """

    description: DistanceShape = field(default_factory=DistanceShape)
    matrix: FloatArray = field(default_factory=lambda: np.eye(4))
    turned: bool = False

    def __post_init__(self) -> None:
        Mesh.__post_init__(self)
        if self.description.type_name not in SHAPES:
            raise InputError(
                f"{type(self.description).__name__}: give it to wrt.register_shape, then make a shape of it"
            )

    @classmethod
    def of(cls, shape: DistanceShape, matrix: FloatArray, *, turned: bool = False, name: str = "") -> Distances:
        """Return a shape mapped by a matrix that can be inverted; see `DistanceShape.mesh` for errors."""
        called = type(shape).__name__
        low, high = _box(shape)
        values = [number(value, f"{called}: numbers[{k}]") for k, value in enumerate(shape.numbers())]
        slope = number(shape.lipschitz, f"{called}: lipschitz", above=0.0)
        linear, origin = matrix[:3, :3], matrix[:3, 3]
        corners = product(np.where(_CORNERS, high, low), linear.T) + origin
        least, most = corners.min(axis=0), corners.max(axis=0)
        padding = _PADDING * (np.abs(least) + np.abs(most)).max()
        least, most = least - padding, most + padding
        first, second = np.array([*least[:2], most[2]]), np.array([*most[:2], least[2]])
        if turned:
            first, second = second, first
        model = zlib.crc32(shape.model.encode()) & 0x3FFFFFFF  # as `model_number` of kernels/core/registry.py
        rows = [*linear.T, origin, low, high, (model >> 15, model & 0x7FFF, slope)]
        rows += np.resize([*values, 0.0, 0.0], (-(-len(values) // 3), 3)).tolist()
        vertices = np.array([first, second, *[first] * (len(rows) - 2)], np.float32)
        uvs = np.zeros((len(rows), 2), np.float32)
        uvs[:3] = WEIGHTS
        normals = np.array(rows, np.float32)
        faces = np.array([[0, 1, 2]], np.int32)
        return cls(vertices, faces, normals, uvs, None, name or shape.type_name, None, None, shape, matrix, turned)

    @property
    def counts(self) -> dict[str, int]:
        return {"distance function": 1}

    @property
    def inside_out(self) -> NDArray[np.bool_]:
        return np.array([self.turned])

    @property
    def axes(self) -> FloatArray:
        return np.asarray(self.matrix[None, :3, :3].swapaxes(1, 2))

    @property
    def areas(self) -> FloatArray:
        """(1,) float64 zero: it is not known, so lights of such shapes are found by chance alone."""
        return np.zeros(1)

    def mistakes(self) -> list[tuple[NDArray[np.bool_], str, str]]:
        return []  # it is in no file of arrays

    def keeps(self, matrices: FloatArray) -> bool:
        return all(determinant(matrix[:3, :3]) for matrix in matrices)

    def turned_inside_out(self) -> Distances:
        return Distances.of(self.description, self.matrix, turned=not self.turned, name=self.name)

    def _mapped(self, matrix: FloatArray) -> Mesh:
        whole = np.vstack([matrix[:3], (0.0, 0.0, 0.0, 1.0)])
        return Distances.of(self.description, product(whole, self.matrix), turned=self.turned, name=self.name)

    def tessellated(self, segments: int = 64) -> Mesh:
        raise InputError(
            f"{self.name}: a shape by a distance function has no triangles, and transforms must be invertible"
        )


def _box(shape: DistanceShape) -> tuple[FloatArray, FloatArray]:
    """Return the box of a shape, or raise InputError where none can be used."""
    called = type(shape).__name__
    corners = shape.bounds()
    try:
        low, high = corners
    except (TypeError, ValueError):
        raise InputError(f"{called}: bounds must return two corners, the lowest and the highest") from None
    a, b = (np.array(vector(corner, f"{called}: a corner of bounds")) for corner in (low, high))
    if not (a < b).all():
        raise InputError(f"{called}: bounds {a.tolist()} must be below {b.tolist()} along every axis")
    if not max(np.abs(a).max(), np.abs(b).max()) <= LARGEST:
        raise InputError(f"{called}: bounds reach farther than {LARGEST:g}")
    margin = _MARGIN * norm(b - a)
    return a - margin, b + margin


def _flat(values: Iterable[Any]) -> Iterator[Any]:
    for value in values:
        if isinstance(value, (tuple, list, np.ndarray)):
            yield from _flat(value)
        else:
            yield value
