"""The base of all materials, that of materials with a thin film, and checks of their values."""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np

from wrt.errors import InputError
from wrt.scene.description import Kind, instance_of, optional
from wrt.scene.textures import VARYING, ColorSource, NormalMap, checked_texture
from wrt.values import FLOAT32_MAX, color, number, text

if TYPE_CHECKING:
    from typing_extensions import Self

THICKEST_FILM = 1e5
"""The greatest thickness of a film, nm: its colours are gone long before."""

HIGHEST_FILM_INDEX = 10.0
"""The greatest index of a film; no transparent material reaches half of it."""


def color_source(value: ColorSource, name: str, *, maximum: float = 1.0) -> ColorSource:
    """Return a checked colour that may vary over the surface."""
    if isinstance(value, VARYING):
        return checked_texture(value, lambda bound: color(bound, name, maximum=maximum))
    return color(value, name, maximum=maximum)


def value_source(
    value: ColorSource, name: str, *, minimum: float = 0.0, maximum: float = math.inf, above: float = -math.inf
) -> ColorSource:
    """Return a checked number that may vary over the surface."""
    limits = {"minimum": minimum, "maximum": min(maximum, FLOAT32_MAX), "above": above}
    if isinstance(value, VARYING):
        return checked_texture(value, lambda bound: number(np.ravel(bound)[0], name, **limits))
    return number(value, name, **limits)


share = partial(value_source, maximum=1.0)
"""Check of a number from 0 to 1 that may vary over the surface."""

Share = Annotated[ColorSource, share]
Reflectance = Annotated[ColorSource, color_source]
UnlimitedColor = Annotated[ColorSource, partial(color_source, maximum=FLOAT32_MAX)]
"""A colour, such as an emission, that may exceed 1 and vary over the surface."""


@dataclass(frozen=True)
class Material(Kind):
    """Base of all materials; not used by itself.

    A material is a plain description. `model` names its device functions in `kernels/bsdf/`; they read the values of
    the attributes in `slot_names`, in that order.

    Attributes:
        opacity: coverage of the surface, 0 to 1; light passes straight through the rest.
        normal_map: perturbs the shading normal.
        name: for layers of materials.
    """

    _: KW_ONLY
    opacity: Share = 1.0
    normal_map: Annotated[NormalMap | None, optional(instance_of(NormalMap))] = None
    name: Annotated[str, {"type": "string"}, text] = field(default="", compare=False, repr=False)

    slot_names: ClassVar[tuple[str, ...]] = ()

    @classmethod
    def example(cls) -> Self:
        """Return one for lists and tests of all materials; classes with required fields override it."""
        return cls()

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.normal_map is not None and self.parts:
            raise InputError(f"a {self.type_name} has no normals of its own; give normal_map to its parts")
        if self.normal_map is not None and self.normal_map.uv_set != 0:
            raise InputError("normal_map follows the first texture coordinates; only a coat_normal_map has a uv_set")

    @property
    def normal_maps(self) -> tuple[NormalMap, ...]:
        """All normal maps of the material, each for a layer of its own."""
        return () if self.normal_map is None else (self.normal_map,)

    @property
    def slots(self) -> tuple[ColorSource, ...]:
        """The values that the model's device functions read."""
        return tuple(getattr(self, name) for name in self.slot_names)

    @property
    def parts(self) -> tuple[Material, ...]:
        """The materials of a composite one."""
        return ()

    def named(self, name: str) -> Self:
        """Return the material with a name, unless it has one."""
        return self if self.name or not name else replace(self, name=name)

    def label(self, number: int) -> str:
        """Return the name, or type and number where there is none."""
        return self.name or f"{self.type_name or type(self).__name__} {number}"

    @property
    def needs_tangents(self) -> bool:
        """Whether it is anisotropic, so that its tangent must follow the texture coordinates."""
        return False

    @property
    def is_nearly_smooth(self) -> bool:
        """Whether photons bring the caustics that it throws, though it is rough."""
        return False

    @property
    def table_key(self) -> tuple[Hashable, ...] | None:
        """The table that the model reads, if any: its kind, a key of `material_tables.MAKERS`, and its parameters."""
        return None

    @property
    def emission(self) -> ColorSource:
        """Emitted radiance."""
        return (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Filmed(Material):
    """Base of materials that may have a thin film, such as an oxide on metal, whose colours come from interference.

    Attributes:
        film_thickness: thickness of the film in nanometres; 0 is no film.
        film_ior: refractive index of the film, from 1.
    """

    _: KW_ONLY
    film_thickness: Annotated[ColorSource, partial(value_source, maximum=THICKEST_FILM)] = 0.0
    film_ior: Annotated[float, partial(number, minimum=1.0, maximum=HIGHEST_FILM_INDEX)] = 1.3

    @property
    def has_film(self) -> bool:
        """Whether there is a film anywhere."""
        return self.film_thickness != 0.0

    @property
    def film_slots(self) -> tuple[ColorSource, ...]:
        """The values of a film, if there is one."""
        return (self.film_thickness, self.film_ior) if self.has_film else ()

    def _refuse_film(self) -> None:
        if self.has_film:
            raise InputError("multiple_bounces cannot have a film; set film_thickness to 0, or turn it off")
