"""Lights from a point, or from so far away that their rays are parallel."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, ClassVar

import numpy as np

from wrt.errors import InputError
from wrt.scene.description import Vector, word_of
from wrt.scene.lights.light import EVERYWHERE, Direction, Light, LightExtent, LightTexture, axes_of, mean_of
from wrt.values import ColorLike, number

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

    position: Vector
    intensity: ColorLike | None = None
    power: ColorLike | None = None
    color: ColorLike | None = None

    type_name: ClassVar[str] = "point"

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set_amount({"intensity": 1.0, "power": 0.25 / math.pi, "color": math.pi})

    def record(self) -> dict[str, Any]:
        return {"place": self.position, "value": self.intensity}

    def shape(self) -> None:
        return

    def extent(self) -> LightExtent:
        return LightExtent([self.position], EVERYWHERE, self.intensity, 4.0 * math.pi, cos_spread=-1.0)


@dataclass(frozen=True)
class SpotLight(Light):
    """A point source that emits in a cone: intensity I f(θ) at the angle θ to its axis.

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
        texture: image that multiplies the intensity, upright from behind the lamp. It fills the square around the outer
            cone, which is then narrower than 90 degrees; `power` is that without it.
        up: direction of the texture's upper edge, seen from its middle; not along the axis.
    """

    position: Vector
    direction: Direction
    intensity: ColorLike | None = None
    power: ColorLike | None = None
    color: ColorLike | None = None
    inner_degrees: float = 20.0
    outer_degrees: Annotated[float, partial(number, above=0.0, maximum=180.0)] = 30.0
    falloff: Annotated[str, word_of(FALLOFFS)] = "smooth"
    texture: LightTexture = None
    up: Direction = (0.0, 1.0, 0.0)

    type_name: ClassVar[str] = "spot"

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set(inner_degrees=number(self.inner_degrees, "inner_degrees", minimum=0.0, maximum=self.outer_degrees))
        if self.texture is not None:
            axes_of(self.direction, self.up)
            if self.outer_degrees > 89.0:
                raise InputError("outer_degrees must be 89 at most for a spot light with a texture")
        self._set_amount({"intensity": 1.0, "power": 1.0 / self.power_over_intensity, "color": math.pi})

    @property
    def model(self) -> str:
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
        return {"place": self.position, "value": self.intensity}

    def shape(self) -> dict[str, Any]:
        cosines = [math.cos(math.radians(angle)) for angle in (self.inner_degrees, self.outer_degrees)]
        fields = {"normal": self.direction, "size": cosines, "falloff": FALLOFFS.index(self.falloff)}
        if self.texture is not None:
            fields["x"], fields["y"] = axes_of(self.direction, self.up)
        return fields

    def extent(self) -> LightExtent:
        # A point on a surface that faces along the axis and emits up to the outer cone.
        falloff = math.cos(math.radians(self.outer_degrees))
        power = self.power_over_intensity
        amount = np.asarray(self.intensity) * mean_of(self.texture)
        return LightExtent([self.position], self.direction, amount, power, cos_falloff=falloff)


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
        color: radiance of a white Lambertian surface there: irradiance / π, W·sr⁻¹·m⁻².
        fov_degrees: angle between the left and right edge of the frame, whose height follows from the image.
    """

    position: Vector
    direction: Direction
    up: Direction = (0.0, 1.0, 0.0)
    texture: LightTexture = None
    irradiance: ColorLike | None = None
    color: ColorLike | None = None
    fov_degrees: Annotated[float, partial(number, above=0.0, maximum=179.0)] = 40.0

    type_name: ClassVar[str] = "projector"

    def __post_init__(self) -> None:
        super().__post_init__()
        axes_of(self.direction, self.up)
        self._set_amount({"irradiance": 1.0, "color": math.pi}, default=1.0)

    @property
    def half_sizes(self) -> tuple[float, float]:
        """Half the width and height of the frame at one metre, metres."""
        half = math.tan(math.radians(0.5 * self.fov_degrees))
        if self.texture is None:
            return half, half
        height, width = self.texture.pixels.shape[:2]
        return half, half * height / width

    def record(self) -> dict[str, Any]:
        return {"place": self.position, "value": self.irradiance}

    def shape(self) -> dict[str, Any]:
        x, y = axes_of(self.direction, self.up)
        return {"normal": self.direction, "x": x, "y": y, "size": self.half_sizes}

    def extent(self) -> LightExtent:
        # A point on a surface that faces along the axis and emits up to the frame's corners.
        width, height = self.half_sizes
        amount = np.asarray(self.irradiance) * mean_of(self.texture)
        falloff = 1.0 / math.sqrt(1.0 + width * width + height * height)
        return LightExtent([self.position], self.direction, amount, 4.0 * width * height, cos_falloff=falloff)


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

    direction: Direction
    irradiance: ColorLike | None = None
    color: ColorLike | None = None
    angle_degrees: Annotated[float, partial(number, minimum=0.0, maximum=180.0)] = 0.0

    type_name: ClassVar[str] = "directional"

    def __post_init__(self) -> None:
        super().__post_init__()
        if 0.0 < self.angle_degrees < 1e-3:
            raise InputError(f"angle_degrees must be 0 or at least 0.001, not {self.angle_degrees:g}")
        self._set_amount({"irradiance": 1.0, "color": math.pi}, default=1.0)

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
