"""Participating media, which fill bodies or the whole scene."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wrt.errors import InputError
from wrt.scene.density import DensityGrid
from wrt.values import ColorLike, Vec3, color, number


@dataclass(frozen=True)
class Medium:
    """A medium, homogeneous unless it has a grid of densities.

    Coefficients are per metre and per channel. The transmittance over a distance d is
    exp(−(absorption + scattering) d) (Beer's law). The sum of the coefficients is the extinction, and its inverse the
    mean free path.

    Attributes:
        absorption: absorption coefficient.
        scattering: scattering coefficient.
        g: mean cosine of the scattering angle (Henyey and Greenstein 1941): 0 is isotropic, towards 1 forward,
            towards −1 backward.
        emission: emitted radiance per metre, W·sr⁻¹·m⁻³.
        density: factor on all coefficients that varies in space; None for 1 everywhere.
    """

    absorption: ColorLike = 0.0
    scattering: ColorLike = 0.0
    g: float = 0.0
    emission: ColorLike = 0.0
    density: DensityGrid | None = None

    def __post_init__(self) -> None:
        for name in ("absorption", "scattering", "emission"):
            object.__setattr__(self, name, color(getattr(self, name), name))
        object.__setattr__(self, "g", number(self.g, "g", minimum=-0.99, maximum=0.99))
        if self.density is not None and not isinstance(self.density, DensityGrid):
            raise InputError(f"density must be a wrt.DensityGrid, not {type(self.density).__name__}")

    @property
    def extinction(self) -> Vec3:
        """Absorption plus scattering, per metre, where the density is 1."""
        a, s = self.absorption, self.scattering
        return tuple(x + y for x, y in zip(a, s, strict=True))  # type: ignore[arg-type, return-value]

    @property
    def scatters(self) -> bool:
        """Whether it scatters light."""
        if self.density is not None and self.density.albedo is not None:
            return any(self.extinction) and bool(self.density.albedo.any())
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
        left = _color(color, "color", maximum=1.0)
        if min(left) <= 0.0:
            raise InputError(f"color must be greater than 0 in each channel, not {left}: no medium absorbs everything")
        distance = number(distance, "distance", above=0.0)
        absorption = tuple(abs(math.log(share)) / distance for share in left)
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
        share, total = _color(albedo, "albedo", maximum=1.0), _color(extinction, "extinction")
        scattering = tuple(a * t for a, t in zip(share, total, strict=True))
        absorption = tuple((1.0 - a) * t for a, t in zip(share, total, strict=True))
        return cls(absorption, scattering, g, emission, density)

    @classmethod
    def from_subsurface(
        cls, color: ColorLike, radius: ColorLike, g: float = 0.0, density: DensityGrid | None = None
    ) -> Medium:
        """Return the medium that gives a thick body this diffuse colour.

        Args:
            color: diffuse reflectance of a half-space under uniform light, without a reflecting boundary, per
                channel, 0 to 1 (see `albedo_of_color`). A refractive boundary makes it darker.
            radius: mean free path, metres, per channel; larger values spread light farther.
            g: as the attribute. The radius is then the reduced mean free path, the mean free path over 1 − g.
            density: as the attribute.

        Raises:
            InputError: if a radius is 0.
        """
        paths = _color(radius, "radius")
        if min(paths) <= 0.0:
            raise InputError(f"radius must be greater than 0 in each channel, not {paths}")
        g = number(g, "g", minimum=-0.99, maximum=0.99)
        reduced = tuple(albedo_of_color(share) for share in _color(color, "color", maximum=1.0))
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

    Args:
        reflectance: 0 to 1.
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
    """Return the diffuse reflectance of an isotropic half-space of this single-scattering albedo, under uniform light.

    Args:
        albedo: 0 to 1.
    """
    nodes, weights = np.polynomial.legendre.leggauss(32)
    # Squaring concentrates nodes near μ = 0, where H has an infinite slope.
    mu = (0.5 * (nodes + 1.0)) ** 2
    weights = weights * np.sqrt(mu)
    # 1 / H(μ) = √(1 − a) + (a / 2) ∫ μ' H(μ') / (μ + μ') dμ'; averaging successive iterates makes it converge.
    root = math.sqrt(1.0 - albedo)
    h = np.ones_like(mu)
    for _ in range(200):
        new = 1.0 / (root + 0.5 * albedo * (mu / (mu[:, None] + mu) * weights) @ h)
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


def _color(value: ColorLike, name: str, maximum: float = 1e30) -> Vec3:
    return color(value, name, maximum=maximum)
