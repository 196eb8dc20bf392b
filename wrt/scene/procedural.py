"""Procedural textures: patterns and noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, ClassVar

import numpy as np

from wrt.scene.description import Color, Flag, by_type_name
from wrt.scene.textures import Texture
from wrt.values import ColorLike, integer, number, vector


def _scale(value: float | Sequence[float], name: str) -> tuple[float, ...]:
    """Return the cells per unit along three axes, from one number, two for u and v, or three."""
    if isinstance(value, (int, float, str)):
        value = [number(value, name)] * 3
    elif np.ndim(value) == 1 and len(value) == 2:
        value = [*value, value[0]]
    return tuple(vector(value, name))


@dataclass(frozen=True)
class Pattern(Texture):
    """Base of the built-in procedural textures, each of two colours or numbers; not used by itself.

    Attributes:
        first: a colour, or a number.
        second: another.
        scale: cells for each unit of the texture coordinates, or of length: one number, two, or three.
        solid: whether the pattern fills space, by positions in the world, instead of following texture coordinates.
    """

    first: Color = 0.8
    second: Color = 0.2
    scale: Annotated[float | Sequence[float], _scale] = 1.0
    solid: Flag = False

    slot_names: ClassVar[tuple[str, ...]] = ("first", "second", "scale", "solid")

    @property
    def bounds(self) -> tuple[ColorLike, ...]:
        """The two colours."""
        return self.first, self.second

    @property
    def needs_uv(self) -> bool:
        """Whether it follows texture coordinates."""
        return not self.solid


@dataclass(frozen=True)
class Checkerboard(Pattern):
    """Two colours that alternate from cell to cell."""

    type_name: ClassVar[str] = "checkerboard"


@dataclass(frozen=True)
class Bricks(Pattern):
    """A wall of bricks, every other course shifted by half a brick.

    Attributes:
        first: colour of the bricks.
        second: colour of the mortar.
        scale: bricks along u, and courses along v; of solid ones, in each metre along x and y.
        mortar: width of the joints, as a share of a brick's height.
    """

    scale: Annotated[float | Sequence[float], _scale] = (4.0, 8.0)
    mortar: Annotated[float, partial(number, minimum=0.0, maximum=1.0)] = 0.1

    type_name: ClassVar[str] = "bricks"
    slot_names: ClassVar[tuple[str, ...]] = (*Pattern.slot_names, "joints")

    @property
    def joints(self) -> tuple[float, ...]:
        """The joints as shares of a brick's length and of its height."""
        across, up, _ = self.scale  # type: ignore[misc]
        return min(self.mortar * abs(across / up), 1.0) if up else 0.0, self.mortar, 0.0


@dataclass(frozen=True)
class PerlinNoise(Pattern):
    """Clouds of gradient noise between two colours (Perlin 2002).

    Attributes:
        octaves: number of noises in the sum, 1 to 10; each is half as large and half as strong as the one before.
    """

    octaves: Annotated[int, partial(integer, minimum=1, maximum=10)] = 4

    type_name: ClassVar[str] = "perlin"
    slot_names: ClassVar[tuple[str, ...]] = (*Pattern.slot_names, "octaves")


@dataclass(frozen=True)
class WorleyNoise(Pattern):
    """Cells around random points, from the first colour at a point to the second one cell away (Worley 1996)."""

    type_name: ClassVar[str] = "worley"


TEXTURES: dict[str, type[Texture]] = by_type_name(globals(), Texture)
"""Procedural textures by their `type` in scene files."""
