"""Lights that shine from a point."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from wrt.errors import InputError
from wrt.scene.lights.light import (
    EVERYWHERE,
    Light,
    LightExtent,
    axes_of,
    checked_texture,
    mean_of,
    unit_vector,
)
from wrt.scene.textures import ImageTexture
from wrt.values import ColorLike, Vec3, number, one_of, vector

FALLOFFS = ("smooth", "linear", "gltf")
"""Falloffs of a spot light, in the order of their numbers in `kernels/lights/spot.py`."""


@dataclass(frozen=True)
class PointLight(Light):
    """An isotropic point source: irradiance I cosθ / r² at distance r.

    Give one of `intensity`, `power` and `color`. A power Φ is an intensity of Φ / 4π, a punctual colour c one of π c.

    Attributes:
        position: metres.
        intensity: radiant intensity per channel, W·sr⁻¹.
        power: total radiant power per channel, W.
        color: radiance of a white Lambertian surface that faces the light at one metre, W·sr⁻¹·m⁻².
    """

    position: Vec3
    intensity: ColorLike | None = None
    power: ColorLike | None = None
    color: ColorLike | None = None

    type_name: ClassVar[str] = "point"

    def __post_init__(self) -> None:
        self._set(position=vector(self.position, "position"))
        self._set_amount({"intensity": 1.0, "power": 0.25 / math.pi, "color": math.pi})

    def record(self) -> dict[str, Any]:
        """Return fields of the LightRecord."""
        return {"place": self.position, "value": self.intensity}

    def shape(self) -> None:
        """Return None: a point has no shape."""
        return

    def extent(self) -> LightExtent:
        """Return the position and power."""
        return LightExtent([self.position], EVERYWHERE, self.intensity, 4.0 * math.pi, cos_spread=-1.0)


@dataclass(frozen=True)
class SpotLight(Light):
    """A point source that shines in a cone: intensity I f(θ) at the angle θ to its axis.

    f is 1 within the inner cone and 0 outside the outer one. With x = (cos θ − cos θo) / (cos θi − cos θo), f between
    them is

    - "smooth": x² (3 − 2x), as in pbrt-v4 (Pharr, Jakob and Humphreys 2023, section 12.2.1);
    - "linear": (θo − θ) / (θo − θi), as in Mitsuba's `spot`, where θi is `beam_width` and θo `cutoff_angle`;
    - "gltf": x², as recommended in KHR_lights_punctual, where the angles are innerConeAngle and outerConeAngle.

    Its power is 2π I (1 − cos θi + F). F is the integral of f over the cosine between the cones: half of
    d = cos θi − cos θo, or cos θi − (sin θo − sin θi) / (θo − θi), or d / 3.

    Give one of `intensity`, `power` and `color`.

    Attributes:
        position: metres.
        direction: direction of its axis; any length but zero.
        intensity: radiant intensity along the axis, per channel, W·sr⁻¹.
        power: total radiant power per channel, W.
        color: radiance of a white Lambertian surface that faces the light on its axis at one metre, W·sr⁻¹·m⁻².
        inner_degrees: angle from the axis up to which it has its full intensity.
        outer_degrees: angle from the axis beyond which it is dark.
        falloff: how it fades between the two: "smooth", "linear" or "gltf".
        texture: image that multiplies the intensity, as of a slide before the lamp. It fills the square around the
            outer cone, which is then narrower than 90 degrees; seen from behind the lamp it is upright. `power` is that
            without the texture.
        up: direction of the texture's upper edge, seen from its middle; not along the axis.
    """

    position: Vec3
    direction: Vec3
    intensity: ColorLike | None = None
    power: ColorLike | None = None
    color: ColorLike | None = None
    inner_degrees: float = 20.0
    outer_degrees: float = 30.0
    falloff: str = "smooth"
    texture: ImageTexture | None = None
    up: Vec3 = (0.0, 1.0, 0.0)

    type_name: ClassVar[str] = "spot"

    def __post_init__(self) -> None:
        outer = number(self.outer_degrees, "outer_degrees", above=0.0, maximum=180.0)
        inner = number(self.inner_degrees, "inner_degrees", minimum=0.0, maximum=outer)
        one_of(self.falloff, FALLOFFS, "falloff")
        self._set(position=vector(self.position, "position"), direction=unit_vector(self.direction, "direction"))
        self._set(inner_degrees=inner, outer_degrees=outer, up=unit_vector(self.up, "up"))
        checked_texture(self.texture, "spot")
        if self.texture is not None:
            axes_of(self.direction, self.up)
            if outer > 89.0:
                raise InputError("outer_degrees must be 89 at most for a spot light with a texture")
        self._set_amount({"intensity": 1.0, "power": 1.0 / self.power_over_intensity, "color": math.pi})

    @property
    def model(self) -> str:
        """Name of the model in kernels."""
        return "spot" if self.texture is None else "projector:spot"

    @property
    def power_over_intensity(self) -> float:
        """Power / intensity, sr: the solid angle of a cone of uniform intensity with the same power."""
        inner, outer = math.radians(self.inner_degrees), math.radians(self.outer_degrees)
        between = math.cos(inner) - math.cos(outer)
        if self.falloff == "smooth":
            fading = 0.5 * between
        elif self.falloff == "gltf":
            fading = between / 3.0
        elif outer == inner:
            fading = 0.0
        else:
            fading = math.cos(inner) - (math.sin(outer) - math.sin(inner)) / (outer - inner)
        return 2.0 * math.pi * (2.0 * math.sin(0.5 * inner) ** 2 + fading)

    def record(self) -> dict[str, Any]:
        """Return fields of the LightRecord."""
        return {"place": self.position, "value": self.intensity}

    def shape(self) -> dict[str, Any]:
        """Return fields of the LightShape."""
        cosines = [math.cos(math.radians(angle)) for angle in (self.inner_degrees, self.outer_degrees)]
        fields = {"normal": self.direction, "size": cosines, "falloff": FALLOFFS.index(self.falloff)}
        if self.texture is not None:
            fields["x"], fields["y"] = axes_of(self.direction, self.up)
        return fields

    def extent(self) -> LightExtent:
        """Return the extent of a point on a surface that faces along the axis and shines up to the outer cone."""
        falloff = math.cos(math.radians(self.outer_degrees))
        power = self.power_over_intensity
        amount = np.asarray(self.intensity) * mean_of(self.texture)
        return LightExtent([self.position], self.direction, amount, power, cos_falloff=falloff)
