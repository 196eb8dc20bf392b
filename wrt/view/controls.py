"""What a page can change: the settings of the render, the look of the picture, and the camera."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from wrt.develop.denoise import require_denoiser
from wrt.errors import InputError
from wrt.scene.camera import CAMERAS, Camera
from wrt.scene.developing import TONES, Exposure, check_exposure
from wrt.scene.integrators import INTEGRATORS
from wrt.scene.layers import LAYERS
from wrt.scene.scene import RenderSettings
from wrt.values import integer, one_of

CAMERA_KEYS = ("origin", "target", "up", "fov_degrees", "view_height", "focus_distance", "aperture_radius")
"""The fields of cameras that a page moves; a camera's others stay."""

SHOWN_LAYERS = ("", "noise", *(name for name in LAYERS if name not in ("uv", "motion", "edges")))
"""Radiance, its noise, and layers that a view can show. Texture coordinates and edges are not always on the device."""


@dataclass(frozen=True)
class Settings:
    """The settings of the render, besides the camera.

    Attributes:
        integrator: one of INTEGRATORS, or None for the scene's.
        max_depth: path segments, or None for the scene's.
        layer: one of SHOWN_LAYERS.
    """

    integrator: str | None = None
    max_depth: int | None = None
    layer: str = ""

    def overrides(self) -> dict[str, Any]:
        """Return the settings of `wrt.RenderSettings` that a picture of radiance takes from here."""
        values = {"integrator": self.integrator, "max_depth": self.max_depth}
        return {name: value for name, value in values.items() if value is not None}


@dataclass(frozen=True)
class Look:
    """How radiance is developed for the page; changes of it need no new render.

    Attributes:
        exposure: stops, "auto", or None; see `wrt.develop_image`.
        tone: the tone curve.
        denoise: whether noise is removed first.
    """

    exposure: Exposure = 0.0
    tone: str = "none"
    denoise: bool = False

    @classmethod
    def from_settings(cls, settings: RenderSettings) -> Look:
        """Return the look of saved pictures."""
        return cls(settings.exposure, settings.tone, settings.denoise)


def _integrator(value: object) -> str | None:
    choices = [name for name in INTEGRATORS if name != "aov"]
    return None if value in (None, "") else one_of(value, choices, "integrator")


def _denoise(value: object) -> bool:
    if not isinstance(value, bool):
        raise InputError("denoise must be true or false")
    if value:
        require_denoiser()
    return value


_CHECKS: dict[str, Callable[[Any], Any]] = {
    "integrator": _integrator,
    "max_depth": lambda value: None if value is None else integer(value, "max_depth", minimum=1, maximum=65536),
    "layer": lambda value: one_of(value, SHOWN_LAYERS, "layer"),
    "exposure": check_exposure,
    "tone": lambda value: one_of(value, TONES, "tone"),
    "denoise": _denoise,
}
"""Functions that check the fields of Settings and Look in a message."""

_Fields = TypeVar("_Fields", Settings, Look)


def changed(fields: _Fields, message: dict[str, Any]) -> _Fields:
    """Return settings or a look with the fields that a message of the page has.

    Raises:
        InputError: on an unusable value.
    """
    names = [each.name for each in dataclasses.fields(fields) if each.name in message]
    return dataclasses.replace(fields, **{name: _CHECKS[name](message[name]) for name in names})


# --- The camera ------------------------------------------------------------------------------------


def moved_camera(camera: Camera, values: object) -> Camera:
    """Return a camera with the fields that a page has changed, without its own motion.

    Raises:
        InputError: on an unusable value.
    """
    if not isinstance(values, dict):
        raise InputError("a camera must be a table")
    changes = {key: values[key] for key in CAMERA_KEYS if key in values and hasattr(camera, key)}
    return dataclasses.replace(camera, motion=None, **changes)


def camera_values(camera: Camera) -> dict[str, Any]:
    """Return the fields of a camera that a page can change, and its type."""
    return {"type": camera.type_name, **{key: getattr(camera, key) for key in CAMERA_KEYS if hasattr(camera, key)}}


def camera_toml(camera: Camera) -> str:
    """Return a camera as a table of a scene file."""
    import tomli_w

    names = {cls: name for name, cls in CAMERAS.items()}
    table: dict[str, Any] = {"type": names[type(camera)]}
    for each in dataclasses.fields(camera):
        value = getattr(camera, each.name)
        if each.name == "motion" or value is None or (value == each.default and each.name not in CAMERA_KEYS[:3]):
            continue
        table[each.name] = [float(item) for item in value] if isinstance(value, tuple) else value
    return tomli_w.dumps({"camera": table})
