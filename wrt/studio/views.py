"""Directions to look from, by angles or by name."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from wrt.errors import InputError, did_you_mean
from wrt.scene.camera import Camera, OrthographicCamera
from wrt.values import Vec3, number

ViewLike: TypeAlias = str | tuple[float, float]
"""A name in VIEWS, text "AZIMUTH,ELEVATION", or the two angles; degrees."""

THREE_QUARTER: Vec3 = (0.45, 0.38, 1.0)
"""Direction from the object to the camera by default: in front, slightly to the right and above."""

VIEWS: dict[str, tuple[float, float]] = {
    "front": (0.0, 0.0),
    "right": (90.0, 0.0),
    "back": (180.0, 0.0),
    "left": (-90.0, 0.0),
    "top": (0.0, 90.0),
    "bottom": (0.0, -90.0),
    "three-quarter": (
        math.degrees(math.atan2(THREE_QUARTER[0], THREE_QUARTER[2])),
        math.degrees(math.atan2(THREE_QUARTER[1], math.hypot(THREE_QUARTER[0], THREE_QUARTER[2]))),
    ),
}
"""Azimuth and elevation by name, degrees. "right" is the side at the viewer's right in the front view."""

_STEEP = 89.0
"""Elevation above which +y no longer serves as the upper edge of a picture, degrees."""


def view_angles(view: object) -> tuple[float, float]:
    """Return azimuth and elevation of a view in degrees.

    At azimuth 0 the camera is in front, towards +z, and at 90 towards +x: it goes round counter-clockwise as seen from
    above. The elevation is above the horizon, −90 to 90.

    Raises:
        InputError: if the view is neither a known name nor two such angles.
    """
    what = f"view must be AZIMUTH,ELEVATION in degrees, such as 30,20, or one of {', '.join(VIEWS)}"
    angles: object = view
    if isinstance(view, str):
        word = view.strip().lower()
        if word in VIEWS:
            return VIEWS[word]
        parts = word.split(",")
        if len(parts) != 2:
            raise InputError(f"{what}, not {view!r}{did_you_mean(word, VIEWS)}")
        try:
            angles = tuple(float(part) for part in parts)
        except ValueError:
            raise InputError(f"{what}, not {view!r}") from None
    if not isinstance(angles, (tuple, list, np.ndarray)) or len(angles) != 2:
        raise InputError(f"{what}, not {view!r}")
    azimuth = number(angles[0], "the azimuth of a view", minimum=-36000.0, maximum=36000.0)
    return azimuth, number(angles[1], "the elevation of a view", minimum=-90.0, maximum=90.0)


def view_direction(view: object) -> tuple[Vec3, Vec3]:
    """Return the direction from the object to the camera, and the camera's up direction.

    Raises:
        InputError: see `view_angles`.
    """
    angles = view_angles(view)
    if angles == VIEWS["three-quarter"]:
        return THREE_QUARTER, (0.0, 1.0, 0.0)
    azimuth, elevation = (math.radians(angle) for angle in angles)
    flat, height = math.cos(elevation), math.sin(elevation)
    toward = (flat * math.sin(azimuth), height, flat * math.cos(azimuth))
    if abs(angles[1]) < _STEEP:
        return toward, (0.0, 1.0, 0.0)
    return toward, (-height * math.sin(azimuth), flat, -height * math.cos(azimuth))


def azimuth_of(camera: Camera, center: np.ndarray) -> float:
    """Return the azimuth in degrees from which a camera sees a point; 0 if it is straight above or below."""
    forward = camera.frame()[2]
    toward = -forward if isinstance(camera, OrthographicCamera) else np.subtract(camera.origin, center)
    return math.degrees(math.atan2(toward[0], toward[2]))
