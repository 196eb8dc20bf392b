"""The layers (AOVs) that can be rendered besides radiance, by name."""

from __future__ import annotations

from dataclasses import dataclass

from wrt.errors import InputError, did_you_mean
from wrt.scene import cryptomatte


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
    "edges": Layer("Y", averaged=True),
    "depth": Layer("Z"),
    "z": Layer("Z"),
    "position": Layer("XYZ"),
    "uv": Layer("UV"),
    "motion": Layer("XY"),
    "object": Layer("N"),
    "material": Layer("N"),
    **dict.fromkeys(cryptomatte.TYPES, Layer("RGBA")),
}
"""Layers by name that describe the first surface; docs/integrators.md describes them."""

SHADOW = "shadow"
"""The layer that is computed from two films; see `wrt.rendering.catchers`."""

LIGHT_GROUPS = "light_groups"
"""Selects a layer for each group of lights: `light_` and its name, three channels of radiance."""

REST = "rest"
"""The group of lights that name none, and of the emission of media and of unlit surfaces."""

SELECTABLE = {**LAYERS, SHADOW: Layer("RGB", averaged=True), LIGHT_GROUPS: Layer("RGB", averaged=True)}
"""The layers that may be selected."""

CATCHER = "catcher"
"""The layer of films alone that `shadow` is made from: radiance of samples that see a catcher, and their share."""

FILM_LAYERS = {**LAYERS, CATCHER: Layer("RGBA", averaged=True)}
"""The layers that a film may have."""

NUMBERS = ("object", "material")
"""Layers of integers, uint32."""

NAMED = (*NUMBERS, *cryptomatte.TYPES)
"""Layers whose values stand for names of objects or materials."""

GROUPS = {"cryptomatte": tuple(cryptomatte.TYPES)}
"""Layers that are selected together by one more name."""


def layer_names(value: object) -> tuple[str, ...]:
    """Return names of layers, each once, in the order of SELECTABLE.

    Args:
        value: a list or tuple of names, or comma-separated text.

    Raises:
        InputError: if a name is unknown.
    """
    if isinstance(value, str):
        value = [name.strip() for name in value.split(",") if name.strip()]
    if not isinstance(value, (list, tuple)):
        raise InputError(f"layers must be a list of names, not {value!r}")
    known = (*SELECTABLE, *GROUPS)
    for name in value:
        if not isinstance(name, str) or name not in known:
            raise InputError(f"there is no layer {name!r}{did_you_mean(name, known)}; there are {', '.join(known)}")
    selected = {member for name in value for member in GROUPS.get(name, (name,))}
    return tuple(name for name in SELECTABLE if name in selected)


def group_layer(group: str) -> str:
    """Return the name of the layer of a light group."""
    return f"light_{group}"


NOISY = "noisy"
"""Name in OpenEXR files of the picture before it was denoised."""


def channel_names(layer: str) -> list[str]:
    """Return the channel names of a layer in OpenEXR files; coverage is A, as in every RGBA picture."""
    if layer in cryptomatte.TYPES:
        return cryptomatte.channels_of(layer)
    is_light = layer == NOISY or layer.startswith(group_layer(""))
    channels = "RGB" if is_light else SELECTABLE[layer].channels
    return ["A"] if layer == "alpha" else [f"{layer}.{channel}" for channel in channels]
