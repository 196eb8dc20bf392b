"""Surfaces that bound a body which light enters."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import KW_ONLY, dataclass
from functools import partial
from typing import Annotated, ClassVar

from wrt.errors import InputError
from wrt.scene.description import instance_of, optional
from wrt.scene.materials.material import Material
from wrt.scene.medium import Medium
from wrt.scene.textures import ColorSource
from wrt.values import Vec3, integer


@dataclass(frozen=True)
class Body(Material):
    """Base of the materials of bodies that light enters.

    Attributes:
        interior: medium inside the body; by default it is clear.
        priority: where bodies overlap, only the one of the highest priority exists.
    """

    _: KW_ONLY
    interior: Annotated[Medium | None, optional(instance_of(Medium))] = None
    priority: Annotated[int, partial(integer, minimum=-1_000_000, maximum=1_000_000)] = 0

    @property
    def is_body(self) -> bool:
        """Whether it bounds a body, and is neither a sheet nor opaque."""
        return True

    @property
    def interior_ior(self) -> float | None:
        """Refractive index inside; None where light enters and leaves without refraction."""
        return None

    @property
    def interior_spread(self) -> Vec3:
        """The refractive index of each channel less `interior_ior`."""
        return (0.0, 0.0, 0.0)


class Entered(Body):
    """Base of the materials that light enters by their `transmission`, unless they are thin.

    Attributes:
        interior: medium inside the body, if `transmission` lets light in; in scene files its name.
    """

    transmission: ColorSource
    thin_walled: bool

    @property
    def is_body(self) -> bool:
        """Whether light gets inside."""
        return self.transmission != 0.0 and not self.thin_walled

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.interior is not None and not self.is_body:
            raise InputError("an interior needs a transmission above 0 and thin_walled off, so that light gets inside")


@dataclass(frozen=True)
class Null(Body):
    """A boundary that does not affect light; it only marks where the medium inside begins.

    For clouds, smoke, fog in a room, or wax without a surface. Triangles wind counter-clockwise seen from outside.
    """

    type_name: ClassVar[str] = "null"


def bodies_of(material: Material) -> Iterator[Body]:
    """Yield the material and its parts, as far as they bound bodies."""
    if isinstance(material, Body) and material.is_body:
        yield material
    for part in material.parts:
        yield from bodies_of(part)
