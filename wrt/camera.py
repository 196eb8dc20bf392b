"""Cameras."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wrt.errors import InputError
from wrt.values import Vec3, number, vector


@dataclass(frozen=True)
class PerspectiveCamera:
    """A thin-lens perspective camera; with aperture radius 0 a pinhole.

    Attributes:
        origin: the centre of the lens, metres.
        target: the point in the middle of the picture.
        up: a direction that points up in the picture; not parallel to the view.
        fov_degrees: full vertical field of view, between 0 and 180.
        aperture_radius: radius of the lens, metres.
        focus_distance: distance from the lens to the plane in focus, along the view; by default
            the distance to `target`.
    """

    origin: Vec3 = (0.0, 0.0, 3.0)
    target: Vec3 = (0.0, 0.0, 0.0)
    up: Vec3 = (0.0, 1.0, 0.0)
    fov_degrees: float = 40.0
    aperture_radius: float = 0.0
    focus_distance: float | None = None

    def __post_init__(self) -> None:
        for name in ("origin", "target", "up"):
            object.__setattr__(self, name, vector(getattr(self, name), f"camera {name}"))
        fov = number(self.fov_degrees, "camera fov_degrees", above=0.0)
        if fov >= 180.0:
            raise InputError(f"camera fov_degrees must be less than 180, not {fov:g}")
        object.__setattr__(self, "fov_degrees", fov)
        radius = number(self.aperture_radius, "camera aperture_radius", minimum=0.0)
        object.__setattr__(self, "aperture_radius", radius)
        if self.focus_distance is not None:
            focus = number(self.focus_distance, "camera focus_distance", above=0.0)
            object.__setattr__(self, "focus_distance", focus)
        self.frame()

    def frame(self) -> np.ndarray:
        """Return the (3, 3) float64 rows right, up and forward: unit vectors, orthogonal."""
        forward = np.subtract(self.target, self.origin)
        distance = float(np.linalg.norm(forward))
        if distance == 0.0:
            raise InputError("camera origin and target must differ")
        forward = forward / distance
        right = np.cross(forward, self.up)
        length = float(np.linalg.norm(right))
        if length <= 1e-9 * float(np.linalg.norm(self.up)) or not np.any(self.up):
            raise InputError("camera up must not be zero or parallel to the view")
        right = right / length
        return np.stack([right, np.cross(right, forward), forward])

    @property
    def distance_in_focus(self) -> float:
        """The focus distance in use, metres."""
        if self.focus_distance is not None:
            return self.focus_distance
        return float(np.linalg.norm(np.subtract(self.target, self.origin)))
