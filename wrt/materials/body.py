"""Surfaces that bound a body which light enters, and what is inside."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import ClassVar

from wrt.errors import InputError
from wrt.materials.material import Material
from wrt.medium import Medium
from wrt.values import integer


@dataclass(frozen=True)
class Body(Material):
    """Base of the materials of bodies that light enters; not used by itself.

    Attributes:
        interior: what fills the body; None is clear.
        priority: where bodies overlap, the one of the highest priority is there, and the others are not.
    """

    interior: Medium | None = field(default=None, kw_only=True)
    priority: int = field(default=0, kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.interior is not None and not isinstance(self.interior, Medium):
            raise InputError(f"interior must be a wrt.Medium, not {type(self.interior).__name__}")
        self._set(priority=integer(self.priority, "priority", minimum=-1_000_000, maximum=1_000_000))

    @property
    def is_body(self) -> bool:
        """Whether it bounds a body, and is not a sheet or opaque."""
        return True

    @property
    def interior_ior(self) -> float | None:
        """Refractive index inside; None where light goes in and out without being bent, as if nothing were there."""
        return None


@dataclass(frozen=True)
class Null(Body):
    """A boundary that does nothing to light: it only says where the medium inside begins.

    Clouds, smoke, fog in a room, or soft wax without a surface. Triangles wind counter-clockwise seen from outside.

    Attributes:
        interior: what fills the body; in scene files the name of a medium.
        priority: where bodies overlap, the one of the highest priority is there, and the others are not.
    """

    type_name: ClassVar[str] = "null"


def bodies_of(material: Material) -> Iterator[Body]:
    """Yield those of a material and its parts that bound bodies."""
    if isinstance(material, Body) and material.is_body:
        yield material
    for part in material.parts:
        yield from bodies_of(part)
