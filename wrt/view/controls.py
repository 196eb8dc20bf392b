"""What a page may ask for: the camera and the settings of a view, checked."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

from wrt.develop.settings import TONES, Exposure, check_exposure
from wrt.errors import InputError
from wrt.scene.camera import CAMERAS, Camera
from wrt.scene.layers import LAYERS
from wrt.scene.scene import INTEGRATORS
from wrt.values import integer, one_of

CAMERA_KEYS = (
    "origin",
    "target",
    "up",
    "fov_degrees",
    "view_height",
    "focus_distance",
    "aperture_radius",
)
"""The fields of cameras that a page moves; a camera's others stay."""

SHOWN_LAYERS = ("", "noise", *(name for name in LAYERS if name not in ("uv", "motion")))
"""What a view can show: radiance, its noise, or a layer. Texture coordinates are not always on the device."""


@dataclass(frozen=True)
class Settings:
    """What is rendered, besides the camera.

    Attributes:
        integrator: one of INTEGRATORS, or None for the scene's own.
        max_depth: path segments, or None for the scene's own.
        layer: one of SHOWN_LAYERS.
    """

    integrator: str | None = None
    max_depth: int | None = None
    layer: str = ""

    def changed(self, values: dict[str, Any]) -> Settings:
        """Return settings with those values of a message that are settings.

        Raises:
            InputError: on an unusable value.
        """
        new: dict[str, Any] = {}
        if "integrator" in values:
            named = values["integrator"]
            known = [name for name in INTEGRATORS if name != "aov"]
            new["integrator"] = None if named in (None, "") else one_of(named, known, "integrator")
        if "max_depth" in values:
            depth = values["max_depth"]
            new["max_depth"] = None if depth is None else integer(depth, "max_depth", minimum=1, maximum=65536)
        if "layer" in values:
            new["layer"] = one_of(values["layer"], SHOWN_LAYERS, "layer")
        return dataclasses.replace(self, **new)

    def overrides(self) -> dict[str, Any]:
        """Return the settings of `wrt.RenderSettings` that a picture of radiance takes from here."""
        values = {"integrator": self.integrator, "max_depth": self.max_depth}
        return {name: value for name, value in values.items() if value is not None}


def exposure_of(value: object) -> Exposure:
    """Return an exposure: stops, "auto", or None for the default; or raise InputError."""
    return check_exposure(value)


def denoise_of(value: object) -> bool:
    """Return whether to denoise; raise InputError if it is not possible."""
    if value is True:
        from wrt.develop.denoise import require_denoiser

        require_denoiser()
    elif value is not False:
        raise InputError("denoise must be true or false")
    return value


def tone_of(value: object) -> str:
    """Return the name of one of wrt's own tone curves, or raise InputError."""
    return one_of(value, TONES, "tone")


def moved_camera(camera: Camera, values: object) -> Camera:
    """Return a camera with the fields that a page has changed; a camera that moved by itself stands still then.

    Raises:
        InputError: on an unusable value.
    """
    if not isinstance(values, dict):
        raise InputError("a camera must be a table")
    known = {each.name for each in dataclasses.fields(camera)}
    changes = {key: values[key] for key in CAMERA_KEYS if key in values and key in known}
    return dataclasses.replace(camera, motion=None, **changes)


def camera_values(camera: Camera) -> dict[str, Any]:
    """Return the fields of a camera that a page can change, and its type."""
    known = {each.name for each in dataclasses.fields(camera)}
    values = {key: getattr(camera, key) for key in CAMERA_KEYS if key in known}
    listed = {key: list(value) if isinstance(value, tuple) else value for key, value in values.items()}
    return {"type": camera.type_name, **listed}


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
