"""The material of glTF files: metal or dielectric by one number, and layers on it."""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from wrt.errors import InputError
from wrt.materials.body import Body
from wrt.materials.material import color_source, value_source
from wrt.materials.microfacet import LEAST_ALPHA
from wrt.presets import dielectric_ior
from wrt.textures import ColorSource, ImageTexture, VertexColor
from wrt.values import FLOAT32_MAX, boolean, number

_SHARES = ("metallic", "roughness", "specular", "transmission", "coat", "coat_roughness", "sheen_roughness")
"""Numbers from 0 to 1, which may vary over the surface."""


@dataclass(frozen=True)
class Principled(Body):
    """A material by few numbers that are easy to choose: the metalness workflow, as glTF 2.0 files mean it.

    Metal and dielectric (plastic, paint, wood, stone, glass) are mixed by `metallic`; on them may lie sheen, and on
    that a clear coat. Some names are not glTF's: `coat` is its clearcoat, `transmission` with `thin_walled` is
    KHR_materials_transmission, and without it the same with KHR_materials_volume.

    Attributes:
        base_color: what a dielectric's body, or a metal seen straight on, reflects per channel, 0 to 1.
        metallic: 0 dielectric, 1 metal.
        roughness: 0 mirror to 1 matt; its square is the roughness α of GGX.
        ior: refractive index of the dielectric, from 1, or a name in `wrt.presets.DIELECTRIC_IOR`. 0 stands for
            infinite, as in glTF: specular_color then is the whole reflectance at normal incidence.
        specular: strength of the dielectric's reflection.
        specular_color: tints it at normal incidence; may exceed 1.
        anisotropy: how much longer highlights are along one direction, 0 to 1. An image as in
            KHR_materials_anisotropy: red and green the direction in tangent space, blue the strength.
        anisotropy_rotation: turns that direction counter-clockwise from growing u towards growing v, radians.
        transmission: share of the light that enters the dielectric that goes through, not back: glass.
        thin_walled: whether the surface is a sheet with both its sides, not the boundary of a body: light that goes
            through is not bent, nor followed inside.
        coat: share of the surface under a clear coat of index 1.5.
        coat_roughness: as `roughness`, of the coat.
        sheen_color: colour of fibres that stand on the surface, as on velvet, per channel, 0 to 1.
        sheen_roughness: how much they lean; below 0.07 as 0.07.
        emission: radiance that the surface gives off, W·sr⁻¹·m⁻².
        multiple_bounces: whether light that facets block bounces on (Kulla and Conty 2017), which makes rough metals
            brighter and more saturated. Otherwise it is lost, as in most programs that show glTF.
        interior: what fills the body, where `transmission` lets light in; in scene files the name of a medium.
        priority: where bodies overlap, the one of the highest priority is there, and the others are not.
    """

    base_color: ColorSource = 0.8
    metallic: ColorSource = 0.0
    roughness: ColorSource = 0.5
    ior: float | str = 1.5
    specular: ColorSource = 1.0
    specular_color: ColorSource = 1.0
    anisotropy: ColorSource = 0.0
    anisotropy_rotation: float = 0.0
    transmission: ColorSource = 0.0
    thin_walled: bool = False
    coat: ColorSource = 0.0
    coat_roughness: ColorSource = 0.0
    sheen_color: ColorSource = 0.0
    sheen_roughness: ColorSource = 0.0
    emission: ColorSource = 0.0
    multiple_bounces: bool = False

    type_name: ClassVar[str] = "principled"

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set(**{name: value_source(getattr(self, name), name, maximum=1.0) for name in _SHARES})
        self._set(
            base_color=color_source(self.base_color, "base_color"),
            ior=_refractive_index(self.ior),
            specular_color=color_source(self.specular_color, "specular_color", maximum=FLOAT32_MAX),
            anisotropy=_anisotropy(self.anisotropy),
            anisotropy_rotation=number(self.anisotropy_rotation, "anisotropy_rotation"),
            sheen_color=color_source(self.sheen_color, "sheen_color"),
            emission=color_source(self.emission, "emission", maximum=FLOAT32_MAX),
        )
        for name in ("thin_walled", "multiple_bounces"):
            boolean(getattr(self, name), name)
        if self.ior == 0.0 and self.transmission != 0.0 and not self.thin_walled:
            raise InputError("ior 0 stands for infinite, which lets no light through; set transmission to 0, or an ior")
        if self.interior is not None and not self.is_body:
            raise InputError("an interior needs a transmission above 0, and no thin_walled: light must get inside")
        if self.multiple_bounces:
            _ = self.table_key

    @property
    def is_body(self) -> bool:
        """Whether light gets inside."""
        return self.transmission != 0.0 and not self.thin_walled

    @property
    def interior_ior(self) -> float:
        """Refractive index inside."""
        return float(self.ior)

    @property
    def features(self) -> tuple[str, ...]:
        """What it has besides a base: the parts of its model's name, in their order."""
        through = "thin" if self.thin_walled else "transmission"
        present = {
            "anisotropic": self.needs_tangents,
            through: self.transmission != 0.0,
            "coat": self.coat != 0.0,
            "sheen": self.sheen_color != (0.0, 0.0, 0.0),
            "bounces": self.multiple_bounces,
        }
        return tuple(name for name, there in present.items() if there)

    @property
    def model(self) -> str:
        """Only with what is there, so that plain materials have small kernels."""
        return ":".join(("principled", *self.features))

    @property
    def slots(self) -> tuple[ColorSource, ...]:
        """What kernels/bsdf/principled.py reads for these features."""
        values: list[ColorSource] = [
            self.base_color,
            self.metallic,
            self.roughness,
            self.specular,
            self.specular_color,
            float(self.ior),
        ]
        features = self.features
        if "anisotropic" in features:
            turn = self.anisotropy_rotation
            along_u = (1.0, 0.5, self.anisotropy) if isinstance(self.anisotropy, float) else self.anisotropy
            values += [along_u, (math.cos(turn), math.sin(turn), 0.0)]
        if "transmission" in features or "thin" in features:
            values += [self.transmission]
        if "coat" in features:
            values += [self.coat, self.coat_roughness]
        if "sheen" in features:
            values += [self.sheen_color, self.sheen_roughness]
        return tuple(values)

    @property
    def needs_tangents(self) -> bool:
        """Whether it is anisotropic."""
        return self.anisotropy != 0.0

    @property
    def table_key(self) -> tuple[Hashable, ...] | None:
        """That of energy lost by a single bounce (wrt/build/albedo_tables.py), for multiple bounces."""
        if not self.multiple_bounces:
            return None
        if not self.needs_tangents:
            return ("reflection", "ggx", "smith", None)
        if not (isinstance(self.roughness, float) and isinstance(self.anisotropy, float)):
            raise InputError("multiple_bounces needs a roughness and an anisotropy that are numbers, or no anisotropy")
        alpha = max(self.roughness**2, LEAST_ALPHA)
        return ("reflection", "ggx", "smith", (alpha + (1.0 - alpha) * self.anisotropy**2, alpha, 0.0))


def _refractive_index(value: float | str) -> float:
    """Return a refractive index of at least 1, or 0."""
    if isinstance(value, str):
        try:
            return dielectric_ior(value)
        except InputError as error:
            raise InputError(f"ior: {error}") from None
    if not isinstance(value, bool) and np.ndim(value) == 0 and value == 0:
        return 0.0
    return number(value, "ior", minimum=1.0)


def _anisotropy(value: ColorSource) -> ColorSource:
    """Return a strength, or an image of directions and strengths."""
    if isinstance(value, VertexColor) or (isinstance(value, ImageTexture) and value.channel is not None):
        raise InputError("anisotropy must be a number, or an image with the direction in red and green")
    return value_source(value, "anisotropy", maximum=1.0)
