"""Matt surfaces."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from wrt.scene.materials.material import Material
from wrt.scene.textures import ColorSource


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
        self._check_colors("reflectance")


@dataclass(frozen=True)
class OrenNayar(Material):
    """A rough matt surface such as plaster or clay, on both sides; flatter than Diffuse, and retro-reflective.

    The energy-preserving form (Portsmouth, Kutz and Hill 2025) of the model of Oren and Nayar (1994). With `sigma` 0
    it is Diffuse.

    Attributes:
        reflectance: fraction of light that each facet reflects per channel, 0 to 1. The surface as a whole reflects
            less, because light between facets is absorbed more than once; a white one stays white.
        sigma: standard deviation of the facets' slope angle, radians, 0 to π/2; 0.35 is 20 degrees.
    """

    reflectance: ColorSource = 0.18
    sigma: ColorSource = 0.35

    type_name: ClassVar[str] = "oren-nayar"
    slot_names: ClassVar[tuple[str, ...]] = ("reflectance", "sigma")

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_colors("reflectance")
        self._check_values("sigma", maximum=0.5 * math.pi)
