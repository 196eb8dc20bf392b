"""Transparent bodies."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.materials.body import Body
from wrt.materials.material import Material, color_source
from wrt.materials.microfacet import albedo_table_key, is_anisotropic, masking_for, roughness, shape_of
from wrt.presets import dielectric_ior
from wrt.textures import ColorSource
from wrt.values import boolean, number


def refractive_index(value: float | str, name: str) -> float:
    """Return a refractive index, given as a number above 0 or as what the medium is called."""
    if not isinstance(value, str):
        return number(value, name, above=0.0)
    try:
        return dielectric_ior(value)
    except InputError as error:
        raise InputError(f"{name}: {error}") from None


def mean_transmittance(eta: float) -> float:
    """Return the share of diffuse light that a smooth boundary lets through, eta = n_t / n_i: 2 ∫ (1 − F) μ dμ.

    For light from the side of the lower index the integrand is smooth. From the other side the integral is eta² of
    that, since radiance over index squared is the same both ways.
    """
    denser = max(eta, 1.0 / eta)
    nodes, weights = np.polynomial.legendre.leggauss(64)
    # cosθ = t⁴ draws out what bends near grazing angles where the indices are almost equal.
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
    """What the boundaries of transparent media have in common.

    Attributes:
        ior: refractive index inside, or a name in `wrt.presets.DIELECTRIC_IOR`; 1.5 is common glass.
        exterior_ior: likewise outside; 1 is vacuum, and air to three digits.
        specular_reflectance: what reflected light is multiplied by; 1 in nature.
        specular_transmittance: what refracted light is multiplied by; 1 in nature.
    """

    ior: float | str = 1.5
    exterior_ior: float | str = 1.0
    specular_reflectance: ColorSource = field(default=1.0, kw_only=True)
    specular_transmittance: ColorSource = field(default=1.0, kw_only=True)

    slot_names: ClassVar[tuple[str, ...]] = ("relative_ior", "specular_reflectance", "specular_transmittance")

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set(
            ior=refractive_index(self.ior, "ior"),
            exterior_ior=refractive_index(self.exterior_ior, "exterior_ior"),
            specular_reflectance=color_source(self.specular_reflectance, "specular_reflectance"),
            specular_transmittance=color_source(self.specular_transmittance, "specular_transmittance"),
        )

    @property
    def relative_ior(self) -> float:
        """Refractive index inside over outside."""
        return float(self.ior) / float(self.exterior_ior)


@dataclass(frozen=True)
class _BodyBoundary(_Boundary, Body):
    """The boundary of a body, not of a pane."""

    @property
    def interior_ior(self) -> float:
        """Refractive index inside."""
        return float(self.ior)


@dataclass(frozen=True)
class Dielectric(_BodyBoundary):
    """A perfectly smooth boundary of a transparent body: exact Fresnel reflection and refraction.

    Triangles wind counter-clockwise seen from outside the body; outside is `exterior_ior`.

    Attributes:
        ior: refractive index inside, or a name in `wrt.presets.DIELECTRIC_IOR`; 1.5 is common glass.
        exterior_ior: likewise outside; 1 is vacuum, and air to three digits.
        specular_reflectance: what reflected light is multiplied by; 1 in nature.
        specular_transmittance: what refracted light is multiplied by; 1 in nature.
        interior: what fills the body; None, in scene files left out, is clear; else there the name of a medium.
        priority: where bodies overlap, the one of the highest priority is there, and the others are not.
    """

    type_name: ClassVar[str] = "dielectric"


@dataclass(frozen=True)
class ThinDielectric(_Boundary):
    """A thin pane with two smooth faces, such as a window: light is reflected, or goes straight through.

    One surface stands for both faces and all reflections between them, and looks the same from both sides.

    Attributes:
        ior: refractive index of the pane, or a name in `wrt.presets.DIELECTRIC_IOR`.
        exterior_ior: likewise of what is on both sides of it.
        specular_reflectance: what reflected light is multiplied by; 1 in nature.
        specular_transmittance: what light that goes through is multiplied by; 1 is clear.
    """

    type_name: ClassVar[str] = "thin-dielectric"


@dataclass(frozen=True)
class RoughDielectric(_BodyBoundary):
    """A rough boundary of a transparent body, such as ground glass: facets too small to see reflect and refract.

    The model of Walter, Marschner, Li and Torrance (2007). Triangles wind counter-clockwise seen from outside the
    body; outside is `exterior_ior`. Where both indices are the same to a thousandth, light passes straight through.

    Attributes:
        ior: refractive index inside, or a name in `wrt.presets.DIELECTRIC_IOR`; 1.5 is common glass.
        exterior_ior: likewise outside; 1 is vacuum, and air to three digits.
        alpha: roughness, as for `RoughConductor`.
        distribution: of normals, as for `RoughConductor`.
        masking: how facets hide one another, as for `RoughConductor`.
        multiple_bounces: whether light that facets block bounces on (Kulla and Conty 2017), so that none is lost.
            Otherwise it is lost, as in most renderers, and rough glass is too dark.
        specular_reflectance: what reflected light is multiplied by; 1 in nature.
        specular_transmittance: what refracted light is multiplied by; 1 in nature.
        interior: what fills the body; None, in scene files left out, is clear; else there the name of a medium.
        priority: where bodies overlap, the one of the highest priority is there, and the others are not.
    """

    alpha: ColorSource = 0.1
    distribution: str = "ggx"
    masking: str | None = None
    multiple_bounces: bool = False

    type_name: ClassVar[str] = "rough-dielectric"

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set(masking=masking_for(self.distribution, self.masking, self.alpha))
        self._set(alpha=roughness(self.alpha, self.distribution))
        if boolean(self.multiple_bounces, "multiple_bounces"):
            albedo_table_key(self.alpha, self.distribution, self.masking)

    @property
    def model(self) -> str:
        """The combination of distribution, masking and number of bounces."""
        name = f"rough_dielectric:{self.distribution}:{self.masking}"
        return f"{name}:multiple" if self.multiple_bounces else name

    @property
    def slots(self) -> tuple[ColorSource, ...]:
        """The shape of the distribution, then what a smooth boundary has."""
        return (shape_of(self.alpha, self.distribution), *super().slots)

    @property
    def table_key(self) -> tuple[Hashable, ...] | None:
        """For multiple bounces, the table of what one bounce loses on each side."""
        if not self.multiple_bounces:
            return None
        _, *surface = albedo_table_key(self.alpha, self.distribution, self.masking)
        return ("dielectric", *surface, self.relative_ior)

    @property
    def needs_tangents(self) -> bool:
        """Whether its roughness along x and y differs."""
        return is_anisotropic(self.alpha, self.distribution)
