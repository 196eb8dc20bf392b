"""Cameras: where they stand, what their pictures show, when their shutters are open."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from wrt.errors import InputError
from wrt.motion import Motion
from wrt.values import Vec3, integer, number, vector

APERTURES = ("disk", "square", "polygon")
"""Shapes of a lens's opening."""

_RIGID = 1e-4
"""Stretch that a motion may have by the rounding of its numbers."""


@dataclass(frozen=True)
class Camera:
    """What all cameras have in common.

    Attributes:
        origin: where it stands, metres; the centre of the lens if it has one.
        target: the point it looks at; in the middle of the picture unless the lens is shifted.
        up: a direction that points up in the picture; not parallel to the view.
        shutter_open: time when the shutter begins to open, seconds.
        shutter_close: time when it is closed again; the same time for a picture of one instant.
        shutter_ramp: share of the time between that goes into opening and closing, half of it into each, during which
            light grows and falls evenly: 0 opens at once (a box), 1 makes a triangle.
        motion: how it moves and turns from where `origin`, `target` and `up` have it.
    """

    origin: Vec3 = (0.0, 0.0, 3.0)
    target: Vec3 = (0.0, 0.0, 0.0)
    up: Vec3 = (0.0, 1.0, 0.0)
    shutter_open: float = field(default=0.0, kw_only=True)
    shutter_close: float = field(default=0.0, kw_only=True)
    shutter_ramp: float = field(default=0.0, kw_only=True)
    motion: Motion | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        for name in ("origin", "target", "up"):
            object.__setattr__(self, name, vector(getattr(self, name), f"camera {name}"))
        for name in ("shutter_open", "shutter_close"):
            self._check(name)
        if self.shutter_close < self.shutter_open:
            raise InputError(
                f"camera shutter_close must not be before shutter_open: {self.shutter_close:g} is before "
                f"{self.shutter_open:g}"
            )
        self._check("shutter_ramp", minimum=0.0, maximum=1.0)
        if self.motion is not None:
            if not isinstance(self.motion, Motion):
                raise InputError(f"camera motion must be a wrt.Motion, not {type(self.motion).__name__}")
            if np.abs(self.motion.parts.stretches - np.eye(3)).max() > _RIGID:
                raise InputError("camera motion must only move and turn: a key of it stretches or mirrors")
        self.frame()

    def _check(self, name: str, **limits: float) -> None:
        """Make an attribute a float within its limits."""
        object.__setattr__(self, name, number(getattr(self, name), f"camera {name}", **limits))

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


@dataclass(frozen=True)
class LensCamera(Camera):
    """A camera with a thin lens, whose opening has a shape that out-of-focus lights show.

    Attributes:
        aperture_radius: radius of the opening, metres; of its circumscribed circle where it is not a disk. 0 has
            everything in focus.
        focus_distance: distance from the lens to the plane in focus, along the view; by default
            the distance to `target`.
        aperture: shape of the opening, "disk", "square" or "polygon". A square has upright sides, a polygon a corner
            at the top.
        aperture_blades: corners of the polygon.
        aperture_rotation_degrees: turns the opening counter-clockwise, as lights beyond the plane in focus show it;
            lights before that plane show it upside down.
    """

    aperture_radius: float = field(default=0.0, kw_only=True)
    focus_distance: float | None = field(default=None, kw_only=True)
    aperture: str = field(default="disk", kw_only=True)
    aperture_blades: int = field(default=6, kw_only=True)
    aperture_rotation_degrees: float = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check("aperture_radius", minimum=0.0)
        if self.focus_distance is not None:
            self._check("focus_distance", above=0.0)
        if self.aperture not in APERTURES:
            raise InputError(f"camera aperture must be one of {', '.join(APERTURES)}, not {self.aperture!r}")
        blades = integer(self.aperture_blades, "camera aperture_blades", minimum=3, maximum=1000)
        object.__setattr__(self, "aperture_blades", blades)
        self._check("aperture_rotation_degrees")

    @property
    def distance_in_focus(self) -> float:
        """The focus distance in use, metres."""
        if self.focus_distance is not None:
            return self.focus_distance
        return float(np.linalg.norm(np.subtract(self.target, self.origin)))


@dataclass(frozen=True)
class PerspectiveCamera(LensCamera):
    """A thin-lens perspective camera; with aperture radius 0 a pinhole.

    Attributes:
        fov_degrees: full vertical field of view, between 0 and 180; of the picture before it is shifted.
        shift_x: how far the picture is moved to the right of the view, in picture heights: the lens of a view camera.
            Upright lines stay parallel as long as the camera itself is level.
        shift_y: how far it is moved up, in picture heights.
    """

    fov_degrees: float = 40.0
    shift_x: float = field(default=0.0, kw_only=True)
    shift_y: float = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check("fov_degrees", above=0.0)
        if self.fov_degrees >= 180.0:
            raise InputError(f"camera fov_degrees must be less than 180, not {self.fov_degrees:g}")
        self._check("shift_x")
        self._check("shift_y")


@dataclass(frozen=True)
class OrthographicCamera(LensCamera):
    """A camera of parallel rays: nothing gets smaller with distance.

    It sees what lies before the plane through `origin`.

    Attributes:
        view_height: height of what the picture shows, metres.
    """

    view_height: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check("view_height", above=0.0)


@dataclass(frozen=True)
class PanoramaCamera(Camera):
    """A spherical camera whose picture has longitude across and latitude upwards, as an environment image has.

    Attributes:
        horizontal_degrees: longitudes in the picture, at most 360, half of them on each side of the target.
        vertical_degrees: latitudes in the picture, at most 180, half of them above the target.
    """

    horizontal_degrees: float = 360.0
    vertical_degrees: float = 180.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check("horizontal_degrees", above=0.0, maximum=360.0)
        self._check("vertical_degrees", above=0.0, maximum=180.0)


@dataclass(frozen=True)
class FisheyeCamera(Camera):
    """An equidistant fisheye: distance from the middle of the picture is proportional to the angle from the view.

    The picture is a circle that touches the shorter sides, black outside.

    Attributes:
        fov_degrees: full field of view across the circle, at most 360.
    """

    fov_degrees: float = 180.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check("fov_degrees", above=0.0, maximum=360.0)


CAMERAS: dict[str, type[Camera]] = {
    "perspective": PerspectiveCamera,
    "orthographic": OrthographicCamera,
    "panorama": PanoramaCamera,
    "fisheye": FisheyeCamera,
}
"""The cameras by the names that scene files use."""
