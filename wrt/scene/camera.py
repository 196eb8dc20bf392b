"""Cameras: position, projection, lens and shutter."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass
from functools import partial
from typing import Annotated, Any, ClassVar

import numpy as np

from wrt.errors import InputError
from wrt.linalg import norm
from wrt.scene.description import Kind, NotNegative, Number, Positive, Vector, instance_of, optional, word_of
from wrt.scene.motion import Motion
from wrt.values import integer, number

APERTURES = ("disk", "square", "polygon")
"""Shapes of the aperture."""

_RIGID = 1e-4
"""Tolerance for stretch in a camera's motion, due to rounding."""


@dataclass(frozen=True)
class Camera(Kind):
    """Base of all cameras.

    Attributes:
        origin: position of the camera, metres; the centre of the lens if it has one.
        target: point the camera looks at, in the centre of the picture unless the lens is shifted.
        up: a direction that points up in the picture; not parallel to the view.
        shutter_open: time when the shutter begins to open, seconds.
        shutter_close: time when the shutter is closed again, seconds; equal to `shutter_open` for an instant.
        shutter_ramp: fraction of that time that opening and closing take, half each, linearly: 0 is a box, 1 a
            triangle.
        motion: motion of the camera, applied to `origin`, `target` and `up`.
    """

    origin: Vector = (0.0, 0.0, 3.0)
    target: Vector = (0.0, 0.0, 0.0)
    up: Vector = (0.0, 1.0, 0.0)
    _: KW_ONLY
    shutter_open: Number = 0.0
    shutter_close: Number = 0.0
    shutter_ramp: Annotated[float, partial(number, minimum=0.0, maximum=1.0)] = 0.0
    motion: Annotated[Motion | None, optional(instance_of(Motion))] = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.shutter_close < self.shutter_open:
            raise InputError(
                f"camera shutter_close must not be before shutter_open: {self.shutter_close:g} is before "
                f"{self.shutter_open:g}"
            )
        if self.motion is not None and np.abs(self.motion.parts.stretches - np.eye(3)).max() > _RIGID:
            raise InputError("camera motion must be rigid: one of its keys stretches or mirrors")
        self.frame()

    def _label(self, name: str) -> str:
        return f"camera {name}"

    def frame(self) -> np.ndarray:
        """Return the orthonormal rows right, up and forward, (3, 3) float64."""
        forward = np.subtract(self.target, self.origin)
        distance = norm(forward)
        if distance == 0.0:
            raise InputError("camera origin and target must differ")
        forward = forward / distance
        right = np.cross(forward, self.up)
        length = norm(right)
        if length <= 1e-9 * norm(self.up) or not np.any(self.up):
            raise InputError("camera up must not be zero or parallel to the view")
        right = right / length
        return np.stack([right, np.cross(right, forward), forward])

    def film(self, width: int, height: int) -> dict[str, Any]:
        """Return fields of the kernels' Camera for a picture of this size in pixels.

        `pixel` is the width and the height of a pixel on the film, in the model's unit. `shift` (the centre of the
        picture on the film), `limit` and `parameters` are given if the model needs them.
        """
        raise NotImplementedError


@dataclass(frozen=True)
class LensCamera(Camera):
    """A camera with a thin lens, whose aperture shapes out-of-focus highlights.

    Attributes:
        aperture_radius: radius of the aperture or of the circle around it, metres. At 0 everything is in focus.
        focus_distance: distance to the focal plane, along the view; by default that to `target`.
        aperture: "disk", "square" with upright sides, or "polygon" with a corner at the top.
        aperture_blades: number of corners of the polygon.
        aperture_rotation_degrees: turns the aperture counter-clockwise, as lights beyond the focal plane show it.
    """

    _: KW_ONLY
    aperture_radius: NotNegative = 0.0
    focus_distance: Annotated[float | None, optional(partial(number, above=0.0))] = None
    aperture: Annotated[str, word_of(APERTURES)] = "disk"
    aperture_blades: Annotated[int, partial(integer, minimum=3, maximum=1000)] = 6
    aperture_rotation_degrees: Number = 0.0

    @property
    def distance_in_focus(self) -> float:
        """The focus distance in use, metres."""
        if self.focus_distance is not None:
            return self.focus_distance
        return norm(np.subtract(self.target, self.origin))


@dataclass(frozen=True)
class PerspectiveCamera(LensCamera):
    """A thin-lens perspective camera; with aperture radius 0 a pinhole.

    Attributes:
        fov_degrees: vertical field of view before any shift, at most 179.
        shift_x: lens shift to the right, in picture heights.
        shift_y: lens shift upwards, in picture heights.
    """

    type_name: ClassVar[str] = "perspective"

    fov_degrees: Annotated[float, partial(number, above=0.0, maximum=179.0)] = 40.0
    _: KW_ONLY
    shift_x: Number = 0.0
    shift_y: Number = 0.0

    def film(self, width: int, height: int) -> dict[str, Any]:
        pixel = 2.0 * math.tan(math.radians(self.fov_degrees) / 2.0) / height
        return {"pixel": (pixel, pixel), "shift": (self.shift_x * height * pixel, self.shift_y * height * pixel)}


@dataclass(frozen=True)
class OrthographicCamera(LensCamera):
    """A camera with parallel rays: objects do not shrink with distance.

    It sees everything in front of the plane through `origin`.

    Attributes:
        view_height: height of the view, metres.
    """

    type_name: ClassVar[str] = "orthographic"

    view_height: Positive = 2.0

    def film(self, width: int, height: int) -> dict[str, Any]:
        return {"pixel": (self.view_height / height, self.view_height / height)}


@dataclass(frozen=True)
class PanoramaCamera(Camera):
    """A spherical camera in latitude-longitude layout, like an environment image.

    Attributes:
        horizontal_degrees: range of longitude, at most 360, centred on the target.
        vertical_degrees: range of latitude, at most 180, centred on the target.
    """

    type_name: ClassVar[str] = "panorama"

    horizontal_degrees: Annotated[float, partial(number, above=0.0, maximum=360.0)] = 360.0
    vertical_degrees: Annotated[float, partial(number, above=0.0, maximum=180.0)] = 180.0

    def film(self, width: int, height: int) -> dict[str, Any]:
        degrees = (self.horizontal_degrees / width, self.vertical_degrees / height)
        return {"pixel": (math.radians(degrees[0]), math.radians(degrees[1]))}


@dataclass(frozen=True)
class FisheyeCamera(Camera):
    """An equidistant fisheye: distance from the picture's centre is proportional to the angle.

    The picture is a circle as wide as its shorter side, black outside.

    Attributes:
        fov_degrees: full field of view across the circle, at most 360.
    """

    type_name: ClassVar[str] = "fisheye"

    fov_degrees: Annotated[float, partial(number, above=0.0, maximum=360.0)] = 180.0

    def film(self, width: int, height: int) -> dict[str, Any]:
        pixel = math.radians(self.fov_degrees) / min(width, height)
        return {"pixel": (pixel, pixel), "limit": math.radians(self.fov_degrees) / 2.0}


CAMERAS: dict[str, type[Camera]] = {
    cls.type_name: cls for cls in (PerspectiveCamera, OrthographicCamera, PanoramaCamera, FisheyeCamera)
}
"""Cameras by their `type` in scene files."""


def require_camera(value: object) -> None:
    """Raise InputError unless a value is a camera."""
    if not isinstance(value, tuple(CAMERAS.values())):
        raise InputError(f"the scene's camera must be one of wrt's cameras, not {type(value).__name__}")
