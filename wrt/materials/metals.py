"""Mirrors and metals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from wrt.materials.material import Material, color_source, positive_color
from wrt.textures import ColorSource
from wrt.values import ColorLike, color


@dataclass(frozen=True)
class Mirror(Material):
    """An ideal mirror with the same reflectance at every angle, on both sides.

    Attributes:
        reflectance: fraction of light reflected per channel, 0 to 1.
    """

    reflectance: ColorSource = 1.0

    type_name: ClassVar[str] = "mirror"
    slot_names: ClassVar[tuple[str, ...]] = ("reflectance",)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set(reflectance=color_source(self.reflectance, "reflectance"))


@dataclass(frozen=True)
class Conductor(Material):
    """A perfectly smooth metal: mirror reflection weighted by the exact Fresnel equations.

    The default is copper, η and k at 630, 532 and 465 nm.

    Attributes:
        eta: real part of the refractive index per channel, relative to the air around it.
        k: extinction coefficient per channel.
    """

    eta: ColorLike = (0.200, 0.924, 1.102)
    k: ColorLike = (3.912, 2.452, 2.142)

    type_name: ClassVar[str] = "conductor"
    slot_names: ClassVar[tuple[str, ...]] = ("eta", "k")

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set(eta=positive_color(self.eta, "eta"), k=color(self.k, "k"))
