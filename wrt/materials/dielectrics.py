"""Transparent bodies."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from wrt.errors import InputError
from wrt.materials.material import Material, color_source
from wrt.presets import dielectric_ior
from wrt.textures import ColorSource, ImageTexture, VertexColor
from wrt.values import number

DISTRIBUTIONS = ("ggx", "beckmann", "blinn-phong")
"""Distributions of microfacet normals that RoughDielectric knows."""


def refractive_index(value: float | str, name: str) -> float:
    """Return a refractive index, given as a number above 0 or as what the medium is called."""
    if not isinstance(value, str):
        return number(value, name, above=0.0)
    try:
        return dielectric_ior(value)
    except InputError as error:
        raise InputError(f"{name}: {error}") from None


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
class Dielectric(_Boundary):
    """A perfectly smooth boundary of a transparent body: exact Fresnel reflection and refraction.

    Triangles wind counter-clockwise seen from outside the body; outside is `exterior_ior`.

    Attributes:
        ior: refractive index inside, or a name in `wrt.presets.DIELECTRIC_IOR`; 1.5 is common glass.
        exterior_ior: likewise outside; 1 is vacuum, and air to three digits.
        specular_reflectance: what reflected light is multiplied by; 1 in nature.
        specular_transmittance: what refracted light is multiplied by; 1 in nature.
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
class RoughDielectric(_Boundary):
    """A rough boundary of a transparent body, such as ground glass: microfacets that reflect and refract.

    The model of Walter, Marschner, Li and Torrance (2007). Triangles wind counter-clockwise seen from outside
    the body; outside is `exterior_ior`.

    Attributes:
        ior: refractive index inside, or a name in `wrt.presets.DIELECTRIC_IOR`.
        exterior_ior: likewise outside.
        alpha: roughness above 0, at most 1: about the root-mean-square slope of the microfacets. Two numbers are
            those along the texture's u and v.
        distribution: of the microfacets' normals: "ggx", "beckmann" or "blinn-phong".
        masking: how microfacets hide one another; see `wrt.kernels.microfacet`.
        multiple_bounces: whether light that microfacets block goes on to others and gets out at last. Without, a
            rough surface loses it and is too dark.
        specular_reflectance: what reflected light is multiplied by; 1 in nature.
        specular_transmittance: what refracted light is multiplied by; 1 in nature.
    """

    alpha: ColorSource = 0.1
    distribution: str = "ggx"
    masking: str = "smith"
    multiple_bounces: bool = False

    type_name: ClassVar[str] = "rough-dielectric"
    slot_names: ClassVar[tuple[str, ...]] = (*_Boundary.slot_names, "alpha")

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set(alpha=_roughness(self.alpha))

    @property
    def model(self) -> str:
        """The model for these parts."""
        return f"rough_dielectric:{self.distribution}:{self.masking}"


def _roughness(value: ColorSource) -> ColorSource:
    if isinstance(value, (ImageTexture, VertexColor)):
        return value
    if isinstance(value, (list, tuple)):
        u, v = (number(a, "alpha", above=0.0, maximum=1.0) for a in value)
        return (u, v, 0.0)
    a = number(value, "alpha", above=0.0, maximum=1.0)
    return (a, a, 0.0)
