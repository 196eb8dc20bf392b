"""Plastics, paints and varnishes: a diffuse base under a transparent coat."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from functools import partial
from typing import Annotated, ClassVar

from wrt.scene.description import Flag, word_of
from wrt.scene.materials.dielectrics import RefractiveIndex, mean_transmittance
from wrt.scene.materials.material import Material, Reflectance, value_source
from wrt.scene.materials.microfacet import LEAST_ALPHA, masking_for
from wrt.scene.textures import ColorSource


def internal_reflectance(eta: float) -> float:
    """Return the diffuse internal reflectance of a smooth coat, eta = n inside / n outside."""
    return 1.0 - mean_transmittance(1.0 / eta)


@dataclass(frozen=True)
class _Coated(Material):
    """Base of materials with a diffuse base under a coat.

    Attributes:
        reflectance: fraction of light that the base reflects per channel, 0 to 1.
        ior: refractive index of the coat, or a name such as "water" (`wrt materials --presets`).
        exterior_ior: the same for the outside.
        nonlinear: whether internal reflections make colours deeper, as varnish does to wood.
        specular_reflectance: multiplies reflected light; 1 in nature.
    """

    reflectance: Reflectance = 0.5
    ior: RefractiveIndex = 1.5
    exterior_ior: RefractiveIndex = 1.0

    @property
    def relative_ior(self) -> float:
        """Refractive index of the coat over that outside."""
        return float(self.ior) / float(self.exterior_ior)


@dataclass(frozen=True)
class Plastic(_Coated):
    """A diffuse base under a smooth transparent coat; the base receives the light that the coat does not reflect.

    Both sides look the same. All inter-reflections between coat and base are included.
    """

    nonlinear: Flag = False
    specular_reflectance: Reflectance = 1.0

    type_name: ClassVar[str] = "plastic"

    @property
    def slots(self) -> tuple[ColorSource, ...]:
        eta = self.relative_ior
        return (self.reflectance, self.specular_reflectance, eta, internal_reflectance(eta), float(self.nonlinear))


@dataclass(frozen=True)
class RoughPlastic(_Coated):
    """A diffuse base under a rough transparent coat; the base receives the light that the coat does not reflect.

    The coat is the microfacet model of Walter, Marschner, Li and Torrance (2007). Both sides look the same.

    Attributes:
        alpha: roughness of the coat, 1e-4 to 1: about √2 times the root-mean-square slope of its facets.
        distribution: of the facets' normals, "ggx" or "beckmann".
        masking: shadowing and masking of facets, as for `RoughConductor`.
        multiple_bounces: whether light that facets block reaches the base; otherwise it is lost.
    """

    alpha: Annotated[ColorSource, partial(value_source, minimum=LEAST_ALPHA, maximum=1.0)] = 0.1
    distribution: Annotated[str, word_of(("ggx", "beckmann"))] = "ggx"
    masking: str | None = None
    nonlinear: Flag = False
    specular_reflectance: Reflectance = 1.0
    multiple_bounces: Flag = True

    type_name: ClassVar[str] = "rough-plastic"

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set(masking=masking_for(self.distribution, self.masking, self.alpha))

    @property
    def model(self) -> str:
        return f"rough_plastic:{self.distribution}:{self.masking}"

    @property
    def slots(self) -> tuple[ColorSource, ...]:
        return (self.reflectance, self.specular_reflectance, self.relative_ior, self.alpha, float(self.nonlinear))

    @property
    def table_key(self) -> tuple[Hashable, ...]:
        """The table of the coat's transmittance: for its roughness, or for all if the roughness varies."""
        filtered = self.normal_map is not None and self.normal_map.filter
        alpha = self.alpha if isinstance(self.alpha, float) and not filtered else None
        return ("coat", self.distribution, self.masking, self.relative_ior, alpha, self.multiple_bounces)
