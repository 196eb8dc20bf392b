"""Light from infinitely far away."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np

from wrt.errors import InputError
from wrt.scene.description import Checks
from wrt.scene.lights.light import Light, LightExtent, unit_vector
from wrt.values import ColorLike, Vec3, number


@dataclass(frozen=True)
class DirectionalLight(Light):
    """Light from infinitely far away: parallel, or from a round disk such as the sun's.

    The disk's radiance is L = E / (π sin²(α/2)) for the angular diameter α, so a surface that faces its centre has
    the irradiance E. The camera and mirrors see the disk.

    Give one of `irradiance` and `color`, or neither for an irradiance of 1.

    Attributes:
        direction: direction in which the light travels; any length but zero.
        irradiance: on a surface that faces the light, per channel, W·m⁻².
        color: radiance of a white Lambertian surface that faces the light: irradiance / π, W·sr⁻¹·m⁻².
        angle_degrees: angular diameter, 0 for parallel light; 0.53 for the sun.
    """

    direction: Vec3
    irradiance: ColorLike | None = None
    color: ColorLike | None = None
    angle_degrees: float = 0.0

    type_name: ClassVar[str] = "directional"
    checks: ClassVar[Checks] = {"direction": unit_vector, "angle_degrees": partial(number, minimum=0.0, maximum=180.0)}

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.irradiance is None and self.color is None:
            self._set(irradiance=1.0)
        if 0.0 < self.angle_degrees < 1e-3:
            raise InputError(f"angle_degrees must be 0 or at least 0.001, not {self.angle_degrees:g}")
        self._set_amount({"irradiance": 1.0, "color": math.pi})

    @property
    def model(self) -> str:
        return "sun" if self.angle_degrees > 0.0 else "directional"

    def record(self) -> dict[str, Any]:
        if self.angle_degrees == 0.0:
            return {"place": np.negative(self.direction), "value": self.irradiance}
        sine = math.sin(math.radians(0.5 * self.angle_degrees))
        return {"place": np.negative(self.direction), "value": np.asarray(self.irradiance) / (math.pi * sine * sine)}

    def shape(self) -> dict[str, Any] | None:
        if self.angle_degrees == 0.0:
            return None
        half = math.radians(0.5 * self.angle_degrees)
        size = (2.0 * math.sin(0.5 * half) ** 2, math.sin(half) ** 2)
        return {"normal": np.negative(self.direction), "size": size}

    def extent(self) -> LightExtent:
        return LightExtent(None, self.direction, self.irradiance)
