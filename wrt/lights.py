"""Lights without a surface. Emissive surfaces are shapes with an `emission` (see Scene.add)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from wrt.errors import InputError
from wrt.values import ColorLike, Vec3, color, vector


@dataclass(frozen=True)
class PointLight:
    """An isotropic point source: irradiance I cosθ / r² at distance r.

    Give `intensity`, or `power` Φ, which stands for the intensity Φ / 4π.

    Attributes:
        position: where it is, metres.
        intensity: radiant intensity per channel, W·sr⁻¹.
        power: total radiant power per channel, W.
    """

    position: Vec3
    intensity: ColorLike | None = None
    power: ColorLike | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", vector(self.position, "position"))
        if (self.intensity is None) == (self.power is None):
            raise InputError("a point light takes either intensity or power")
        if self.power is not None:
            power = color(self.power, "power")
            object.__setattr__(self, "power", power)
            object.__setattr__(self, "intensity", tuple(p / (4.0 * math.pi) for p in power))
        else:
            object.__setattr__(self, "intensity", color(self.intensity, "intensity"))


@dataclass(frozen=True)
class DirectionalLight:
    """Parallel light from infinitely far away.

    Attributes:
        direction: the way the light travels; any length but zero.
        irradiance: on a surface that faces the light, per channel, W·m⁻².
    """

    direction: Vec3
    irradiance: ColorLike = 1.0

    def __post_init__(self) -> None:
        x, y, z = vector(self.direction, "direction")
        length = math.sqrt(x * x + y * y + z * z)
        if length == 0.0:
            raise InputError("direction must not be zero")
        object.__setattr__(self, "direction", (x / length, y / length, z / length))
        object.__setattr__(self, "irradiance", color(self.irradiance, "irradiance"))
