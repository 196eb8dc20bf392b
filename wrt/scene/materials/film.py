"""Thin films on surfaces, whose colours come from interference."""

from __future__ import annotations

from dataclasses import dataclass, field

from wrt.errors import InputError
from wrt.scene.materials.material import Material
from wrt.scene.textures import ColorSource
from wrt.values import number

THICKEST_FILM = 1e5
"""The greatest thickness of a film, nm: its colours are gone long before."""

HIGHEST_INDEX = 10.0
"""The greatest index of a film; no transparent material reaches half of it."""


@dataclass(frozen=True)
class Filmed(Material):
    """Base of materials that may have a thin film; not used by itself.

    Attributes:
        film_thickness: thickness of the film, nm; 0 is no film.
        film_ior: its refractive index, from 1.
    """

    film_thickness: ColorSource = field(default=0.0, kw_only=True)
    film_ior: float = field(default=1.3, kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_values("film_thickness", maximum=THICKEST_FILM)
        self._set(film_ior=number(self.film_ior, "film_ior", minimum=1.0, maximum=HIGHEST_INDEX))

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
