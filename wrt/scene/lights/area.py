"""Lights that are rectangles, disks and spheres."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from wrt.errors import InputError
from wrt.linalg import dot, norm
from wrt.scene.description import Flag, Positive, Vector
from wrt.scene.lights.light import EVERYWHERE, Direction, Light, LightExtent
from wrt.values import ColorLike


class _AreaLight(Light):
    """Base of shapes that emit the same radiance in every direction."""

    radiance: ColorLike | None
    two_sided: bool = False

    def _set_radiance(self, area: float) -> None:
        """Fill `radiance` from the radiance or power, for the area of one side, square metres."""
        area *= 2.0 if self.two_sided else 1.0
        self._set_amount({"radiance": 1.0, "power": 1.0 / (math.pi * area)})

    def record(self) -> dict[str, Any]:
        return {"value": self.radiance, "two_sided": self.two_sided}


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

    origin: Vector
    edge_u: Vector
    edge_v: Vector
    radiance: ColorLike | None = None
    power: ColorLike | None = None
    two_sided: Flag = False

    type_name: ClassVar[str] = "rectangle"

    def __post_init__(self) -> None:
        super().__post_init__()
        u, v = self.edge_u, self.edge_v
        lengths = math.hypot(*u), math.hypot(*v)
        if min(lengths) == 0.0:
            raise InputError("edge_u and edge_v must not be zero")
        if abs(sum(a * b for a, b in zip(u, v, strict=True))) > 1e-5 * lengths[0] * lengths[1]:
            raise InputError("edge_u and edge_v must be perpendicular; for another parallelogram add a quad that emits")
        self._set_radiance(lengths[0] * lengths[1])

    def shape(self) -> dict[str, Any]:
        size = np.linalg.norm([self.edge_u, self.edge_v], axis=1)
        x, y = np.array(self.edge_u) / size[0], np.array(self.edge_v) / size[1]
        y = y - x * dot(x, y)
        y /= norm(y)
        return {"place": self.origin, "x": x, "y": y, "normal": np.cross(x, y), "size": size}

    def extent(self) -> LightExtent:
        o, u, v = np.array(self.origin), np.array(self.edge_u), np.array(self.edge_v)
        normal = np.cross(u, v)
        area = norm(normal)
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

    center: Vector
    normal: Direction
    radius: Positive = 0.5
    radiance: ColorLike | None = None
    power: ColorLike | None = None
    two_sided: Flag = False

    type_name: ClassVar[str] = "disk"

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set_radiance(math.pi * self.radius**2)

    def shape(self) -> dict[str, Any]:
        return {"place": self.center, "normal": self.normal, "size": (self.radius,) * 2}

    def extent(self) -> LightExtent:
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

    center: Vector
    radius: Positive = 0.5
    radiance: ColorLike | None = None
    power: ColorLike | None = None

    type_name: ClassVar[str] = "sphere"

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set_radiance(4.0 * math.pi * self.radius**2)

    def shape(self) -> dict[str, Any]:
        return {"place": self.center, "size": (self.radius,) * 2}

    def extent(self) -> LightExtent:
        corners = [np.array(self.center) - self.radius, np.array(self.center) + self.radius]
        return LightExtent(corners, EVERYWHERE, self.radiance, 4.0 * math.pi**2 * self.radius**2, cos_spread=-1.0)
