"""What all lights without a mesh share."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.linalg import norm
from wrt.scene.description import GroupName, Kind, optional
from wrt.scene.textures import CHANNELS, ImageTexture
from wrt.values import Vec3, color, text, vector

EVERYWHERE = (0.0, 1.0, 0.0)
"""The axis of lights that emit in every direction."""


class LightExtent(NamedTuple):
    """Position, orientation and power of a light, for light selection.

    Attributes:
        corners: (K, 3) points whose convex hull contains the light; None for a light infinitely far away.
        axis: unit vector, the centre of the light's normals; for a distant light, the direction its light travels.
        amount: radiance, intensity or irradiance, per channel.
        power_over_amount: power / amount; for a distant light, irradiance / amount.
        cos_spread: cosine of the greatest angle between the axis and a normal; −1 for lights that emit everywhere.
        cos_falloff: cosine of the angle to the normal beyond which nothing is emitted; 0 for surfaces.
        two_sided: whether it also emits against its axis.
    """

    corners: Any
    axis: Any
    amount: Any
    power_over_amount: float = 1.0
    cos_spread: float = 1.0
    cos_falloff: float = 0.0
    two_sided: bool = False


@dataclass(frozen=True)
class Light(Kind):
    """Base of all lights without a mesh; not used by itself.

    A light is a plain description. `model` names its device functions in `kernels/lights/`; `record`, `shape` and
    `extent` return what they read.

    Attributes:
        name: name of its parameters, see `wrt.parameters`; by default its type.
        group: name of its light group; lights without one are in the group "rest".
    """

    _: KW_ONLY
    name: Annotated[str, text] = ""
    group: GroupName = None

    def record(self) -> dict[str, Any]:
        """Return fields of the LightRecord: `value`, and `place` and `two_sided` where the model reads them."""
        raise NotImplementedError

    def shape(self) -> dict[str, Any] | None:
        """Return fields of the LightShape, other than `kind` and `light`; None for a light that has none."""
        return {}

    def extent(self) -> LightExtent:
        """Return the position, orientation and power."""
        raise NotImplementedError

    @property
    def shines(self) -> bool:
        """Whether it gives any light."""
        return bool(np.any(self.extent().amount))

    def _set_amount(self, factors: dict[str, float], default: float | None = None) -> None:
        """Fill the first of several attributes from whichever is set, times its factor, or else with a default.

        That one stays set as well, so `dataclasses.replace` may pass both; they then agree.
        """
        if default is not None and all(getattr(self, name) is None for name in factors):
            self._set(**{next(iter(factors)): default})
        colors = {name: color(getattr(self, name), name) for name in factors if getattr(self, name) is not None}
        amounts = [tuple(x * factors[name] for x in value) for name, value in colors.items()]
        agree = all(math.isclose(a, b, rel_tol=1e-9) for each in amounts for a, b in zip(amounts[0], each, strict=True))
        if not colors or not agree:
            *names, last = factors
            either, link = ("either", "or") if len(names) == 1 else ("one of", "and")
            raise InputError(f"a {self.type_name} light takes {either} {', '.join(names)} {link} {last}")
        self._set(**{**colors, next(iter(factors)): amounts[0]})


def unit_vector(value: Any, name: str) -> Vec3:
    """Return a vector normalised to length 1, or raise InputError naming `name`."""
    x, y, z = vector(value, name)
    length = math.hypot(x, y, z)
    if length == 0.0:
        raise InputError(f"{name} must not be zero")
    if abs(length - 1.0) < 1e-15:
        return x, y, z  # not divided again, so a light read back from a file is the same to the bit
    return x / length, y / length, z / length


Direction = Annotated[Vec3, unit_vector]


def axes_of(direction: Vec3, up: Vec3) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return unit vectors across a direction: to the right seen along it, and upwards.

    Raises:
        InputError: when `up` lies along the direction.
    """
    right = np.cross(direction, up)
    length = norm(right)
    if length < 1e-6:
        raise InputError("up must not be along the direction of the light")
    right /= length
    return right, np.cross(right, direction)


def light_texture(texture: Any, name: str) -> ImageTexture:
    """Return a light's image, or raise InputError if it is not an image or needs a surface."""
    if not isinstance(texture, ImageTexture):
        raise InputError(f"the {name} of a light must be an image")
    if texture.vertex_colors or texture.vertex_alpha or texture.uv_set:
        raise InputError(f"the {name} of a light has no vertices, so no colours or second coordinates of them")
    return texture


LightTexture = Annotated[ImageTexture | None, optional(light_texture)]


def mean_of(texture: ImageTexture | None) -> NDArray[np.float64]:
    """Return the mean colour of a light's texture, 1 without one."""
    if texture is None:
        return np.ones(3)
    pixels = texture.pixels
    if texture.channel is not None:
        pixels = pixels[..., [CHANNELS.index(texture.channel)]]
    return np.asarray(pixels.mean(axis=(0, 1), dtype=np.float64) * texture.factor)
