"""A light that projects an image."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from wrt.scene.lights.light import Light, LightExtent, axes_of, checked_texture, mean_of, unit_vector
from wrt.scene.textures import ImageTexture
from wrt.values import ColorLike, Vec3, number, vector


@dataclass(frozen=True)
class ProjectorLight(Light):
    """A pinhole that throws an image, like a slide projector without a lens: sharp at every distance.

    A plane across its axis at one metre has the irradiance E times the colour of the image. So the intensity at the
    angle θ to the axis is E / cos³θ times the colour, and the irradiance of the plane at z metres is E / z².

    Seen from behind the projector, the image is upright and not mirrored. The texture coordinates (0, 0) and (1, 1) are
    the lower left and the upper right corner of the frame, so that the texture can repeat.

    Give one of `irradiance` and `color`, or neither for an irradiance of 1.

    Attributes:
        position: metres.
        direction: direction of its axis; any length but zero.
        up: direction of the image's upper edge, seen from its middle; not along the axis.
        texture: the image; without one the frame is a square of one colour.
        irradiance: of a plane across the axis at one metre where the image is white, per channel, W·m⁻².
        color: radiance of a white Lambertian surface in its place: irradiance / π, W·sr⁻¹·m⁻². Mitsuba's `projector`
            calls this irradiance.
        fov_degrees: angle between the left and right edge of the frame. Its height follows from the image, whose
            pixels are square.
    """

    position: Vec3
    direction: Vec3
    up: Vec3 = (0.0, 1.0, 0.0)
    texture: ImageTexture | None = None
    irradiance: ColorLike | None = None
    color: ColorLike | None = None
    fov_degrees: float = 40.0

    type_name: ClassVar[str] = "projector"

    def __post_init__(self) -> None:
        angle = number(self.fov_degrees, "fov_degrees", above=0.0, maximum=179.0)
        self._set(position=vector(self.position, "position"), direction=unit_vector(self.direction, "direction"))
        self._set(up=unit_vector(self.up, "up"), fov_degrees=angle)
        axes_of(self.direction, self.up)
        checked_texture(self.texture, "projector")
        if self.irradiance is None and self.color is None:
            self._set(irradiance=1.0)
        self._set_amount({"irradiance": 1.0, "color": math.pi})

    @property
    def half_sizes(self) -> tuple[float, float]:
        """Half the width and height of the frame at one metre, metres."""
        half = math.tan(math.radians(0.5 * self.fov_degrees))
        if self.texture is None:
            return half, half
        height, width = self.texture.pixels.shape[:2]
        return half, half * height / width

    def record(self) -> dict[str, Any]:
        """Return fields of the LightRecord."""
        return {"place": self.position, "value": self.irradiance}

    def shape(self) -> dict[str, Any]:
        """Return fields of the LightShape."""
        x, y = axes_of(self.direction, self.up)
        return {"normal": self.direction, "x": x, "y": y, "size": self.half_sizes}

    def extent(self) -> LightExtent:
        """Return the extent of a point on a surface that faces along the axis and shines up to the frame's corners."""
        width, height = self.half_sizes
        amount = np.asarray(self.irradiance) * mean_of(self.texture)
        falloff = 1.0 / math.sqrt(1.0 + width * width + height * height)
        return LightExtent([self.position], self.direction, amount, 4.0 * width * height, cos_falloff=falloff)
