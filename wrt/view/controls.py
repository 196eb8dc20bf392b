"""The camera and the settings of a view, as a page may change them."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

from wrt.errors import InputError
from wrt.scene.camera import CAMERAS, Camera
from wrt.scene.layers import LAYERS
from wrt.scene.scene import INTEGRATORS
from wrt.values import integer, one_of

CAMERA_KEYS = ("origin", "target", "up", "fov_degrees", "view_height", "focus_distance", "aperture_radius")
"""The fields of cameras that a page moves; a camera's others stay."""

SHOWN_LAYERS = ("", "noise", *(name for name in LAYERS if name not in ("uv", "motion")))
"""Radiance, its noise, and layers that a view can show. Texture coordinates are not always on the device."""


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

    def changed(self, values: dict[str, Any]) -> Settings:
        """Return the settings with the fields that a message of the page has.

        Raises:
            InputError: on an unusable value.
        """
        new: dict[str, Any] = {}
        if "integrator" in values:
            integrator = values["integrator"]
            choices = [name for name in INTEGRATORS if name != "aov"]
            new["integrator"] = None if integrator in (None, "") else one_of(integrator, choices, "integrator")
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
    values = {key: getattr(camera, key) for key in CAMERA_KEYS if hasattr(camera, key)}
    lists = {key: list(value) if isinstance(value, tuple) else value for key, value in values.items()}
    return {"type": camera.type_name, **lists}


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
