"""Read Mitsuba's principled models, which wrt has as Burley."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

from wrt.io.mitsuba.materials.textures import Textures
from wrt.io.mitsuba.plugin import Plugin
from wrt.scene.materials import Burley
from wrt.scene.textures import ColorSource, ImageTexture, VertexColor
from wrt.values import vec3

_SAMPLING = (
    "diffuse_reflectance_sampling_rate",
    "specular_reflectance_sampling_rate",
    "main_specular_sampling_rate",
    "clearcoat_sampling_rate",
    "spec_reflectance_sampling_rate",
    "spec_trans_sampling_rate",
    "diff_trans_sampling_rate",
)

_NUMBERS = {
    "roughness": 0.5,
    "anisotropic": 0.0,
    "spec_trans": 0.0,
    "spec_tint": 0.0,
    "sheen": 0.0,
    "sheen_tint": 0.0,
    "flatness": 0.0,
}
"""Values of both models, with Mitsuba's defaults."""

_NAMES = {"anisotropic": "anisotropy", "spec_trans": "transmission", "spec_tint": "specular_tint"}


def principled(plugin: Plugin, textures: Textures) -> Burley:
    """Return the material of a `principled`."""
    return Burley(
        **_base(plugin, textures),
        metallic=textures.number(plugin, "metallic", 0.0),
        coat=textures.number(plugin, "clearcoat", 0.0),
        coat_gloss=textures.number(plugin, "clearcoat_gloss", 0.0),
    )


def principled_thin(plugin: Plugin, textures: Textures) -> Burley:
    """Return the material of a `principledthin`."""
    through = textures.number(plugin, "diff_trans", 0.0, most=2.0)
    return Burley(**_base(plugin, textures), thin_walled=True, diffuse_transmission=_halved(through))


def _base(plugin: Plugin, textures: Textures) -> dict[str, Any]:
    plugin.ignore(*_SAMPLING)
    numbers = {_NAMES.get(name, name): textures.number(plugin, name, usual) for name, usual in _NUMBERS.items()}
    return {"base_color": textures.color(plugin, "base_color", 0.5), "ior": _index(plugin), **numbers}


def _halved(value: ColorSource) -> ColorSource:
    """Return half a number; in Mitsuba 2 stands for all of the light."""
    if isinstance(value, (ImageTexture, VertexColor)):
        return dataclasses.replace(value, factor=vec3([0.5 * x for x in value.factor]))  # type: ignore[union-attr]
    return 0.5 * float(value)  # type: ignore[arg-type]


def _index(plugin: Plugin) -> float:
    """Return the refractive index from `eta`, or from `specular`, where 0 to 1 is a reflectance of 0 to 0.08."""
    if plugin.has("eta"):
        if plugin.named("eta") is not None:
            plugin.warn("'eta' cannot vary here; it is 1.5")
            return 1.5
        return max(plugin.number("eta", 1.5), 1.0)
    specular = min(max(plugin.number("specular", 0.5), 0.0), 1.0)
    return 2.0 / (1.0 - math.sqrt(0.08 * specular)) - 1.0
