"""Lights that are no meshes. Emissive meshes are shapes with an `emission` (see Scene.add).

**Punctual colour.** Shading models of real-time rendering give a point, spot or directional light a colour c and write
L = π f c (n·l) (Hoffman, "Background: Physics and Math of Shading", SIGGRAPH 2013): a white Lambertian surface, whose
f is 1/π, shows c where it faces the light. The irradiance there hence is π c. Each of the three takes `color` in that
sense; for a point or a spot it holds at a distance of one metre, so that the intensity is π c.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, TypeAlias

from wrt.errors import InputError
from wrt.values import ColorLike, Vec3, boolean, color, number, vector

FALLOFFS = ("smooth", "linear", "gltf")
"""How a spot light fades, by name, in the order of the numbers in `kernels/scene_data.py`."""


@dataclass(frozen=True)
class PointLight:
    """An isotropic point source: irradiance I cosθ / r² at distance r.

    Give one of `intensity`, `power` and `color`: the power Φ stands for the intensity Φ / 4π, the punctual colour c for
    π c.

    Attributes:
        position: where it is, metres.
        intensity: radiant intensity per channel, W·sr⁻¹.
        power: total radiant power per channel, W.
        color: what a white Lambertian surface that faces it shows at one metre, W·sr⁻¹·m⁻².
    """

    position: Vec3
    intensity: ColorLike | None = None
    power: ColorLike | None = None
    color: ColorLike | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", vector(self.position, "position"))
        factors = {"intensity": 1.0, "power": 0.25 / math.pi, "color": math.pi}
        _set_amount(self, "a point light", factors)


@dataclass(frozen=True)
class SpotLight:
    """A point source that shines in a cone: intensity I f(θ) at the angle θ to its axis.

    f is 1 within the inner cone, 0 outside the outer, and between them, with x = (cos θ − cos θo) / (cos θi − cos θo),

    - "smooth": x² (3 − 2x), as in pbrt-v4 (Pharr, Jakob and Humphreys 2023, section 12.2.1);
    - "linear": (θo − θ) / (θo − θi), as Mitsuba's `spot` has it, where θi is `beam_width` and θo `cutoff_angle`;
    - "gltf": x², as recommended in KHR_lights_punctual, where the angles are innerConeAngle and outerConeAngle.

    Its power is 2π I (1 − cos θi + F), where F, the integral of f over the cosine between the cones, is half of
    d = cos θi − cos θo, or cos θi − (sin θo − sin θi) / (θo − θi), or d / 3.

    Give one of `intensity`, `power` and `color`.

    Attributes:
        position: where it is, metres.
        direction: where its axis points; any length but zero.
        intensity: radiant intensity along the axis, per channel, W·sr⁻¹.
        power: total radiant power per channel, W.
        color: what a white Lambertian surface that faces it shows on the axis at one metre, W·sr⁻¹·m⁻².
        inner_degrees: angle from the axis up to which it has its full intensity.
        outer_degrees: angle from the axis beyond which it is dark.
        falloff: how it fades between the two.
    """

    position: Vec3
    direction: Vec3
    intensity: ColorLike | None = None
    power: ColorLike | None = None
    color: ColorLike | None = None
    inner_degrees: float = 20.0
    outer_degrees: float = 30.0
    falloff: str = "smooth"

    def __post_init__(self) -> None:
        outer = number(self.outer_degrees, "outer_degrees", above=0.0, maximum=180.0)
        inner = number(self.inner_degrees, "inner_degrees", minimum=0.0, maximum=outer)
        if self.falloff not in FALLOFFS:
            raise InputError(f"falloff must be one of {', '.join(FALLOFFS)}, not {self.falloff!r}")
        _set(self, inner_degrees=inner, outer_degrees=outer)
        _set(self, position=vector(self.position, "position"), direction=_unit(self.direction, "direction"))
        factors = {"intensity": 1.0, "power": 1.0 / self.power_over_intensity, "color": math.pi}
        _set_amount(self, "a spot light", factors)

    @property
    def power_over_intensity(self) -> float:
        """The solid angle that would have the same power at full intensity."""
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


@dataclass(frozen=True)
class DirectionalLight:
    """Light from infinitely far away: parallel, or from a round disk such as the sun's.

    The disk's radiance is L = E / (π sin²(α/2)) for the angular diameter α, so that a surface that faces its middle has
    the irradiance E. It is seen by the camera and in mirrors.

    Give one of `irradiance` and `color`, or neither for an irradiance of 1.

    Attributes:
        direction: the way the light travels; any length but zero.
        irradiance: on a surface that faces the light, per channel, W·m⁻².
        color: what a white Lambertian surface that faces it shows: irradiance / π, W·sr⁻¹·m⁻².
        angle_degrees: angular diameter, 0 for parallel light; 0.53 for the sun.
    """

    direction: Vec3
    irradiance: ColorLike | None = None
    color: ColorLike | None = None
    angle_degrees: float = 0.0

    def __post_init__(self) -> None:
        if self.irradiance is None and self.color is None:
            _set(self, irradiance=1.0)
        _set(self, direction=_unit(self.direction, "direction"))
        angle = number(self.angle_degrees, "angle_degrees", minimum=0.0, maximum=180.0)
        if 0.0 < angle < 1e-3:
            raise InputError(f"angle_degrees must be 0 or at least 0.001, not {angle:g}")
        _set(self, angle_degrees=angle)
        _set_amount(self, "a directional light", {"irradiance": 1.0, "color": math.pi})


@dataclass(frozen=True)
class RectangleLight:
    """A rectangle that shines from its front, towards edge_u × edge_v, with the same radiance in every direction.

    It is no mesh: exact, sampled by its solid angle, and black to other light. Give one of `radiance` and `power`,
    Φ = π L A, twice that where it has two sides.

    Attributes:
        origin: a corner, metres.
        edge_u, edge_v: its sides, perpendicular, metres.
        radiance: per channel, W·sr⁻¹·m⁻².
        power: total radiant power per channel, W.
        two_sided: whether its back shines as well.
    """

    origin: Vec3
    edge_u: Vec3
    edge_v: Vec3
    radiance: ColorLike | None = None
    power: ColorLike | None = None
    two_sided: bool = False

    def __post_init__(self) -> None:
        u, v = vector(self.edge_u, "edge_u"), vector(self.edge_v, "edge_v")
        _set(self, origin=vector(self.origin, "origin"), edge_u=u, edge_v=v)
        lengths = math.hypot(*u), math.hypot(*v)
        if min(lengths) == 0.0:
            raise InputError("edge_u and edge_v must not be zero")
        if abs(sum(a * b for a, b in zip(u, v, strict=True))) > 1e-5 * lengths[0] * lengths[1]:
            raise InputError("edge_u and edge_v must be perpendicular; for another parallelogram add a quad that emits")
        boolean(self.two_sided, "two_sided")
        _set_radiance(self, "a rectangle light", lengths[0] * lengths[1] * (2.0 if self.two_sided else 1.0))


@dataclass(frozen=True)
class DiskLight:
    """A disk that shines from its front, towards its normal, with the same radiance in every direction.

    It is no mesh: exact, sampled by its solid angle, and black to other light. Give one of `radiance` and `power`,
    Φ = π L A, twice that where it has two sides.

    Attributes:
        center: metres.
        normal: where its front faces; any length but zero.
        radius: metres.
        radiance: per channel, W·sr⁻¹·m⁻².
        power: total radiant power per channel, W.
        two_sided: whether its back shines as well.
    """

    center: Vec3
    normal: Vec3
    radius: float = 0.5
    radiance: ColorLike | None = None
    power: ColorLike | None = None
    two_sided: bool = False

    def __post_init__(self) -> None:
        _set(self, center=vector(self.center, "center"), normal=_unit(self.normal, "normal"))
        _set(self, radius=number(self.radius, "radius", above=0.0))
        boolean(self.two_sided, "two_sided")
        _set_radiance(self, "a disk light", math.pi * self.radius**2 * (2.0 if self.two_sided else 1.0))


@dataclass(frozen=True)
class SphereLight:
    """A ball that shines outwards with the same radiance in every direction.

    It is no mesh: exact, sampled by its solid angle, and black to other light; black on its inside, too. Give one of
    `radiance` and `power`, Φ = 4π² r² L.

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

    def __post_init__(self) -> None:
        _set(self, center=vector(self.center, "center"), radius=number(self.radius, "radius", above=0.0))
        _set_radiance(self, "a sphere light", 4.0 * math.pi * self.radius**2)


Light: TypeAlias = PointLight | SpotLight | DirectionalLight | RectangleLight | DiskLight | SphereLight

LIGHTS: dict[str, type[Light]] = {
    "point": PointLight,
    "spot": SpotLight,
    "directional": DirectionalLight,
    "rectangle": RectangleLight,
    "disk": DiskLight,
    "sphere": SphereLight,
}
"""Lights by their `type` in scene files."""


def _set(light: Any, **values: Any) -> None:
    """Replace attributes by their checked values while the light is made."""
    for name, value in values.items():
        object.__setattr__(light, name, value)


def _unit(value: Any, name: str) -> Vec3:
    x, y, z = vector(value, name)
    length = math.hypot(x, y, z)
    if length == 0.0:
        raise InputError(f"{name} must not be zero")
    if abs(length - 1.0) < 1e-15:
        return x, y, z  # what was divided once stays as it is: a light that is read again is the same to the bit
    return x / length, y / length, z / length


def _set_amount(light: Any, what: str, factors: dict[str, float]) -> None:
    """Fill the first of several attributes from whichever was given, as the factors tell.

    What was given stays, too: so a light with one field replaced (`dataclasses.replace`) is given both, which agree.
    """
    given = {name: color(getattr(light, name), name) for name in factors if getattr(light, name) is not None}
    main = next(iter(factors))
    amounts = [tuple(x * factors[name] for x in value) for name, value in given.items()]
    agree = all(math.isclose(a, b, rel_tol=1e-9) for other in amounts for a, b in zip(amounts[0], other, strict=True))
    if not given or not agree:
        *names, last = factors
        either, link = ("either", "or") if len(names) == 1 else ("one of", "and")
        raise InputError(f"{what} takes {either} {', '.join(names)} {link} {last}")
    _set(light, **given)
    _set(light, **{main: amounts[0]})


def _set_radiance(light: Any, what: str, area: float) -> None:
    """Fill `radiance` from whichever of radiance and power was given; `area` is that of all sides that shine."""
    _set_amount(light, what, {"radiance": 1.0, "power": 1.0 / (math.pi * area)})
