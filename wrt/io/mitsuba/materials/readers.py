"""Read Mitsuba's `bsdf` plugins as wrt's materials."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wrt.errors import InputError
from wrt.io.measured.measurement import load_measurement
from wrt.io.mitsuba.materials.bumps import with_bumps
from wrt.io.mitsuba.materials.coats import as_in_mitsuba, diffuse_fresnel, scaled
from wrt.io.mitsuba.materials.indices import refractive_index
from wrt.io.mitsuba.materials.metals import named_conductor
from wrt.io.mitsuba.materials.textures import Textures
from wrt.io.mitsuba.plugin import Plugin
from wrt.scene.materials import (
    Conductor,
    Dielectric,
    Diffuse,
    Material,
    Measured,
    Mirror,
    Mix,
    Plastic,
    RoughConductor,
    RoughDielectric,
    RoughPlastic,
    ThinDielectric,
    TwoSided,
)
from wrt.scene.materials.body import Body
from wrt.scene.materials.measured import Measurement
from wrt.scene.materials.microfacet import LEAST_ALPHA
from wrt.scene.textures import ColorSource, ImageTexture, VertexColor

FILTERS = {"polarizer": 0.5, "circular": 0.5, "retarder": 1.0}
"""Share of unpolarised light that passes."""

MASKINGS = {"ggx": "smith-separable", "beckmann": "walter"}
"""Mitsuba's masking functions by distribution."""


@dataclass(frozen=True)
class Surface:
    """A material with Mitsuba's additional properties.

    Attributes:
        material: the material.
        one_sided: whether the back is black.
        nothing: whether the surface is invisible, a `null`.
    """

    material: Material
    one_sided: bool = False
    nothing: bool = False

    @property
    def both_sides(self) -> Material:
        """The material, with a black back if it is one-sided."""
        return TwoSided(self.material, _black_with_holes_of(self.material)) if self.one_sided else self.material

    def without_back(self) -> Surface:
        """Return the surface as one that is there from its front only, as Mitsuba's curves are."""
        if isinstance(self.material, (Body, Dielectric, RoughDielectric)):
            return self  # light that is within must find its way out
        front = self.material.front if isinstance(self.material, TwoSided) else self.material
        return Surface(TwoSided(front, nothing()))


def _black_with_holes_of(material: Material) -> Material:
    """Return a black material that lets light pass where another does: a mask has holes from either side."""
    if isinstance(material, Mix):
        first, second = (_black_with_holes_of(part) for part in material.parts)
        if first != second:
            return dataclasses.replace(material, first=first, second=second)
    return Diffuse(0.0, opacity=material.opacity)


UNKNOWN = Surface(Diffuse(0.5), one_sided=True)
"""Replaces unknown models, and is the default of shapes without a bsdf."""

BLACK = Surface(Diffuse(0.0))
"""The default of emitting shapes without a bsdf."""


class Materials:
    """The materials of a scene; one element always gives the same object."""

    def __init__(self, textures: Textures) -> None:
        self.textures = textures
        self._made: dict[int, Surface] = {}
        self._measurements: dict[Path, Measurement] = {}

    def surface(self, plugin: Plugin) -> Surface:
        """Return the surface of a `bsdf`.

        Raises:
            InputError: naming file and line, when a value in it cannot be used.
        """
        key = id(plugin.element)
        if key not in self._made:
            try:
                self._made[key] = self._make(plugin)
            except InputError as error:
                raise plugin.placed(error) from None
            plugin.finish()
        return self._made[key]

    def _make(self, plugin: Plugin) -> Surface:
        if plugin.type in _MAKERS:
            return _MAKERS[plugin.type](self, plugin)
        if plugin.type == "twosided":
            return self._two_sided(plugin)
        if plugin.type == "mask":
            inner = self._inner(plugin)
            opacity = self.textures.number(plugin, "opacity", 0.5)
            if inner.material.opacity == 1.0:
                return dataclasses.replace(inner, material=dataclasses.replace(inner.material, opacity=opacity))
            return dataclasses.replace(inner, material=Mix(nothing(), inner.material, weight=opacity))
        if plugin.type == "blendbsdf":
            return self._blend(plugin)
        if plugin.type in ("bumpmap", "normalmap"):
            inner = self._inner(plugin)
            return dataclasses.replace(inner, material=with_bumps(plugin, inner.material, self.textures))
        if plugin.type == "null":
            return Surface(nothing(), nothing=True)
        if plugin.type in FILTERS:
            return self._filter(plugin)
        if plugin.type == "measured_polarized":
            plugin.warn("tables of Mueller matrices are not read; grey stands in for it")
            plugin.ignore_all()
            return UNKNOWN
        plugin.warn("this kind of bsdf is not known; grey stands in for it")
        plugin.ignore_all()
        return UNKNOWN

    def _parts(self, plugin: Plugin) -> list[Surface]:
        return [self.surface(inner) for inner in plugin.of_kind("bsdf")]

    def _inner(self, plugin: Plugin) -> Surface:
        parts = self._parts(plugin)
        if len(parts) != 1:
            raise plugin.error(f"takes one bsdf, not {len(parts)}")
        return parts[0]

    def _two_sided(self, plugin: Plugin) -> Surface:
        parts = self._parts(plugin)
        if len(parts) not in (1, 2):
            raise plugin.error(f"takes one bsdf or two, not {len(parts)}")
        if len(parts) == 1 or parts[0].material == parts[1].material:
            return Surface(parts[0].material)
        return Surface(TwoSided(parts[0].material, parts[1].material))

    def _blend(self, plugin: Plugin) -> Surface:
        parts = self._parts(plugin)
        if len(parts) != 2:
            raise plugin.error(f"takes two bsdfs, not {len(parts)}")
        weight = self.textures.number(plugin, "weight", 0.5)
        first, second = parts
        if first.one_sided and second.one_sided:
            return Surface(Mix(first.material, second.material, weight=weight), one_sided=True)
        return Surface(Mix(first.both_sides, second.both_sides, weight=weight))

    # --- Models that contain no other models -----------------------------------------------------

    def _diffuse(self, plugin: Plugin) -> Surface:
        return Surface(Diffuse(self.textures.color(plugin, "reflectance", 0.5)), one_sided=True)

    def _rough_diffuse(self, plugin: Plugin) -> Surface:
        plugin.warn("taken as plain diffuse")
        plugin.ignore("alpha", "use_fast_approx")
        name = "diffuse_reflectance" if plugin.has("diffuse_reflectance") else "reflectance"
        return Surface(Diffuse(self.textures.color(plugin, name, 0.5)), one_sided=True)

    def _conductor(self, plugin: Plugin) -> Surface:
        optics = self._optics(plugin)
        tint = self.textures.color(plugin, "specular_reflectance", 1.0)
        if optics is None:
            return Surface(Mirror(tint), one_sided=True)
        if not _is_white(tint):
            # Only rough metals have a tint; at the least roughness they are mirrors.
            return Surface(RoughConductor(LEAST_ALPHA, *optics, reflectance=tint), one_sided=True)
        return Surface(Conductor(*optics), one_sided=True)

    def _rough_conductor(self, plugin: Plugin) -> Surface:
        optics = self._optics(plugin)
        tint = self.textures.color(plugin, "specular_reflectance", 1.0)
        alpha, distribution = self._facets(plugin)
        common: dict[str, Any] = {"distribution": distribution, "masking": MASKINGS[distribution], "reflectance": tint}
        if optics is None:
            return Surface(RoughConductor(alpha, f0=1.0, **common), one_sided=True)
        return Surface(RoughConductor(alpha, *optics, **common), one_sided=True)

    def _optics(self, plugin: Plugin) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
        """Return η and k of a metal; None for a perfect mirror."""
        if plugin.has("eta") or plugin.has("k"):
            if plugin.has("material"):
                raise plugin.error("a metal is given by 'material' or by 'eta' and 'k', not both")
            eta, k = (self.textures.constant(plugin, name, value) for name, value in (("eta", 0.0), ("k", 1.0)))
            around = refractive_index(plugin, "ext_eta", 1.0)
            if not any(eta) and all(x == 1.0 for x in k):
                return None
            return tuple(max(x / around, 1e-4) for x in eta), tuple(max(x / around, 0.0) for x in k)
        name = plugin.text("material", "none")
        if name.lower() == "none":
            return None
        optics = named_conductor(name)
        if optics is None:
            plugin.warn(f"the index of {name!r} is not known; aluminium stands in for it")
            optics = named_conductor("Al")
        assert optics is not None
        eta, k = optics
        return tuple(max(x, 1e-4) for x in eta), k

    def _facets(self, plugin: Plugin) -> tuple[ColorSource, str]:
        """Return the roughness and the distribution."""
        plugin.ignore("sample_visible")
        distribution = plugin.text("distribution", "beckmann").lower()
        if distribution not in MASKINGS:
            plugin.warn(f"the distribution {distribution!r} is not known here; 'beckmann' stands in for it")
            distribution = "beckmann"

        def read(name: str) -> ColorSource:
            return self.textures.number(plugin, name, 0.1, least=LEAST_ALPHA)

        if not (plugin.has("alpha_u") or plugin.has("alpha_v")):
            return read("alpha"), distribution
        along_u, along_v = read("alpha_u"), read("alpha_v")
        if isinstance(along_u, float) and isinstance(along_v, float):
            return (along_u, along_v) if along_u != along_v else along_u, distribution
        return _two_channels(plugin, along_u, along_v), distribution

    def _boundary(self, plugin: Plugin) -> dict[str, Any]:
        return {
            "ior": refractive_index(plugin, "int_ior", "bk7"),
            "exterior_ior": refractive_index(plugin, "ext_ior", "air"),
            "specular_reflectance": self.textures.color(plugin, "specular_reflectance", 1.0),
            "specular_transmittance": self.textures.color(plugin, "specular_transmittance", 1.0),
        }

    def _dielectric(self, plugin: Plugin) -> Surface:
        return Surface(Dielectric(**self._boundary(plugin)))

    def _thin_dielectric(self, plugin: Plugin) -> Surface:
        return Surface(ThinDielectric(**self._boundary(plugin)))

    def _rough_dielectric(self, plugin: Plugin) -> Surface:
        alpha, distribution = self._facets(plugin)
        facets: dict[str, Any] = {"alpha": alpha, "distribution": distribution, "masking": MASKINGS[distribution]}
        return Surface(RoughDielectric(**self._boundary(plugin), **facets))

    def _coat(self, plugin: Plugin) -> dict[str, Any]:
        return {
            "reflectance": self.textures.color(plugin, "diffuse_reflectance", 0.5),
            "ior": refractive_index(plugin, "int_ior", "polypropylene"),
            "exterior_ior": refractive_index(plugin, "ext_ior", "air"),
            "nonlinear": plugin.boolean("nonlinear", False),
            "specular_reflectance": self.textures.color(plugin, "specular_reflectance", 1.0),
        }

    def _plastic(self, plugin: Plugin) -> Surface:
        return Surface(Plastic(**self._coat(plugin)), one_sided=True)

    def _rough_plastic(self, plugin: Plugin) -> Surface:
        alpha, distribution = self._facets(plugin)
        facets: dict[str, Any] = {"alpha": alpha, "distribution": distribution, "masking": MASKINGS[distribution]}
        coat = self._coat(plugin)
        eta = coat["ior"] / coat["exterior_ior"]
        coat["reflectance"] = as_in_mitsuba(coat["reflectance"], alpha, distribution, eta, nonlinear=coat["nonlinear"])
        return Surface(RoughPlastic(**coat, **facets, multiple_bounces=False), one_sided=True)

    def _polarized_plastic(self, plugin: Plugin) -> Surface:
        """Return a `pplastic` as the rough plastic that reflects as much of unpolarised light."""
        plugin.warn("polarisation is not simulated: as for unpolarised light")
        alpha, distribution = self._facets(plugin)
        facets: dict[str, Any] = {"alpha": alpha, "distribution": distribution, "masking": MASKINGS[distribution]}
        coat = self._coat(plugin)
        # Light from the base leaves at once or never, whereas in a RoughPlastic it is reflected to and fro, which
        # divides its share by that of diffuse light that enters the coat.
        coat["reflectance"] = scaled(coat["reflectance"], 1.0 - diffuse_fresnel(coat["ior"] / coat["exterior_ior"]))
        return Surface(RoughPlastic(**coat, **facets, multiple_bounces=False), one_sided=True)

    def _filter(self, plugin: Plugin) -> Surface:
        """Return a polarising filter or a retarder as a pane that bends nothing."""
        plugin.warn("polarisation is not simulated: as for unpolarised light")
        plugin.ignore("theta", "delta", "left_handed", "polarizing")
        share = FILTERS[plugin.type]
        tint = scaled(self.textures.color(plugin, "transmittance", 1.0), share)
        return Surface(ThinDielectric(1.0, 1.0, specular_transmittance=tint))

    def _measured(self, plugin: Plugin) -> Surface:
        file = plugin.file()
        if file not in self._measurements:
            self._measurements[file] = load_measurement(file)
        return Surface(Measured(self._measurements[file]), one_sided=True)

    def _principled(self, plugin: Plugin) -> Surface:
        from wrt.io.mitsuba.materials.principled import principled

        return Surface(principled(plugin, self.textures), one_sided=not plugin.has("spec_trans"))

    def _principled_thin(self, plugin: Plugin) -> Surface:
        from wrt.io.mitsuba.materials.principled import principled_thin

        return Surface(principled_thin(plugin, self.textures))


_MAKERS: dict[str, Callable[[Materials, Plugin], Surface]] = {
    "diffuse": Materials._diffuse,
    "roughdiffuse": Materials._rough_diffuse,
    "conductor": Materials._conductor,
    "roughconductor": Materials._rough_conductor,
    "dielectric": Materials._dielectric,
    "thindielectric": Materials._thin_dielectric,
    "roughdielectric": Materials._rough_dielectric,
    "plastic": Materials._plastic,
    "roughplastic": Materials._rough_plastic,
    "pplastic": Materials._polarized_plastic,
    "measured": Materials._measured,
    "principled": Materials._principled,
    "principledthin": Materials._principled_thin,
}


def nothing() -> Material:
    """Return the material of an invisible surface."""
    return Diffuse(0.0, opacity=0.0)


def clear() -> Material:
    """Return an invisible material that can emit, unlike one with opacity 0."""
    return ThinDielectric(1.0, 1.0)


def _is_white(value: ColorSource) -> bool:
    return not isinstance(value, (ImageTexture, VertexColor)) and bool(np.all(np.asarray(value) == 1.0))


def _two_channels(plugin: Plugin, along_u: ColorSource, along_v: ColorSource) -> ColorSource:
    """Return an image with the roughness along u in red and that along v in green."""
    images = [value for value in (along_u, along_v) if isinstance(value, ImageTexture)]
    if any(isinstance(value, VertexColor) for value in (along_u, along_v)) or not _alike(images):
        plugin.warn("'alpha_u' and 'alpha_v' are mapped differently; 'alpha_u' is used for both")
        return along_u
    size = images[0].pixels.shape[:2]

    def channel(value: ColorSource) -> np.ndarray:
        if isinstance(value, ImageTexture):
            return value.pixels[..., 0]
        return np.full(size, value, np.float32)

    first, second = channel(along_u), channel(along_v)
    return dataclasses.replace(images[0], pixels=np.stack([first, second, np.zeros_like(first)], axis=-1))


def _alike(images: list[ImageTexture]) -> bool:
    """Return whether images have the same size, placement, wrapping and filter."""
    first = images[0]
    return all(
        image.pixels.shape == first.pixels.shape
        and np.allclose(image.placement, first.placement)
        and (image.wrap, image.filter) == (first.wrap, first.filter)
        for image in images
    )


def is_black(surface: Surface) -> bool:
    """Return whether a surface reflects nothing and is opaque."""
    material = surface.material
    if not isinstance(material, Diffuse) or material.opacity != 1.0:
        return False
    return isinstance(material.reflectance, tuple) and not any(material.reflectance)


__all__ = ["BLACK", "UNKNOWN", "Materials", "Surface", "clear", "is_black", "nothing"]
