"""Lights without a mesh. Emissive meshes are shapes with an `emission` (see Scene.add).

**Punctual colour.** Real-time shading models give a point, spot or directional light a colour c and write
L = π f c (n·l) (Hoffman, "Background: Physics and Math of Shading", SIGGRAPH 2013). A white Lambertian surface
(f = 1/π) that faces the light then has the radiance c and receives the irradiance π c. `color` has this meaning; for
a point or a spot it holds at a distance of one metre, so the intensity is π c.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from wrt.errors import InputError
from wrt.scene.registration import register_class
from wrt.values import ColorLike, Vec3, boolean, color, number, one_of, vector

if TYPE_CHECKING:
    from wrt.kernels.lights.record import LightModel

FALLOFFS = ("smooth", "linear", "gltf")
"""Falloffs of a spot light, in the order of their numbers in `kernels/lights/spot.py`."""

_UP = (0.0, 1.0, 0.0)
"""The axis of lights that shine in every direction."""


class LightExtent(NamedTuple):
    """Position, orientation and power of a light, for light selection.

    Attributes:
        corners: (K, 3) points whose convex hull contains the light; None for a light infinitely far away.
        axis: unit vector, the centre of the light's normals; for a distant light, the direction its light travels.
        amount: radiance, intensity or irradiance, per channel.
        power_over_amount: power / amount; for a distant light, irradiance / amount.
        cos_spread: cosine of the greatest angle between the axis and a normal; −1 for lights that shine everywhere.
        cos_falloff: cosine of the angle to the normal beyond which nothing is emitted; 0 for surfaces.
        two_sided: whether it also shines against its axis.
    """

    corners: Any
    axis: Any
    amount: Any
    power_over_amount: float = 1.0
    cos_spread: float = 1.0
    cos_falloff: float = 0.0
    two_sided: bool = False


@dataclass(frozen=True)
class Light:
    """Base of all lights without a mesh; not used by itself.

    A light is a plain description. `model` names its device functions in `kernels/lights/`; `record`, `shape` and
    `extent` return what they read.
    """

    type_name: ClassVar[str] = ""
    """The light's `type` in scene files."""

    @property
    def model(self) -> str:
        """Name of the model in kernels, by default the light's own."""
        return self.type_name.replace("-", "_")

    def record(self) -> dict[str, Any]:
        """Return fields of the LightRecord: `value`, and `place` and `two_sided` where the model reads them."""
        raise NotImplementedError

    def shape(self) -> dict[str, Any] | None:
        """Return fields of the LightShape, other than `kind` and `light`; None for a light that has none."""
        return {}

    def extent(self) -> LightExtent:
        """Return the position, orientation and power."""
        raise NotImplementedError

    def _set(self, **values: Any) -> None:
        """Replace attributes by their checked values during construction."""
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def _set_amount(self, factors: dict[str, float]) -> None:
        """Fill the first of several attributes from the one that was given, times its factor.

        The given one stays as well, so `dataclasses.replace` may pass both; they then agree.
        """
        given = {name: color(getattr(self, name), name) for name in factors if getattr(self, name) is not None}
        amounts = [tuple(x * factors[name] for x in value) for name, value in given.items()]
        agree = all(math.isclose(a, b, rel_tol=1e-9) for each in amounts for a, b in zip(amounts[0], each, strict=True))
        if not given or not agree:
            *names, last = factors
            either, link = ("either", "or") if len(names) == 1 else ("one of", "and")
            raise InputError(f"a {self.type_name} light takes {either} {', '.join(names)} {link} {last}")
        self._set(**{**given, next(iter(factors)): amounts[0]})


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
        return LightExtent([self.position], _UP, self.intensity, 4.0 * math.pi, cos_spread=-1.0)


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
    """

    position: Vec3
    direction: Vec3
    intensity: ColorLike | None = None
    power: ColorLike | None = None
    color: ColorLike | None = None
    inner_degrees: float = 20.0
    outer_degrees: float = 30.0
    falloff: str = "smooth"

    type_name: ClassVar[str] = "spot"

    def __post_init__(self) -> None:
        outer = number(self.outer_degrees, "outer_degrees", above=0.0, maximum=180.0)
        inner = number(self.inner_degrees, "inner_degrees", minimum=0.0, maximum=outer)
        one_of(self.falloff, FALLOFFS, "falloff")
        self._set(position=vector(self.position, "position"), direction=unit_vector(self.direction, "direction"))
        self._set(inner_degrees=inner, outer_degrees=outer)
        self._set_amount({"intensity": 1.0, "power": 1.0 / self.power_over_intensity, "color": math.pi})

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
        return {"normal": self.direction, "size": cosines, "falloff": FALLOFFS.index(self.falloff)}

    def extent(self) -> LightExtent:
        """Return the extent of a point on a surface that faces along the axis and shines up to the outer cone."""
        falloff = math.cos(math.radians(self.outer_degrees))
        power = self.power_over_intensity
        return LightExtent([self.position], self.direction, self.intensity, power, cos_falloff=falloff)


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

    def __post_init__(self) -> None:
        if self.irradiance is None and self.color is None:
            self._set(irradiance=1.0)
        angle = number(self.angle_degrees, "angle_degrees", minimum=0.0, maximum=180.0)
        if 0.0 < angle < 1e-3:
            raise InputError(f"angle_degrees must be 0 or at least 0.001, not {angle:g}")
        self._set(direction=unit_vector(self.direction, "direction"), angle_degrees=angle)
        self._set_amount({"irradiance": 1.0, "color": math.pi})

    @property
    def model(self) -> str:
        """Name of the model in kernels."""
        return "sun" if self.angle_degrees > 0.0 else "directional"

    def record(self) -> dict[str, Any]:
        """Return fields of the LightRecord."""
        if self.angle_degrees == 0.0:
            return {"place": np.negative(self.direction), "value": self.irradiance}
        sine = math.sin(math.radians(0.5 * self.angle_degrees))
        return {"place": np.negative(self.direction), "value": np.asarray(self.irradiance) / (math.pi * sine * sine)}

    def shape(self) -> dict[str, Any] | None:
        """Return fields of the LightShape; None for parallel light."""
        if self.angle_degrees == 0.0:
            return None
        half = math.radians(0.5 * self.angle_degrees)
        size = (2.0 * math.sin(0.5 * half) ** 2, math.sin(half) ** 2)
        return {"normal": np.negative(self.direction), "size": size}

    def extent(self) -> LightExtent:
        """Return the direction and irradiance."""
        return LightExtent(None, self.direction, self.irradiance)


@dataclass(frozen=True)
class _AreaLight(Light):
    """Base of shapes that emit the same radiance in every direction, and have `radiance`, `power` and maybe a back."""

    def _set_radiance(self, area: float) -> None:
        """Fill `radiance` from the radiance or power that was given, for one side's area in m²."""
        area *= 2.0 if getattr(self, "two_sided", False) else 1.0
        self._set_amount({"radiance": 1.0, "power": 1.0 / (math.pi * area)})

    def record(self) -> dict[str, Any]:
        """Return fields of the LightRecord."""
        return {"value": self.radiance, "two_sided": getattr(self, "two_sided", False)}  # type: ignore[attr-defined]


@dataclass(frozen=True)
class RectangleLight(_AreaLight):
    """A rectangle that emits the same radiance in every direction from its front, towards edge_u × edge_v.

    It is an exact shape, not a mesh; it is sampled by solid angle and reflects nothing. Give one of `radiance` and
    `power`; Φ = π L A, or twice that with two sides.

    Attributes:
        origin: a corner, metres.
        edge_u, edge_v: its sides, perpendicular, metres.
        radiance: per channel, W·sr⁻¹·m⁻².
        power: total radiant power per channel, W.
        two_sided: whether its back emits too.
    """

    origin: Vec3
    edge_u: Vec3
    edge_v: Vec3
    radiance: ColorLike | None = None
    power: ColorLike | None = None
    two_sided: bool = False

    type_name: ClassVar[str] = "rectangle"

    def __post_init__(self) -> None:
        u, v = vector(self.edge_u, "edge_u"), vector(self.edge_v, "edge_v")
        self._set(origin=vector(self.origin, "origin"), edge_u=u, edge_v=v)
        lengths = math.hypot(*u), math.hypot(*v)
        if min(lengths) == 0.0:
            raise InputError("edge_u and edge_v must not be zero")
        if abs(sum(a * b for a, b in zip(u, v, strict=True))) > 1e-5 * lengths[0] * lengths[1]:
            raise InputError("edge_u and edge_v must be perpendicular; for another parallelogram add a quad that emits")
        boolean(self.two_sided, "two_sided")
        self._set_radiance(lengths[0] * lengths[1])

    def shape(self) -> dict[str, Any]:
        """Return fields of the LightShape."""
        size = np.linalg.norm([self.edge_u, self.edge_v], axis=1)
        x, y = np.array(self.edge_u) / size[0], np.array(self.edge_v) / size[1]
        y = y - x * np.dot(x, y)
        y /= np.linalg.norm(y)
        return {"place": self.origin, "x": x, "y": y, "normal": np.cross(x, y), "size": size}

    def extent(self) -> LightExtent:
        """Return the position, orientation and power."""
        o, u, v = np.array(self.origin), np.array(self.edge_u), np.array(self.edge_v)
        normal = np.cross(u, v)
        area = float(np.linalg.norm(normal))
        factor = (2.0 if self.two_sided else 1.0) * math.pi * area
        return LightExtent([o, o + u, o + v, o + u + v], normal / area, self.radiance, factor, two_sided=self.two_sided)


@dataclass(frozen=True)
class DiskLight(_AreaLight):
    """A disk that emits the same radiance in every direction from its front, towards its normal.

    It is an exact shape, not a mesh; it is sampled by solid angle and reflects nothing. Give one of `radiance` and
    `power`; Φ = π L A, or twice that with two sides.

    Attributes:
        center: metres.
        normal: direction that its front faces; any length but zero.
        radius: metres.
        radiance: per channel, W·sr⁻¹·m⁻².
        power: total radiant power per channel, W.
        two_sided: whether its back emits too.
    """

    center: Vec3
    normal: Vec3
    radius: float = 0.5
    radiance: ColorLike | None = None
    power: ColorLike | None = None
    two_sided: bool = False

    type_name: ClassVar[str] = "disk"

    def __post_init__(self) -> None:
        self._set(center=vector(self.center, "center"), normal=unit_vector(self.normal, "normal"))
        self._set(radius=number(self.radius, "radius", above=0.0))
        boolean(self.two_sided, "two_sided")
        self._set_radiance(math.pi * self.radius**2)

    def shape(self) -> dict[str, Any]:
        """Return fields of the LightShape."""
        return {"place": self.center, "normal": self.normal, "size": (self.radius,) * 2}

    def extent(self) -> LightExtent:
        """Return the position, orientation and power."""
        normal, area = np.array(self.normal), math.pi * self.radius**2
        reach = self.radius * np.sqrt(np.maximum(1.0 - normal**2, 0.0))
        corners = [np.array(self.center) - reach, np.array(self.center) + reach]
        factor = (2.0 if self.two_sided else 1.0) * math.pi * area
        return LightExtent(corners, normal, self.radiance, factor, two_sided=self.two_sided)


@dataclass(frozen=True)
class SphereLight(_AreaLight):
    """A sphere that emits the same radiance in every direction, outwards.

    It is an exact shape, not a mesh; it is sampled by solid angle, reflects nothing and is black inside. Give one of
    `radiance` and `power`; Φ = 4π² r² L.

    Attributes:
        center: metres.
        radius: metres.
        radiance: per channel, W·sr⁻¹·m⁻².
        power: total radiant power per channel, W.
    """

    center: Vec3
    radius: float = 0.5
    radiance: ColorLike | None = None
    power: ColorLike | None = None

    type_name: ClassVar[str] = "sphere"

    def __post_init__(self) -> None:
        self._set(center=vector(self.center, "center"), radius=number(self.radius, "radius", above=0.0))
        self._set_radiance(4.0 * math.pi * self.radius**2)

    def shape(self) -> dict[str, Any]:
        """Return fields of the LightShape."""
        return {"place": self.center, "size": (self.radius,) * 2}

    def extent(self) -> LightExtent:
        """Return the position and power."""
        corners = [np.array(self.center) - self.radius, np.array(self.center) + self.radius]
        return LightExtent(corners, _UP, self.radiance, 4.0 * math.pi**2 * self.radius**2, cos_spread=-1.0)


def unit_vector(value: Any, name: str) -> Vec3:
    """Return a vector normalised to length 1, or raise InputError naming `name`."""
    x, y, z = vector(value, name)
    length = math.hypot(x, y, z)
    if length == 0.0:
        raise InputError(f"{name} must not be zero")
    if abs(length - 1.0) < 1e-15:
        return x, y, z  # not divided again, so a light read back from a file is the same to the bit
    return x / length, y / length, z / length


LIGHTS: dict[str, type[Light]] = {
    cls.type_name: cls for cls in (PointLight, SpotLight, DirectionalLight, RectangleLight, DiskLight, SphereLight)
}
"""Lights by their `type` in scene files."""


def register_light(cls: type[Light], model: LightModel) -> None:
    """Make a custom light known to scenes and scene files.

    A class of the same name from the same module replaces the one registered before, as when a notebook cell runs
    again. Existing renderers are not affected.

    Args:
        cls: the description, with a `type_name`.
        model: its device functions.

    Raises:
        InputError: if `type_name` is empty or taken by another light, or the model lacks a function.
    """
    from wrt.kernels.lights.shapes import LIGHT_SHAPES

    register_class(LIGHTS, cls, lambda name, owner: LIGHT_SHAPES.register(name, model, owner))
