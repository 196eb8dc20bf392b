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
)
from wrt.scene.textures import CHANNELS, ColorSource, ImageTexture, VertexColor
from wrt.values import Vec3, vec3

Note = Callable[[str], None]
"""Called with what glTF cannot hold, in words."""


def nearest(material: Material, note: Note) -> Principled:
    """Return the nearest Principled with the material's opacity and normals."""
    if isinstance(material, Principled):
        if material.multiple_bounces:
            note("further bounces between facets")
        return material
    if isinstance(material, Mix):
        note("mixtures of materials: the larger part is written")
        weight = material.weight if isinstance(material.weight, float) else 0.5
        return _covered(nearest(material.second if weight > 0.5 else material.first, note), material, note)
    if isinstance(material, TwoSided):
        note("other backs of surfaces")
        return _covered(nearest(material.front, note), material, note)
    values = _values(material, note)
    inside = {
        name: getattr(material, name) for name in ("interior", "priority", "dispersion") if hasattr(material, name)
    }
    if not (values.get("transmission") and not values.get("thin_walled", False)):
        inside = {}
    return Principled(**values, **inside, opacity=material.opacity, normal_map=material.normal_map)


def _covered(inner: Principled, outer: Material, note: Note) -> Principled:
    """Return a part of a compound material with the opacity of the whole."""
    if outer.opacity == 1.0:
        return inner
    if inner.opacity != 1.0:
        note("opacity within opacity")
    return dataclasses.replace(inner, opacity=outer.opacity)


def _values(material: Material, note: Note) -> dict[str, Any]:
    """Return the attributes of a Principled."""
    matt = {"roughness": 1.0, "specular": 0.0}
    if isinstance(material, OrenNayar):
        note("the roughness of matt surfaces")
    if isinstance(material, (Diffuse, OrenNayar)):
        return {"base_color": material.reflectance, **matt}
    if isinstance(material, Emissive):
        return {"base_color": 0.0, **matt, "emission": material.radiance}
    if isinstance(material, Mirror):
        return {"base_color": material.reflectance, "metallic": 1.0, "roughness": 0.0}
    if isinstance(material, Glossy):
        note("glossy materials: GGX stands for their lobe")
        return {"base_color": material.reflectance, "metallic": 1.0, "roughness": 0.3}
    if isinstance(material, (Conductor, RoughConductor)):
        return _metal(material, note)
    if isinstance(material, (Dielectric, RoughDielectric, ThinDielectric)):
        if material.specular_reflectance != (1.0, 1.0, 1.0):
            note("factors of reflected light")
        roughness = _roughness(material, note) if isinstance(material, RoughDielectric) else 0.0
        return {
            "base_color": material.specular_transmittance,
            "transmission": 1.0,
            "ior": _index(material.relative_ior, note),
            "roughness": roughness,
            "thin_walled": isinstance(material, ThinDielectric),
        }
    if isinstance(material, (Plastic, RoughPlastic)):
        note("light reflected below the coat of plastics")
        roughness = _roughness(material, note) if isinstance(material, RoughPlastic) else 0.0
        return {
            "base_color": material.reflectance,
            "ior": _index(material.relative_ior, note),
            "roughness": roughness,
            "specular": 1.0,
        }
    if isinstance(material, Burley):
        note("Burley's materials: glTF's model stands for them")
        names = ("base_color", "metallic", "roughness", "transmission", "ior", "thin_walled")
        return {name: getattr(material, name) for name in names}
    note(f"materials of the type {material.type_name!r}: grey stands for them")
    return {"base_color": 0.5, **matt}


def _index(ior: float, note: Note) -> float:
    if ior < 1.0:
        note("bodies less dense than what is around them")
    return max(float(ior), 1.0)


def _metal(material: Conductor | RoughConductor, note: Note) -> dict[str, Any]:
    """Return a metal by its reflectance straight on."""
    base: ColorSource
    if material.f0 is None:
        note("metals by their refractive index: Schlick's approximation stands for Fresnel's equations")
        index = np.asarray(material.eta, np.float64) + 1j * np.asarray(material.k, np.float64)
        base = vec3(np.abs((index - 1.0) / (index + 1.0)) ** 2)
    else:
        base = material.f0  # type: ignore[assignment]
    factor = getattr(material, "reflectance", (1.0, 1.0, 1.0))
    if factor != (1.0, 1.0, 1.0):
        base = _product(base, factor, note)
    roughness = _roughness(material, note) if isinstance(material, RoughConductor) else 0.0
    return {"base_color": base, "metallic": 1.0, "roughness": roughness}


def _product(base: ColorSource, factor: ColorSource, note: Note) -> ColorSource:
    """Return a product of which one at least is constant."""
    for a, b in ((base, factor), (factor, base)):
        if not isinstance(a, (ImageTexture, VertexColor)):
            constant = np.broadcast_to(np.asarray(a, np.float64), 3)
            if isinstance(b, (ImageTexture, VertexColor)):
                return dataclasses.replace(b, factor=vec3(constant * b.factor))
            return vec3(constant * b)
    note("products of two images")
    return base


def _roughness(material: Any, note: Note) -> ColorSource:
    """Return glTF's roughness, the root of α."""
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
    factor = value.factor if isinstance(value, (ImageTexture, VertexColor)) else value
    return vec3(np.broadcast_to(np.asarray(factor, np.float64), 3))
