"""Read Mitsuba's principled models as the nearest of wrt's.

Mitsuba follows Burley, "Physically Based Shading at Disney" (2012) and "Extending the Disney BRDF to a BSDF" (2015);
wrt follows glTF. Metals differ only in their masking; dielectrics differ in their diffuse part and in how layers share
light.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.io.mitsuba.materials.textures import Textures
from wrt.io.mitsuba.plugin import Plugin
from wrt.scene.materials import Principled
from wrt.scene.textures import ColorSource, ImageTexture, VertexColor
from wrt.values import Vec3, vec3

_SAMPLING = (
    "diffuse_reflectance_sampling_rate",
    "specular_reflectance_sampling_rate",
    "main_specular_sampling_rate",
    "clearcoat_sampling_rate",
    "spec_reflectance_sampling_rate",
    "spec_trans_sampling_rate",
    "diff_trans_sampling_rate",
)


_SHEEN, _SHEEN_ROUGHNESS = 0.154, 0.3
"""The glTF sheen closest to Burley's, (1 − cosθd)⁵: this roughness matches the growth of its albedo towards grazing
angles, and this colour matches its mean albedo over all directions, 0.0115."""


def principled(plugin: Plugin, textures: Textures) -> Principled:
    """Return the nearest material to a `principled`, with a warning where the models differ."""
    values = _base(plugin, textures)
    metallic = values["metallic"] = textures.number(plugin, "metallic", 0.0)
    clearcoat = textures.number(plugin, "clearcoat", 0.0)
    gloss = textures.number(plugin, "clearcoat_gloss", 0.0)
    if isinstance(clearcoat, float) and isinstance(gloss, float):
        # Burley's coat reflects a quarter as much light, with α between 0.1 and 0.001.
        values["coat"], values["coat_roughness"] = 0.25 * clearcoat, math.sqrt(0.1 + gloss * (0.001 - 0.1))
    elif clearcoat != 0.0:
        plugin.warn("'clearcoat' cannot vary here; left out")
    for name in ("flatness", "spec_tint"):
        if textures.number(plugin, name, 0.0) != 0.0:
            plugin.warn(f"{name!r} is left out")
    if isinstance(metallic, float) and isinstance(values["transmission"], float):
        values["base_color"] = _alike(values, metallic)
    if metallic != 1.0 or values.get("coat", 0.0) != 0.0:
        plugin.warn("taken as the principled material of glTF, which differs in its diffuse part and in its layers")
    return Principled(**values)


def principled_thin(plugin: Plugin, textures: Textures) -> Principled:
    """Return the nearest material to a `principledthin`, with a warning: the models differ."""
    values = _base(plugin, textures)
    for name in ("flatness", "spec_tint", "diff_trans"):
        if textures.number(plugin, name, 0.0, most=2.0) != 0.0:
            plugin.warn(f"{name!r} is left out")
    plugin.warn("taken as the thin-walled principled material of glTF, which differs in its diffuse part")
    return Principled(**values, thin_walled=True)


def _base(plugin: Plugin, textures: Textures) -> dict[str, Any]:
    plugin.ignore(*_SAMPLING)
    values: dict[str, Any] = {
        "base_color": textures.color(plugin, "base_color", 0.5),
        "roughness": textures.number(plugin, "roughness", 0.5),
        "transmission": textures.number(plugin, "spec_trans", 0.0),
        "ior": _index(plugin),
    }
    anisotropic = textures.number(plugin, "anisotropic", 0.0)
    if isinstance(anisotropic, float) and anisotropic > 0.0:
        values |= _anisotropic(plugin, values["roughness"], anisotropic)
    elif anisotropic != 0.0:
        plugin.warn("'anisotropic' cannot vary here; left out")
    sheen, tint = textures.number(plugin, "sheen", 0.0), textures.number(plugin, "sheen_tint", 0.0)
    if isinstance(sheen, float) and isinstance(tint, float):
        values["sheen_color"], values["sheen_roughness"] = _sheen(values["base_color"], sheen, tint), _SHEEN_ROUGHNESS
    else:
        plugin.warn("'sheen' cannot vary here; left out")
    return values


def _alike(values: dict[str, Any], metallic: float) -> ColorSource:
    """Return the base colour that makes glTF's model as bright as Burley's.

    - Diffuse: glTF subtracts the specular reflection; Burley subtracts little and adds retro-reflection of rough
      surfaces. The factor is the ratio of their mean albedos over all directions, fitted within 0.5 % for indices of
      1.3 to 1.8.
    - Transmitted: at each boundary glTF multiplies by the colour, Mitsuba by its square root.
    """
    base, roughness, transmission = values["base_color"], values["roughness"], values["transmission"]
    if isinstance(roughness, ImageTexture):
        roughness = float((roughness.pixels[..., 0] * np.float32(np.asarray(roughness.factor)[0])).mean())
    elif not isinstance(roughness, float):
        roughness = 0.5
    f0 = ((values["ior"] - 1.0) / (values["ior"] + 1.0)) ** 2
    through = (1.0 - metallic) * transmission
    factor = 1.0 + (1.0 - metallic) * (0.006 + 1.15 * f0 + max(0.055 - 0.5 * f0, 0.0) * roughness)

    def changed(color: NDArray[np.float32]) -> NDArray[np.float32]:
        color = np.clip(color, 0.0, 1.0)
        mixed = np.float32(1.0 - through) * np.minimum(color * np.float32(factor), 1.0)
        return np.asarray(mixed + np.float32(through) * np.sqrt(color), np.float32)

    if isinstance(base, ImageTexture):
        return dataclasses.replace(base, pixels=changed(base.pixels * np.asarray(base.factor, np.float32)), factor=1.0)
    if isinstance(base, VertexColor):
        return base
    return vec3(changed(np.broadcast_to(np.asarray(base, np.float32), 3)))


def _index(plugin: Plugin) -> float:
    """Return the refractive index from `eta`, or from `specular`, where 0 to 1 is a reflectance of 0 to 0.08."""
    if plugin.has("eta"):
        return max(plugin.number("eta", 1.5), 1.0)
    specular = min(max(plugin.number("specular", 0.5), 0.0), 1.0)
    return 2.0 / (1.0 - math.sqrt(0.08 * specular)) - 1.0


def _anisotropic(plugin: Plugin, roughness: ColorSource, anisotropic: float) -> dict[str, Any]:
    """Return the roughness and anisotropy of glTF with the same two α.

    Burley has α = r² / a along u and r² a along v, where a² = 1 − 0.9 `anisotropic`; glTF has α = r² along v and
    α + (1 − α) s² along u, where s is the strength.
    """
    if not isinstance(roughness, float):
        plugin.warn("'anisotropic' with a 'roughness' that varies is left out")
        return {}
    aspect = math.sqrt(1.0 - 0.9 * anisotropic)
    along_u, along_v = min(roughness**2 / aspect, 1.0), roughness**2 * aspect
    strength = math.sqrt((along_u - along_v) / (1.0 - along_v)) if along_v < 1.0 else 0.0
    return {"roughness": math.sqrt(along_v), "anisotropy": min(strength, 1.0)}


def _sheen(base: ColorSource, sheen: float, tint: float) -> Vec3:
    """Return the colour of the sheen: white, tinted by the hue of the base, as bright as Burley's."""
    if isinstance(base, ImageTexture):
        color = base.pixels.mean(axis=(0, 1)).astype(np.float64)
    elif isinstance(base, VertexColor):
        color = np.ones(3)
    else:
        color = np.broadcast_to(np.asarray(base, np.float64), 3)
    luminance = float(color @ (0.212671, 0.715160, 0.072169))
    hue = color / luminance if luminance > 0.0 else np.ones(3)
    return vec3(np.clip(_SHEEN * sheen * (1.0 + tint * (hue - 1.0)), 0.0, 1.0))
