"""Participating media, which fill bodies or the whole scene, and densities that vary in them."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from wrt import values
from wrt.errors import InputError
from wrt.linalg import gauss_legendre, product
from wrt.scene.description import Color, Description, Vector, instance_of, optional
from wrt.scene.mesh import Mesh
from wrt.scene.motion import affine_matrix
from wrt.scene.shapes import box
from wrt.values import FLOAT32_MAX, ColorLike, Vec3, number, owned

MOST_CELLS = 2**29
"""The most cells of a grid: 2 GB of densities."""


def _cells(densities: Any, name: str, *, channels: tuple[int, ...]) -> NDArray[np.float32]:
    """Return values of cells as a read-only float32 array with one of these numbers of channels; 0 for no axis."""
    with np.errstate(over="ignore"):
        result = owned(densities, name, np.float32)
    shapes = ["(nz, ny, nx)" if count == 0 else f"(nz, ny, nx, {count})" for count in channels]
    if not any(result.shape[3:] == ((count,) if count else ()) for count in channels) or result.ndim < 3:
        raise InputError(f"{name} must be {' or '.join(shapes)}, not {result.shape}")
    if result.size == 0:
        raise InputError(f"{name} must have a cell at least, not {result.shape}")
    if result.size > MOST_CELLS:
        raise InputError(f"{name} has {result.size} numbers; the limit is {MOST_CELLS}")
    if not np.isfinite(result).all() or float(result.min()) < 0.0:
        raise InputError(f"{name} must be finite and not negative")
    return result


_Cells = NDArray[np.float32] | None


@dataclass(frozen=True, eq=False)
class DensityGrid(Description):
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
        albedo: (nz, ny, nx, 3) share of the extinction that is scattering, 0 to 1, in place of the medium's own; any
            number of cells in the same box.
        emission: (nz, ny, nx) or (nz, ny, nx, 3) factor on the medium's emission, in addition to the density.
        name: source of the values, for messages.
    """

    values: Annotated[NDArray[np.float32], partial(_cells, channels=(0,))] = field(repr=False)
    lower: Vector = (0.0, 0.0, 0.0)
    upper: Vector = (1.0, 1.0, 1.0)
    transform: Annotated[NDArray[np.float64] | None, optional(affine_matrix)] = None
    factor: Annotated[float, partial(number, minimum=0.0, maximum=FLOAT32_MAX)] = 1.0
    albedo: Annotated[_Cells, optional(partial(_cells, channels=(3,)))] = field(default=None, repr=False)
    emission: Annotated[_Cells, optional(partial(_cells, channels=(0, 3)))] = field(default=None, repr=False)
    name: str = "density"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not all(low < high for low, high in zip(self.lower, self.upper, strict=True)):
            name = self._label("lower")
            raise InputError(f"{name} must be less than upper on each axis, not {self.lower} and {self.upper}")
        if self.albedo is not None and self.albedo.max() > 1.0:
            raise InputError(f"{self._label('albedo')} must be at most 1, not {self.albedo.max():g}")

    def _label(self, name: str) -> str:
        return f"density {self.name}: {name}"

    @functools.cached_property
    def greatest(self) -> float:
        """The greatest density."""
        return self.factor * float(self.values.max())

    @functools.cached_property
    def scatters(self) -> bool | None:
        """Whether any albedo of its own is above 0; None if it has none."""
        return None if self.albedo is None else bool(self.albedo.any())

    @property
    def to_world(self) -> NDArray[np.float64]:
        """The (4, 4) matrix from the unit cube to the box in the world."""
        matrix = np.eye(4)
        matrix[:3, :3] = np.diag(np.subtract(self.upper, self.lower))
        matrix[:3, 3] = self.lower
        return matrix if self.transform is None else product(self.transform, matrix)

    @property
    def boundary(self) -> Mesh:
        """The box in the world as a mesh, for a shape of Null that holds the medium."""
        mesh = box(self.lower, self.upper)
        return mesh if self.transform is None else mesh.transformed(self.transform)


@dataclass(frozen=True)
class Medium(Description):
    """A medium, homogeneous unless it has a grid of densities.

    Coefficients are per metre and per channel. The transmittance over a distance d is
    exp(−(absorption + scattering) d) (Beer's law). The sum of the coefficients is the extinction, and its inverse the
    mean free path.

    Attributes:
        absorption: absorption coefficient, per metre and channel.
        scattering: scattering coefficient, per metre and channel.
        g: mean cosine of the scattering angle (Henyey and Greenstein 1941): 0 isotropic, 1 forward, −1 backward.
        emission: emitted radiance per metre, W·sr⁻¹·m⁻³.
        density: factor on all coefficients that varies in space; None for 1 everywhere.
    """

    absorption: Color = 0.0
    scattering: Color = 0.0
    g: Annotated[float, partial(number, minimum=-0.99, maximum=0.99)] = 0.0
    emission: Color = 0.0
    density: Annotated[DensityGrid | None, optional(instance_of(DensityGrid))] = None

    @property
    def extinction(self) -> Vec3:
        """Absorption plus scattering, per metre, where the density is 1."""
        a, s = self.absorption, self.scattering
        return tuple(x + y for x, y in zip(a, s, strict=True))  # type: ignore[arg-type, return-value]

    @property
    def scatters(self) -> bool:
        """Whether it scatters light."""
        if self.density is not None and self.density.scatters is not None:
            return any(self.extinction) and self.density.scatters
        return any(self.scattering)  # type: ignore[arg-type]

    @property
    def is_clear(self) -> bool:
        """Whether it neither attenuates nor emits light."""
        empty = self.density is not None and self.density.greatest == 0.0
        return empty or not any((*self.extinction, *self.emission))  # type: ignore[misc]

    @classmethod
    def from_color(
        cls,
        color: ColorLike,
        distance: float = 1.0,
        emission: ColorLike = 0.0,
        density: DensityGrid | None = None,
    ) -> Medium:
        """Return the absorbing medium that has the transmittance `color` over a distance.

        By Beer's law the absorption is −ln(color) / distance.

        Args:
            color: transmittance per channel, above 0 and at most 1.
            distance: metres.
            emission: emitted radiance per metre, W·sr⁻¹·m⁻³.
            density: as the attribute.

        Raises:
            InputError: if a channel is 0, which would take infinite absorption.
        """
        share = values.color(color, "color", maximum=1.0)
        if min(share) <= 0.0:
            raise InputError(f"color must be greater than 0 in each channel, not {share}: no medium absorbs everything")
        distance = number(distance, "distance", above=0.0)
        absorption = tuple(abs(math.log(x)) / distance for x in share)
        return cls(absorption=absorption, emission=emission, density=density)

    @classmethod
    def from_albedo(
        cls,
        albedo: ColorLike,
        extinction: ColorLike,
        g: float = 0.0,
        emission: ColorLike = 0.0,
        density: DensityGrid | None = None,
    ) -> Medium:
        """Return the medium of this single-scattering albedo and extinction.

        Args:
            albedo: scattering over extinction, per channel, 0 to 1.
            extinction: per metre and channel; its inverse is the mean free path.
            g: as the attribute.
            emission: as the attribute.
            density: as the attribute.
        """
        share, total = values.color(albedo, "albedo", maximum=1.0), values.color(extinction, "extinction")
        scattering = tuple(a * t for a, t in zip(share, total, strict=True))
        absorption = tuple((1.0 - a) * t for a, t in zip(share, total, strict=True))
        return cls(absorption, scattering, g, emission, density)

    @classmethod
    def from_subsurface(
        cls, color: ColorLike, radius: ColorLike, g: float = 0.0, density: DensityGrid | None = None
    ) -> Medium:
        """Return the medium that gives a thick body this diffuse colour.

        Args:
            color: diffuse reflectance of a half-space under uniform light, per channel, 0 to 1. A refractive boundary
                makes it darker.
            radius: mean free path, metres, per channel.
            g: as the attribute. The radius is then the mean free path over 1 − g.
            density: as the attribute.

        Raises:
            InputError: if a radius is 0.
        """
        paths = values.color(radius, "radius")
        if min(paths) <= 0.0:
            raise InputError(f"radius must be greater than 0 in each channel, not {paths}")
        g = number(g, "g", minimum=-0.99, maximum=0.99)
        reduced = tuple(albedo_of_color(share) for share in values.color(color, "color", maximum=1.0))
        # Similarity: media of the same absorption and of the same scattering (1 − g) look alike deep inside
        # (van de Hulst, "Multiple Light Scattering", 1980, section 14.1).
        absorption = tuple((1.0 - a) / r for a, r in zip(reduced, paths, strict=True))
        scattering = tuple(a / (r * (1.0 - g)) for a, r in zip(reduced, paths, strict=True))
        return cls(absorption, scattering, g, density=density)


@functools.lru_cache(maxsize=1024)
def albedo_of_color(reflectance: float) -> float:
    """Return the single-scattering albedo of an isotropic half-space of this diffuse reflectance.

    The exact reflectance under uniform light is R(a) = 1 − 2 √(1 − a) ∫ H(μ) μ dμ with Chandrasekhar's H ("Radiative
    Transfer", 1950, sections 38 and 85). It is inverted by bisection.
    """
    low, high = 0.0, 1.0
    for _ in range(52):
        middle = 0.5 * (low + high)
        if color_of_albedo(middle) < reflectance:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def color_of_albedo(albedo: float) -> float:
    """Return the reflectance under uniform light of an isotropic half-space of this single-scattering albedo."""
    nodes, weights = gauss_legendre(32)
    # Squaring concentrates nodes near μ = 0, where H has an infinite slope.
    mu = (0.5 * (nodes + 1.0)) ** 2
    weights = weights * np.sqrt(mu)
    # 1 / H(μ) = √(1 − a) + (a / 2) ∫ μ' H(μ') / (μ + μ') dμ'; averaging successive iterates makes it converge.
    root = math.sqrt(1.0 - albedo)
    h = np.ones_like(mu)
    for _ in range(200):
        new = 1.0 / (root + product(0.5 * albedo * (mu / (mu[:, None] + mu) * weights), h))
        change = float(np.abs(new - h).max())
        h = 0.5 * (h + new)
        if change < 1e-9:
            break
    return float(1.0 - 2.0 * root * np.sum(weights * mu * h))


MEDIA: dict[str, Callable[..., Medium]] = {
    "coefficients": Medium,
    "color": Medium.from_color,
    "albedo": Medium.from_albedo,
    "subsurface": Medium.from_subsurface,
}
"""Constructors of media by their `type` in scene files."""
