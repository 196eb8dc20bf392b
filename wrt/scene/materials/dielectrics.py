"""Transparent bodies."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import KW_ONLY, dataclass
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.linalg import gauss_legendre
from wrt.scene.description import Flag, word_of
from wrt.scene.materials.dispersion import SHARES, Dispersion, Dispersive, channel_indices
from wrt.scene.materials.material import Material, Reflectance
from wrt.scene.materials.microfacet import Microfacets
from wrt.scene.materials.presets import by_name, dielectric_ior
from wrt.scene.textures import ColorSource
from wrt.values import Vec3, number


def refractive_index(value: float | str, name: str) -> float:
    """Return a refractive index, given as a number above 0 or the name of a medium."""
    return by_name(dielectric_ior, value, name) if isinstance(value, str) else number(value, name, above=0.0)


RefractiveIndex = Annotated[float | str, refractive_index]


def mean_transmittance(eta: float) -> float:
    """Return the diffuse transmittance of a smooth boundary, 2 ∫ (1 − F) μ dμ, for eta = n_t / n_i.

    The integrand is smooth for light from the side of the lower index. From the other side the integral is eta² times
    that, because radiance over index squared is conserved.
    """
    denser = max(eta, 1.0 / eta)
    nodes, weights = gauss_legendre(64)
    # cosθ = t⁴ places more nodes near grazing angles, where F bends sharply if the indices are almost equal.
    t = 0.5 * (nodes + 1.0)
    into = float(np.sum(weights * 4.0 * t**7 * _transmittance(t**4, denser)))
    return into * min(eta, 1.0) ** 2


def _transmittance(cos_i: NDArray[np.float64], eta: float) -> NDArray[np.float64]:
    """Return 1 − F of a smooth boundary for cosθi > 0 and eta = n_t / n_i, by Fresnel's equations."""
    cos_t = np.sqrt(np.maximum((eta - 1.0) * (eta + 1.0) + cos_i * cos_i, 0.0)) / eta
    s, p = cos_i + eta * cos_t, eta * cos_i + cos_t
    return np.asarray(2.0 * eta * ((cos_i / s) * (cos_t / s) + (cos_i / p) * (cos_t / p)))


@dataclass(frozen=True)
class _Boundary(Material):
    """Base of the boundaries of transparent media.

    Attributes:
        ior: refractive index inside, or a name such as "water" (wrt materials --presets).
        exterior_ior: the same for the outside.
        specular_reflectance: multiplies reflected light; 1 in nature.
        specular_transmittance: multiplies transmitted light; 1 in nature.
    """

    ior: RefractiveIndex = 1.5
    exterior_ior: RefractiveIndex = 1.0
    _: KW_ONLY
    specular_reflectance: Reflectance = 1.0
    specular_transmittance: Reflectance = 1.0

    slot_names: ClassVar[tuple[str, ...]] = ("relative_ior", "specular_reflectance", "specular_transmittance")

    @property
    def relative_ior(self) -> float:
        """Refractive index inside over outside."""
        return float(self.ior) / float(self.exterior_ior)


@dataclass(frozen=True)
class _BodyBoundary(_Boundary, Dispersive):
    """Base of the boundaries of bodies, which may be dispersive.

    Attributes:
        dispersion: 20 over the Abbe number, as in glTF, or a name such as "diamond" (wrt materials --presets); `ior` is
            then that at 587.6 nm.
    """

    _: KW_ONLY
    dispersion: Dispersion = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.dispersion and float(self.ior) < 1.0:
            raise InputError(f"dispersion needs an ior of 1 or more, not {self.ior}")

    @property
    def relative_iors(self) -> Vec3:
        """Refractive index inside over outside, per channel."""
        red, green, blue = channel_indices(float(self.ior), float(self.dispersion))
        outside = float(self.exterior_ior)
        return red / outside, green / outside, blue / outside

    @property
    def slots(self) -> tuple[ColorSource, ...]:
        """The values of a boundary; with dispersion an index for each channel, and the channels' probabilities."""
        if not self.dispersion:
            return super().slots
        return (self.relative_iors, self.specular_reflectance, self.specular_transmittance, SHARES)


@dataclass(frozen=True)
class Dielectric(_BodyBoundary):
    """A perfectly smooth boundary of a transparent body: Fresnel reflection and refraction.

    Triangles wind counter-clockwise seen from outside the body, where the index is `exterior_ior`.

    Attributes:
        fresnel: "exact", or "schlick" for Schlick's approximation (1994) by the angle in the medium of lower index.
    """

    _: KW_ONLY
    fresnel: Annotated[str, word_of(("exact", "schlick"))] = "exact"

    type_name: ClassVar[str] = "dielectric"

    @property
    def model(self) -> str:
        options = ("schlick",) * (self.fresnel == "schlick") + ("dispersive",) * bool(self.dispersion)
        return ":".join(("dielectric", *options))


@dataclass(frozen=True)
class ThinDielectric(_Boundary):
    """A thin pane with two smooth faces, such as a window, which reflects light or lets it straight through.

    One surface stands for both faces and all reflections between them. Both sides look the same.

    Attributes:
        ior: refractive index of the pane, or a name such as "water" (`wrt materials --presets`).
        exterior_ior: the same for the medium on both sides of it.
    """

    type_name: ClassVar[str] = "thin-dielectric"


@dataclass(frozen=True)
class RoughDielectric(_BodyBoundary, Microfacets):
    """A rough boundary of a transparent body, such as ground glass, whose microfacets reflect and refract.

    The model of Walter, Marschner, Li and Torrance (2007). Triangles wind counter-clockwise seen from outside the
    body, where the index is `exterior_ior`. If both indices agree to a thousandth, light passes straight through.

    Attributes:
        alpha: roughness, as for `RoughConductor`.
        distribution: of normals, as for `RoughConductor`.
        masking: shadowing and masking of facets, as for `RoughConductor`.
        multiple_bounces: whether light scatters between facets more than once (Kulla and Conty 2017); otherwise it is
            lost.
    """

    alpha: ColorSource = 0.1
    distribution: str = "ggx"
    masking: str | None = None
    multiple_bounces: Flag = False

    type_name: ClassVar[str] = "rough-dielectric"

    @property
    def model(self) -> str:
        options = ("multiple",) * self.multiple_bounces + ("dispersive",) * bool(self.dispersion)
        return ":".join(("rough_dielectric", self.distribution, str(self.masking), *options))

    @property
    def slots(self) -> tuple[ColorSource, ...]:
        """The shape of the distribution, then the values of a smooth boundary."""
        return (self._shape, *super().slots)

    @property
    def table_key(self) -> tuple[Hashable, ...] | None:
        if not self.multiple_bounces:
            return None
        _, *surface = self._albedo_table_key
        if self.dispersion:
            return ("dispersive", *surface, *self.relative_iors)
        return ("dielectric", *surface, self.relative_ior)
