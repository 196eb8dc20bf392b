"""The metallic-roughness material that is nearest to any other, for writing glTF files."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from wrt.scene.materials import (
    Burley,
    Conductor,
    Dielectric,
    Diffuse,
    Emissive,
    Glossy,
    Material,
    Mirror,
    Mix,
    OrenNayar,
    Plastic,
    Principled,
    RoughConductor,
    RoughDielectric,
    RoughPlastic,
    ThinDielectric,
    TwoSided,
    Unlit,
)
from wrt.scene.textures import CHANNELS, VARYING, ColorSource, ImageTexture, Texture, VertexColor
from wrt.values import Vec3, vec3

Note = Callable[[str], None]
"""Called with what glTF cannot hold, in words."""

_MATT = {"roughness": 1.0, "specular": 0.0}


def nearest(material: Material, note: Note) -> Principled:
    """Return the nearest Principled with the material's opacity and normals."""
    fields = {field.name: getattr(material, field.name) for field in dataclasses.fields(material)}
    if procedures := {name: value for name, value in fields.items() if isinstance(value, Texture)}:
        note("procedural textures: the mean of their colours is written")
        material = dataclasses.replace(material, **{name: _middle(value) for name, value in procedures.items()})  # type: ignore[arg-type]
    if isinstance(material, Principled):
        if material.multiple_bounces:
            note("further bounces between facets")
        return material
    if isinstance(material, (Mix, TwoSided)):
        return _nearest_of_part(material, note)
    values = _values(material, note)
    if values.get("transmission") and not values.get("thin_walled", False):
        of_bodies = ("interior", "priority", "dispersion")
        values |= {name: getattr(material, name) for name in of_bodies if hasattr(material, name)}
    return Principled(**values, opacity=material.opacity, normal_map=material.normal_map)


def _middle(texture: Texture) -> ColorSource:
    """Return the mean of a procedural texture's bounds, a number if that is grey."""
    mean = np.mean([color_of(bound) for bound in texture.bounds or (0.5,)], axis=0) * color_of(texture)
    return float(mean[0]) if (mean == mean[0]).all() else vec3(mean)


def _nearest_of_part(material: Mix | TwoSided, note: Note) -> Principled:
    """Return the nearest to one part of a compound material, with the opacity of the whole."""
    if isinstance(material, Mix):
        note("mixtures of materials: the larger part is written")
        weight = material.weight if isinstance(material.weight, float) else 0.5
        part = nearest(material.second if weight > 0.5 else material.first, note)
    else:
        note("other backs of surfaces")
        part = nearest(material.front, note)
    if material.opacity == 1.0:
        return part
    if part.opacity != 1.0:
        note("opacity within opacity")
    return dataclasses.replace(part, opacity=material.opacity)


def _values(material: Material, note: Note) -> dict[str, Any]:
    """Return the attributes of a Principled."""
    if isinstance(material, (Diffuse, OrenNayar)):
        if isinstance(material, OrenNayar):
            note("the roughness of matt surfaces")
        return {"base_color": material.reflectance, **_MATT}
    if isinstance(material, Emissive):
        return {"base_color": 0.0, **_MATT, "emission": material.radiance}
    if isinstance(material, Unlit):
        note("unlit surfaces: lamps of their colour stand for them")
        return {"base_color": 0.0, **_MATT, "emission": material.color}
    if isinstance(material, Mirror):
        return {"base_color": material.reflectance, "metallic": 1.0, "roughness": 0.0}
    if isinstance(material, Glossy):
        note("glossy materials: GGX stands for their lobe")
        return {"base_color": material.reflectance, "metallic": 1.0, "roughness": 0.3}
    if isinstance(material, (Conductor, RoughConductor)):
        return {"base_color": _metal_color(material, note), "metallic": 1.0, "roughness": _roughness(material, note)}
    if isinstance(material, (Dielectric, RoughDielectric, ThinDielectric)):
        if material.specular_reflectance != (1.0, 1.0, 1.0):
            note("factors of reflected light")
        return {
            "base_color": material.specular_transmittance,
            "transmission": 1.0,
            **_interface(material, note),
            "thin_walled": isinstance(material, ThinDielectric),
        }
    if isinstance(material, (Plastic, RoughPlastic)):
        note("light reflected below the coat of plastics")
        return {"base_color": material.reflectance, **_interface(material, note), "specular": 1.0}
    if isinstance(material, Burley):
        note("Burley's materials: glTF's model stands for them")
        names = ("base_color", "metallic", "roughness", "transmission", "ior", "thin_walled")
        return {name: getattr(material, name) for name in names}
    note(f"materials of the type {material.type_name!r}: grey stands for them")
    return {"base_color": 0.5, **_MATT}


def _interface(material: Any, note: Note) -> dict[str, Any]:
    """Return the refractive index and the roughness of a dielectric."""
    if material.relative_ior < 1.0:
        note("bodies less dense than what is around them")
    return {"ior": max(float(material.relative_ior), 1.0), "roughness": _roughness(material, note)}


def _metal_color(material: Conductor | RoughConductor, note: Note) -> ColorSource:
    """Return the reflectance of a metal at normal incidence."""
    color: ColorSource
    if material.f0 is None:
        note("metals by their refractive index: Schlick's approximation stands for Fresnel's equations")
        index = np.asarray(material.eta, np.float64) + 1j * np.asarray(material.k, np.float64)
        color = vec3(np.abs((index - 1.0) / (index + 1.0)) ** 2)
    else:
        color = material.f0  # type: ignore[assignment]
    factor = getattr(material, "reflectance", (1.0, 1.0, 1.0))
    if factor == (1.0, 1.0, 1.0):
        return color
    for a, b in ((color, factor), (factor, color)):
        if not isinstance(a, VARYING):
            constant = np.broadcast_to(np.asarray(a, np.float64), 3)
            if isinstance(b, VARYING):
                return dataclasses.replace(b, factor=vec3(constant * b.factor))
            return vec3(constant * b)
    note("products of two images")
    return color


def _roughness(material: Any, note: Note) -> ColorSource:
    """Return glTF's roughness, the root of α; 0 of smooth materials."""
    if not hasattr(material, "distribution"):
        return 0.0
    if material.distribution != "ggx":
        note("distributions of facets other than GGX")
    alpha = material.alpha
    if isinstance(alpha, (tuple, list)):
        note("roughness along two directions: its mean is written")
        alpha = math.sqrt(alpha[0] * alpha[1]) if material.distribution != "abc" else 0.1
    if isinstance(alpha, ImageTexture):
        channel = CHANNELS.index(alpha.channel or "r")
        factor = float(np.asarray(alpha.factor)[channel])
        pixels = np.sqrt(np.clip(alpha.pixels * np.float32(factor), 0.0, 1.0))
        return dataclasses.replace(alpha, pixels=pixels, factor=1.0)
    if isinstance(alpha, VertexColor):
        note("numbers by vertex colours")
        return 0.3
    return math.sqrt(min(float(alpha), 1.0))


def color_of(value: ColorSource) -> Vec3:
    """Return a constant colour, or the factor of one that varies."""
    factor = value.factor if isinstance(value, VARYING) else value
    return vec3(np.broadcast_to(np.asarray(factor, np.float64), 3))
