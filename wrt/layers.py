"""The layers that a picture may have beside its light, by name."""

from __future__ import annotations

from dataclasses import dataclass

from wrt.errors import InputError, did_you_mean


@dataclass(frozen=True)
class Layer:
    """One layer.

    Attributes:
        channels: what its numbers are called in OpenEXR files, after its own name and a dot.
        averaged: whether it is the mean of all samples, or what the one nearest to the pixel's middle shows.
    """

    channels: str
    averaged: bool = False


LAYERS: dict[str, Layer] = {
    "albedo": Layer("RGB", averaged=True),
    "normal": Layer("XYZ", averaged=True),
    "geometric_normal": Layer("XYZ", averaged=True),
    "alpha": Layer("A", averaged=True),
    "depth": Layer("Z"),
    "position": Layer("XYZ"),
    "uv": Layer("UV"),
    "motion": Layer("XY"),
    "object": Layer("N"),
    "material": Layer("N"),
}
"""By name; docs/integrators.md says what each holds."""

NUMBERS = ("object", "material")
"""Layers of whole numbers, uint32."""


def layer_names(value: object) -> tuple[str, ...]:
    """Return names of layers, each once, in the order of LAYERS.

    Args:
        value: a list or tuple of names, or text with commas between them.

    Raises:
        InputError: on a name that is none.
    """
    if isinstance(value, str):
        value = [name.strip() for name in value.split(",") if name.strip()]
    if not isinstance(value, (list, tuple)):
        raise InputError(f"layers must be a list of names, not {value!r}")
    for name in value:
        if not isinstance(name, str) or name not in LAYERS:
            raise InputError(f"there is no layer {name!r}{did_you_mean(name, LAYERS)}; there are {', '.join(LAYERS)}")
    return tuple(name for name in LAYERS if name in value)


def channel_names(layer: str) -> list[str]:
    """Return what a layer's channels are called in OpenEXR files; coverage is A, as in every RGBA picture."""
    return ["A"] if layer == "alpha" else [f"{layer}.{channel}" for channel in LAYERS[layer].channels]
