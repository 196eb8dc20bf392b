"""What every material has in common."""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import Any, ClassVar

from wrt.errors import InputError
from wrt.textures import ColorSource, ImageTexture, NormalMap, VertexColor
from wrt.values import FLOAT32_MAX, Vec3, color, number


@dataclass(frozen=True)
class Material:
    """Base of all materials; not used by itself.

    A material is a plain description. Its `model` names what `kernels/bsdf/` holds for it, and the
    attributes in `slot_names` are the values those device functions read, in their order.

    Attributes:
        opacity: share of the surface that is there, 0 to 1; light passes through the rest as through air.
        normal_map: bends the shading normal.
    """

    opacity: ColorSource = field(default=1.0, kw_only=True)
    normal_map: NormalMap | None = field(default=None, kw_only=True)

    type_name: ClassVar[str] = ""
    """The material's `type` in scene files."""
    slot_names: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        self._set(opacity=value_source(self.opacity, "opacity", maximum=1.0))
        if self.normal_map is not None:
            if not isinstance(self.normal_map, NormalMap):
                raise InputError(f"normal_map must be a wrt.NormalMap, not {type(self.normal_map).__name__}")
            if self.parts:
                raise InputError(f"a {self.type_name} has no normals of its own; give normal_map to its parts")

    @property
    def model(self) -> str:
        """Name of the reflection model, by default the material's own."""
        return self.type_name.replace("-", "_")

    @property
    def slots(self) -> tuple[ColorSource, ...]:
        """The values that the model's device functions read: the attributes of `slot_names`."""
        return tuple(getattr(self, name) for name in self.slot_names)

    @property
    def parts(self) -> tuple[Material, ...]:
        """The materials that this one is made of."""
        return ()

    @property
    def needs_tangents(self) -> bool:
        """Whether it looks different when turned about its normal: then its x follows the texture coordinates."""
        return False

    @property
    def table_key(self) -> tuple[Hashable, ...] | None:
        """Which table the model reads: a kind in wrt/build/tables.py and what it is made from; None without one."""
        return None

    @property
    def emission(self) -> ColorSource:
        """Radiance that the surface gives off by itself."""
        return (0.0, 0.0, 0.0)

    def _set(self, **values: Any) -> None:
        """Replace attributes by their checked values while the material is made."""
        for name, value in values.items():
            object.__setattr__(self, name, value)


def color_source(value: ColorSource, name: str, *, maximum: float = 1.0) -> ColorSource:
    """Return a colour that may vary over the surface, checked."""
    if isinstance(value, (ImageTexture, VertexColor)):
        return value
    return color(value, name, maximum=maximum)


def value_source(
    value: ColorSource, name: str, *, minimum: float = 0.0, maximum: float = math.inf, above: float = -math.inf
) -> ColorSource:
    """Return a number that may vary over the surface, checked."""
    if isinstance(value, (ImageTexture, VertexColor)):
        return value
    return number(value, name, minimum=minimum, maximum=min(maximum, FLOAT32_MAX), above=above)


def positive_color(value: Any, name: str) -> Vec3:
    """Return a colour of which no channel is zero."""
    result = color(value, name)
    if min(result) <= 0.0:
        raise InputError(f"{name} must be greater than 0 in each channel, not {result}")
    return result
