"""Transparent bodies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from wrt.materials.material import Material
from wrt.values import number


@dataclass(frozen=True)
class Dielectric(Material):
    """A perfectly smooth boundary of a transparent body: exact Fresnel reflection and refraction.

    Triangles wind counter-clockwise seen from outside the body; outside is `exterior_ior`.

    Attributes:
        ior: refractive index inside; 1.5 is common glass.
        exterior_ior: refractive index outside; 1 is vacuum, and air to three digits.
    """

    ior: float = 1.5
    exterior_ior: float = 1.0

    type_name: ClassVar[str] = "dielectric"
    slot_names: ClassVar[tuple[str, ...]] = ("relative_ior",)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set(
            ior=number(self.ior, "ior", above=0.0),
            exterior_ior=number(self.exterior_ior, "exterior_ior", above=0.0),
        )

    @property
    def relative_ior(self) -> float:
        """Refractive index inside over outside."""
        return self.ior / self.exterior_ior
