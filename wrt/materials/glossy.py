"""Blurred mirrors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from wrt.materials.material import Material, color_source, value_source
from wrt.textures import ColorSource


@dataclass(frozen=True)
class Glossy(Material):
    """A mirror whose direction is jittered in a square perpendicular to it, as in distribution ray tracing.

    A picture of gloss by its simplest means (Cook, Porter and Carpenter 1984), not a law of reflection: it is not
    reciprocal, and has the same reflectance at every angle. RoughConductor is what metals do.

    Attributes:
        reflectance: fraction of light reflected per channel, 0 to 1; near grazing angles the part of the square that
            lies below the surface is lost.
        side: side of the square at distance 1, above 0 and at most 100; the blur's full width is 2 atan(side / 2).
    """

    reflectance: ColorSource = 1.0
    side: ColorSource = 0.1

    type_name: ClassVar[str] = "glossy"
    slot_names: ClassVar[tuple[str, ...]] = ("reflectance", "side")

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set(
            reflectance=color_source(self.reflectance, "reflectance"),
            side=value_source(self.side, "side", maximum=100.0, above=0.0),
        )
