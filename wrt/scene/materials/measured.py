"""Surfaces whose reflectance was measured."""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.scene.description import Description, Flag, instance_of
from wrt.scene.materials.material import Material
from wrt.values import owned

MOST_NUMBERS = 2**28
"""The most numbers in the tables of a measurement: 1 GB. The largest of the RGL database has 2 million as colours."""

LARGEST = 1e12
"""The greatest number in a table: products and quotients of several must fit single precision."""


def _nodes(value: object, what: str, *, least: float) -> NDArray[np.float32]:
    nodes = owned(value, what, np.float32)
    if nodes.ndim != 1 or nodes.size == 0:
        raise InputError(f"{what} must be a list of angles, not of shape {nodes.shape}")
    if not (np.abs(nodes) <= 2.0 * math.pi).all() or (nodes < least).any() or (np.diff(nodes) <= 0.0).any():
        raise InputError(f"{what} must be ascending angles in radians")
    return nodes


@dataclass(frozen=True, eq=False)
class Measurement(Description):
    """Tables of a measured reflectance, in the adaptive parameterisation of Dupuy and Jakob (2018).

    A point (x, y) of the unit square stands for the direction θ = π/2 x², φ = π (2y − 1). Rows go along y and columns
    along x; values are bilinear between nodes, which include the edges. Where `phi_i` has one node or two, azimuths of
    normals are relative to the viewer's.

    Attributes:
        phi_i: (P,) azimuths of the viewer, radians, ascending; of anisotropic surfaces the circle from −π on, or its
            first half or quarter.
        theta_i: (T,) angles of the viewer to the normal, radians, ascending.
        ndf: (H, W) distribution of facet normals.
        sigma: (H, W) area that facets show in a direction, per area of the surface.
        vndf: (P, T, H, W) density of the normals that the viewer sees, on the square; normalised.
        luminance: (P, T, N, N) density of what is reflected, on the square that `vndf` warps; normalised.
        rgb: (P, T, 3, N, N) what is reflected there, in linear Rec. 709.
        jacobian: whether `rgb` is to be multiplied by ndf / (4 sigma).
        name: source of the tables, for messages.

    Raises:
        InputError: when tables do not fit each other, or numbers in them cannot be used.
    """

    phi_i: Annotated[NDArray[np.float32], partial(_nodes, least=-2.0 * math.pi)]
    theta_i: Annotated[NDArray[np.float32], partial(_nodes, least=0.0)]
    ndf: NDArray[np.float32] = field(repr=False)
    sigma: NDArray[np.float32] = field(repr=False)
    vndf: NDArray[np.float32] = field(repr=False)
    luminance: NDArray[np.float32] = field(repr=False)
    rgb: NDArray[np.float32] = field(repr=False)
    jacobian: Flag = True
    name: str = "measurement"

    def _label(self, name: str) -> str:
        return f"measurement {self.name}: {name}"

    def __post_init__(self) -> None:
        super().__post_init__()
        around, up, n = len(self.phi_i), len(self.theta_i), np.shape(self.luminance)[-1:]
        shapes: dict[str, tuple[object, ...]] = {
            "ndf": ("H", "W"),
            "sigma": ("H", "W"),
            "vndf": (around, up, "H", "W"),
            "luminance": (around, up, *n, *n),
            "rgb": (around, up, 3, *n, *n),
        }
        for name, shape in shapes.items():
            self._set(**{name: _table(getattr(self, name), self._label(name), shape)})
        if min(*self.ndf.shape, *self.sigma.shape, *self.vndf.shape[2:], *self.luminance.shape[2:]) < 2:
            raise InputError(self._label("tables must have at least two nodes along each axis of the square"))
        if sum(getattr(self, name).size for name in shapes) > MOST_NUMBERS:
            raise InputError(self._label(f"its tables have more than {MOST_NUMBERS} numbers"))
        if self.reduction not in (1, 2, 4):
            part = f"phi_i must cover the circle, a half or a quarter of it, not 1/{self.reduction}"
            raise InputError(self._label(part))

    @property
    def is_isotropic(self) -> bool:
        """Whether turning the surface changes nothing."""
        return len(self.phi_i) <= 2

    @property
    def reduction(self) -> int:
        """How many times the range of azimuths fits the circle; 1 for isotropic surfaces."""
        if self.is_isotropic:
            return 1
        return round(2.0 * math.pi / float(self.phi_i[-1] - self.phi_i[0]))


def _table(value: object, what: str, shape: tuple[object, ...]) -> NDArray[np.float32]:
    with np.errstate(over="ignore"):
        table = owned(value, what, np.float32)
    fits = len(table.shape) == len(shape)
    if not fits or any(isinstance(n, int) and n != m for n, m in zip(shape, table.shape, strict=True)):
        raise InputError(f"{what} must have the shape ({', '.join(map(str, shape))}), not {table.shape}")
    if table.size == 0:
        raise InputError(f"{what} is empty")
    if not (table <= LARGEST).all() or (table < 0.0).any():
        raise InputError(f"{what} must hold finite numbers from 0 to {LARGEST:g}")
    return table


@dataclass(frozen=True)
class Measured(Material):
    """A surface whose reflectance was measured, such as one of the RGL material database (Dupuy and Jakob 2018).

    Attributes:
        measurement: the tables, by `load_measurement`; in scene files a .bsdf file.
    """

    measurement: Annotated[Measurement, instance_of(Measurement)]

    type_name: ClassVar[str] = "measured"

    @classmethod
    def example(cls) -> Measured:
        """Return a grey surface of facets that face all ways alike, in the fewest numbers."""
        ndf = np.full((2, 2), 1.0 / math.pi, np.float32)
        even = np.ones((1, 2, 2, 2), np.float32)
        sigma = np.array([[1.0, 0.5], [1.0, 0.5]], np.float32)
        grey = np.full((1, 2, 3, 2, 2), 0.5, np.float32)
        angles = np.array([0.0, 1.5], np.float32)
        return cls(Measurement(angles[:1], angles, ndf, sigma, even, even, grey))

    @property
    def needs_tangents(self) -> bool:
        return not self.measurement.is_isotropic

    @property
    def table_key(self) -> tuple[Hashable, ...]:
        return "measured", self.measurement
