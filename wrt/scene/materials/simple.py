"""Matt surfaces, ideal mirrors and mirrors blurred without facets."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import Annotated, ClassVar

from wrt.errors import InputError
from wrt.scene.description import optional
from wrt.scene.materials.material import Material, Reflectance, value_source
from wrt.scene.textures import ColorSource

_DEFAULT_SIDE = 0.1


@dataclass(frozen=True)
class Diffuse(Material):
    """Lambertian reflection, f = reflectance / π (Lambert 1760), on both sides.

    Attributes:
        reflectance: fraction of light reflected per channel, 0 to 1; 0.18 is photographers' middle grey.
    """

    reflectance: Reflectance = 0.18

    type_name: ClassVar[str] = "diffuse"
    slot_names: ClassVar[tuple[str, ...]] = ("reflectance",)


@dataclass(frozen=True)
class OrenNayar(Material):
    """A rough matt surface such as plaster or clay, on both sides; retro-reflective.

    The energy-preserving form (Portsmouth, Kutz and Hill 2025) of the model of Oren and Nayar (1994). With `sigma` 0
    it is Diffuse.

    Attributes:
        reflectance: fraction of light that each facet reflects per channel, 0 to 1; the whole surface reflects less,
            unless white.
        sigma: standard deviation of the facets' slope angle, radians, 0 to π/2; 0.35 is 20 degrees.
    """

    reflectance: Reflectance = 0.18
    sigma: Annotated[ColorSource, partial(value_source, maximum=0.5 * math.pi)] = 0.35

    type_name: ClassVar[str] = "oren-nayar"
    slot_names: ClassVar[tuple[str, ...]] = ("reflectance", "sigma")


@dataclass(frozen=True)
class Mirror(Material):
    """An ideal mirror with the same reflectance at every angle, on both sides.

    Attributes:
        reflectance: fraction of light reflected per channel, 0 to 1.
    """

    reflectance: Reflectance = 1.0

    type_name: ClassVar[str] = "mirror"
    slot_names: ClassVar[tuple[str, ...]] = ("reflectance",)


@dataclass(frozen=True)
class Glossy(Material):
    """A mirror whose direction is jittered, as in distribution ray tracing: in a square, or by the lobe of Phong.

    The simplest approximation of gloss (Cook, Porter and Carpenter 1984), not a physical BRDF: it is not reciprocal,
    and its reflectance is the same at every angle. For metals, use RoughConductor.

    Attributes:
        reflectance: fraction of light reflected per channel, 0 to 1.
        side: side of a square at distance 1 across the mirrored direction, above 0 and at most 100; by default 0.1.
        exponent: instead of the square, n of Phong's lobe (n + 1) / 2π cosⁿα (1975), 0 to 100000.
    """

    reflectance: Reflectance = 1.0
    side: Annotated[ColorSource | None, optional(partial(value_source, maximum=100.0, above=0.0))] = None
    exponent: Annotated[ColorSource | None, optional(partial(value_source, maximum=100_000.0))] = None

    type_name: ClassVar[str] = "glossy"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.exponent is None and self.side is None:
            self._set(side=_DEFAULT_SIDE)
        elif self.exponent is not None and self.side is not None:
            raise InputError("gloss is given by side or by exponent: choose one of them")

    @property
    def model(self) -> str:
        return "glossy" if self.exponent is None else "glossy:phong"

    @property
    def slots(self) -> tuple[ColorSource, ...]:
        width = self.side if self.exponent is None else self.exponent
        assert width is not None
        return self.reflectance, width
