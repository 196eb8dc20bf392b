"""Matt surfaces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from wrt.materials.material import Material, color_source
from wrt.textures import ColorSource


@dataclass(frozen=True)
class Diffuse(Material):
    """Lambertian reflection, f = reflectance / π (Lambert 1760), on both sides.

    Attributes:
        reflectance: fraction of light reflected per channel, 0 to 1; 0.18 is photographers' middle grey.
    """

    reflectance: ColorSource = 0.18

    type_name: ClassVar[str] = "diffuse"
    slot_names: ClassVar[tuple[str, ...]] = ("reflectance",)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set(reflectance=color_source(self.reflectance, "reflectance"))
