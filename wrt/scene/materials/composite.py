"""Materials made of others, and emissive surfaces."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

from wrt.errors import InputError
from wrt.scene.description import instance_of
from wrt.scene.materials.material import Material, Share, UnlimitedColor
from wrt.scene.materials.simple import Diffuse
from wrt.scene.textures import ColorSource, shines

MAX_NESTING = 7
"""Nesting limit of composite materials, which kernels/materials/choice.py shares."""


def _nesting(material: Material) -> int:
    return 1 + max((_nesting(part) for part in material.parts), default=-1)


def _dark_part(value: Material, name: str) -> Material:
    part: Material = instance_of(Material)(value, name)
    if shines(part.emission):
        raise InputError(f"{name} must not emit light; give the shape an emission instead")
    if _nesting(part) >= MAX_NESTING:
        raise InputError(f"materials are nested more than {MAX_NESTING} deep")
    return part


_Part = Annotated[Material, _dark_part]


@dataclass(frozen=True)
class Mix(Material):
    """A blend of two materials: f = (1 − weight) f_first + weight f_second.

    Each hit picks one of them at random in that proportion.

    Attributes:
        first, second: the two materials; in scene files their names.
        weight: share of the second material, 0 to 1.
    """

    first: _Part = field(default_factory=Diffuse)
    second: _Part = field(default_factory=Diffuse)
    weight: Share = 0.5

    type_name: ClassVar[str] = "mix"
    slot_names: ClassVar[tuple[str, ...]] = ("weight",)

    @property
    def parts(self) -> tuple[Material, ...]:
        return (self.first, self.second)


@dataclass(frozen=True)
class TwoSided(Material):
    """One material on the front, where triangles wind counter-clockwise, and another on the back.

    Reflecting materials without this wrapper look the same on both sides.

    Attributes:
        front: the material of the front; in scene files its name.
        back: the material of the back; in scene files its name. Black by default.
    """

    front: _Part = field(default_factory=Diffuse)
    back: _Part = field(default_factory=lambda: Diffuse(0.0))

    type_name: ClassVar[str] = "two-sided"

    @property
    def parts(self) -> tuple[Material, ...]:
        return (self.front, self.back)


@dataclass(frozen=True)
class Emissive(Material):
    """A surface that emits the same radiance in every direction and reflects nothing.

    Attributes:
        radiance: radiance emitted from its front, per channel, W·sr⁻¹·m⁻².
    """

    radiance: UnlimitedColor = 1.0

    type_name: ClassVar[str] = "emissive"

    @property
    def model(self) -> str:
        """The model of a black Lambertian surface."""
        return Diffuse.type_name

    @property
    def slots(self) -> tuple[ColorSource, ...]:
        return (0.0,)

    @property
    def emission(self) -> ColorSource:
        return self.radiance


@dataclass(frozen=True)
class Unlit(Material):
    """A surface that looks the same under any light, as KHR_materials_unlit of glTF.

    The camera sees its colour, also in smooth mirrors and clear glass. It lights nothing else, and reflects nothing. It
    casts shadows, but where it has one side, only of light that comes to its front.

    Attributes:
        color: radiance that is seen, per channel, W·sr⁻¹·m⁻².
    """

    color: UnlimitedColor = 1.0

    type_name: ClassVar[str] = "unlit"

    model = Emissive.model
    slots = Emissive.slots

    @property
    def emission(self) -> ColorSource:
        return self.color
