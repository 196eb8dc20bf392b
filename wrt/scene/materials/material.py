"""The base of all materials, and checks that they share."""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

from wrt.errors import InputError
from wrt.scene.textures import ColorSource, ImageTexture, NormalMap, VertexColor
from wrt.values import FLOAT32_MAX, Vec3, color, number

if TYPE_CHECKING:
    from typing_extensions import Self


@dataclass(frozen=True)
class Material:
    """Base of all materials; not used by itself.

    A material is a plain description. `model` names its device functions in `kernels/bsdf/`; they read the values of
    the attributes in `slot_names`, in that order.

    Attributes:
        opacity: coverage of the surface, 0 to 1; light passes straight through the rest.
        normal_map: perturbs the shading normal.
    """

    opacity: ColorSource = field(default=1.0, kw_only=True)
    normal_map: NormalMap | None = field(default=None, kw_only=True)

    type_name: ClassVar[str] = ""
    """The material's `type` in scene files."""
    slot_names: ClassVar[tuple[str, ...]] = ()

    @classmethod
    def example(cls) -> Self:
        """Return one for lists and tests of all materials: as it comes, unless a class has no default."""
        return cls()

    def __post_init__(self) -> None:
        self._check_values("opacity", maximum=1.0)
        if self.normal_map is not None:
            if not isinstance(self.normal_map, NormalMap):
                raise InputError(f"normal_map must be a wrt.NormalMap, not {type(self.normal_map).__name__}")
            if self.parts:
                raise InputError(f"a {self.type_name} has no normals of its own; give normal_map to its parts")

    @property
    def model(self) -> str:
        """Name of the model in kernels, by default the material's own."""
        return self.type_name.replace("-", "_")

    @property
    def slots(self) -> tuple[ColorSource, ...]:
        """The values that the model's device functions read."""
        return tuple(getattr(self, name) for name in self.slot_names)

    @property
    def parts(self) -> tuple[Material, ...]:
        """The materials of a composite one."""
        return ()

    @property
    def needs_tangents(self) -> bool:
        """Whether it is anisotropic, so that its tangent must follow the texture coordinates."""
        return False

    @property
    def table_key(self) -> tuple[Hashable, ...] | None:
        """The table that the model reads, if any: its kind, a key of `material_tables.MAKERS`, and its parameters."""
        return None

    @property
    def emission(self) -> ColorSource:
        """Emitted radiance."""
        return (0.0, 0.0, 0.0)

    def _set(self, **values: Any) -> None:
        """Replace attributes by their checked values during construction."""
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def _check_colors(self, *names: str, maximum: float = 1.0) -> None:
        """Check attributes that are colours which may vary over the surface."""
        self._set(**{name: color_source(getattr(self, name), name, maximum=maximum) for name in names})

    def _check_values(self, *names: str, **limits: float) -> None:
        """Check attributes that are numbers which may vary over the surface."""
        self._set(**{name: value_source(getattr(self, name), name, **limits) for name in names})


def color_source(value: ColorSource, name: str, *, maximum: float = 1.0) -> ColorSource:
    """Return a checked colour that may vary over the surface."""
    if isinstance(value, (ImageTexture, VertexColor)):
        return value
    return color(value, name, maximum=maximum)


def value_source(
    value: ColorSource, name: str, *, minimum: float = 0.0, maximum: float = math.inf, above: float = -math.inf
) -> ColorSource:
    """Return a checked number that may vary over the surface."""
    if isinstance(value, (ImageTexture, VertexColor)):
        return value
    return number(value, name, minimum=minimum, maximum=min(maximum, FLOAT32_MAX), above=above)


def positive_color(value: Any, name: str) -> Vec3:
    """Return a colour with every channel above 0."""
    result = color(value, name)
    if min(result) <= 0.0:
        raise InputError(f"{name} must be greater than 0 in each channel, not {result}")
    return result
