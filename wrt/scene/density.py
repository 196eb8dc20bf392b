"""Densities of media that vary in space, on grids."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.scene.mesh import Mesh
from wrt.scene.shapes import box
from wrt.values import FLOAT32_MAX, Vec3, array, number, owned, vector

MOST_CELLS = 2**29
"""The most cells of a grid: 2 GB of densities."""


@dataclass(frozen=True, eq=False)
class DensityGrid:
    """The density of a medium in a box, on a grid of cells.

    It multiplies the coefficients of the medium. Values are those at the centres of cells, and trilinear between them;
    less than half a cell from the faces of the box they are those of the outermost centres. Outside of the box the
    density is 0. The box stands in the world, wherever the shapes are that the medium fills.

    Attributes:
        values: (nz, ny, nx) densities, not negative; x varies fastest, and index 0 is at `lower`.
        lower: corner of the box, metres.
        upper: the opposite corner.
        transform: (4, 4) affine matrix that then places the box in the world; None leaves it.
        factor: multiplies the values.
        albedo: (nz, ny, nx, 3) share of the extinction that is scattering, 0 to 1, in place of the medium's own; on
            cells of any number in the same box. The medium's absorption and scattering count by their sum only.
        emission: (nz, ny, nx) or (nz, ny, nx, 3) factor on the medium's emission, besides the density.
        name: source of the values, for messages.
    """

    values: NDArray[np.float32] = field(repr=False)
    lower: Vec3 = (0.0, 0.0, 0.0)
    upper: Vec3 = (1.0, 1.0, 1.0)
    transform: NDArray[np.float64] | None = None
    factor: float = 1.0
    albedo: NDArray[np.float32] | None = field(default=None, repr=False)
    emission: NDArray[np.float32] | None = field(default=None, repr=False)
    name: str = "density"

    def __post_init__(self) -> None:
        def put(name: str, value: object) -> None:
            object.__setattr__(self, name, value)

        what = f"density {self.name}"
        put("values", _cells(self.values, f"{what}: values", channels=(0,)))
        put("lower", vector(self.lower, f"{what}: lower"))
        put("upper", vector(self.upper, f"{what}: upper"))
        if not all(low < high for low, high in zip(self.lower, self.upper, strict=True)):
            raise InputError(f"{what}: lower must be less than upper on each axis, not {self.lower} and {self.upper}")
        put("factor", number(self.factor, f"{what}: factor", minimum=0.0, maximum=FLOAT32_MAX))
        if self.transform is not None:
            put("transform", _affine(self.transform, f"{what}: transform"))
        if self.albedo is not None:
            put("albedo", _cells(self.albedo, f"{what}: albedo", channels=(3,)))
            if self.albedo.max() > 1.0:
                raise InputError(f"{what}: albedo must be at most 1, not {self.albedo.max():g}")
        if self.emission is not None:
            put("emission", _cells(self.emission, f"{what}: emission", channels=(0, 3)))

    @property
    def greatest(self) -> float:
        """The greatest density."""
        return self.factor * float(self.values.max())

    @property
    def to_world(self) -> NDArray[np.float64]:
        """The (4, 4) matrix from the unit cube to the box in the world."""
        matrix = np.eye(4)
        matrix[:3, :3] = np.diag(np.subtract(self.upper, self.lower))
        matrix[:3, 3] = self.lower
        return matrix if self.transform is None else self.transform @ matrix

    @property
    def boundary(self) -> Mesh:
        """The box in the world as a mesh, for a shape of Null that holds the medium."""
        mesh = box(self.lower, self.upper)
        return mesh if self.transform is None else mesh.transformed(self.transform)


def _cells(values: Any, what: str, channels: tuple[int, ...]) -> NDArray[np.float32]:
    """Return values of cells as a read-only float32 array with one of these numbers of channels; 0 for no axis."""
    with np.errstate(over="ignore"):
        result = owned(values, what, np.float32)
    shapes = ["(nz, ny, nx)" if count == 0 else f"(nz, ny, nx, {count})" for count in channels]
    if not any(result.shape[3:] == ((count,) if count else ()) for count in channels) or result.ndim < 3:
        raise InputError(f"{what} must be {' or '.join(shapes)}, not {result.shape}")
    if result.size == 0:
        raise InputError(f"{what} must have a cell at least, not {result.shape}")
    if result.size > MOST_CELLS:
        raise InputError(f"{what} has {result.size} numbers; the limit is {MOST_CELLS}")
    if not np.isfinite(result).all() or float(result.min()) < 0.0:
        raise InputError(f"{what} must be finite and not negative")
    return result


def _affine(value: Any, what: str) -> NDArray[np.float64]:
    matrix = array(value, what, np.float64).copy()
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all() or not np.array_equal(matrix[3], (0, 0, 0, 1)):
        raise InputError(f"{what} must be a (4, 4) affine matrix")
    if not abs(np.linalg.det(matrix[:3, :3])) > 0.0:
        raise InputError(f"{what} must not flatten space")
    matrix.flags.writeable = False
    return matrix
