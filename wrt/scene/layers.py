"""The layers (AOVs) that can be rendered besides radiance, by name."""

from __future__ import annotations

from dataclasses import dataclass

from wrt.errors import InputError, did_you_mean


@dataclass(frozen=True)
class Layer:
    """One layer.

    Attributes:
        channels: channel names in OpenEXR files, after the name of the layer and a dot.
        averaged: whether it is the mean of all samples, not the sample nearest to the pixel's centre.
    """

    channels: str
    averaged: bool = False


LAYERS: dict[str, Layer] = {
    "albedo": Layer("RGB", averaged=True),
    "normal": Layer("XYZ", averaged=True),
    "geometric_normal": Layer("XYZ", averaged=True),
    "alpha": Layer("A", averaged=True),
    "depth": Layer("Z"),
    "z": Layer("Z"),
    "position": Layer("XYZ"),
    "uv": Layer("UV"),
    "motion": Layer("XY"),
    "object": Layer("N"),
    "material": Layer("N"),
}
"""Layers by name; docs/integrators.md describes them."""

LIGHT_GROUPS = "light_groups"
"""Selects a layer for each group of lights: `light_` and its name, three channels of radiance."""

REST = "rest"
"""The group of lights that name none, and of the emission of media and of unlit surfaces."""

ALL_LAYERS = (*LAYERS, LIGHT_GROUPS)
"""All names that select layers."""

NUMBERS = ("object", "material")
"""Layers of integers, uint32."""


def layer_names(value: object) -> tuple[str, ...]:
    """Return names of layers, each once, in the order of ALL_LAYERS.

    Args:
        value: a list or tuple of names, or comma-separated text.

    Raises:
        InputError: if a name is unknown.
    """
    if isinstance(value, str):
        value = [name.strip() for name in value.split(",") if name.strip()]
    if not isinstance(value, (list, tuple)):
        raise InputError(f"layers must be a list of names, not {value!r}")
    for name in value:
        if not isinstance(name, str) or name not in ALL_LAYERS:
            known = ", ".join(ALL_LAYERS)
            raise InputError(f"there is no layer {name!r}{did_you_mean(name, ALL_LAYERS)}; there are {known}")
    return tuple(name for name in ALL_LAYERS if name in value)


def group_layer(group: str) -> str:
    """Return the name of the layer of a light group."""
    return f"light_{group}"


NOISY = "noisy"
"""Name in OpenEXR files of the picture before it was denoised."""


def channel_names(layer: str) -> list[str]:
    """Return the channel names of a layer in OpenEXR files; coverage is A, as in every RGBA picture."""
    is_light = layer == NOISY or layer.startswith(group_layer(""))
    channels = "RGB" if is_light else LAYERS[layer].channels
    return ["A"] if layer == "alpha" else [f"{layer}.{channel}" for channel in channels]
