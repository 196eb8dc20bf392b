"""Read Mitsuba's BSDFs as wrt's materials.

A model that contains no other is an entry of _MODELS: the function that makes the material, and how each of its
arguments is read. `twosided`, `mask` and the like are made of other BSDFs.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from wrt.io.mitsuba.coats import as_in_mitsuba, diffuse_fresnel, scaled
from wrt.io.mitsuba.optics import METALS, named_conductor, refractive_index
from wrt.io.mitsuba.plugin import Plugin
from wrt.io.mitsuba.textures import Textures
from wrt.scene.materials import (
    Burley,
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
from wrt.scene.materials.microfacet import LEAST_ALPHA
from wrt.scene.textures import ColorSource, ImageTexture, NormalMap, VertexColor

MASKINGS = {"ggx": "smith-separable", "beckmann": "walter"}  # Mitsuba's masking functions by distribution


@dataclass(frozen=True)
class Surface:
    """A material with Mitsuba's additional properties.

    Attributes:
        material: the material.
        one_sided: whether the back is black.
        is_invisible: whether it is a `null`.
    """

    material: Material
    one_sided: bool = False
    is_invisible: bool = False

    @property
    def both_sides(self) -> Material:
        """The material, with a black back if it is one-sided."""
        material = self.material
        return TwoSided(material, _black_with_holes_of(material), name=material.name) if self.one_sided else material

    @property
    def is_black(self) -> bool:
        """Whether it reflects nothing and is opaque."""
        material = self.material
        return isinstance(material, Diffuse) and material.opacity == 1.0 and material.reflectance == (0.0, 0.0, 0.0)

    def without_back(self) -> Surface:
        """Return the surface with an invisible back, which Mitsuba's curves have."""
        if isinstance(self.material, (Body, Dielectric, RoughDielectric)):
            return self  # light inside must find its way out
        front = self.material.front if isinstance(self.material, TwoSided) else self.material
        return Surface(TwoSided(front, INVISIBLE))


def _black_with_holes_of(material: Material) -> Material:
    """Return a black material that lets light pass where another does: a mask has holes from either side."""
    if isinstance(material, Mix):
        first, second = (_black_with_holes_of(part) for part in material.parts)
        if first != second:
            return dataclasses.replace(material, first=first, second=second)
    return Diffuse(0.0, opacity=material.opacity)


INVISIBLE: Material = Diffuse(0.0, opacity=0.0)  # the material of an invisible surface
CLEAR: Material = ThinDielectric(1.0, 1.0)  # an invisible material that can emit, unlike INVISIBLE
UNKNOWN = Surface(Diffuse(0.5), one_sided=True)  # replaces unknown models, and is the default of shapes without a bsdf
BLACK = Surface(Diffuse(0.0))  # the default of emitting shapes without a bsdf


class Materials:
    """The materials of a scene; one element always gives the same object."""

    def __init__(self, textures: Textures) -> None:
        self.textures = textures
        self._surfaces: dict[Plugin, Surface] = {}

    def surface(self, plugin: Plugin) -> Surface:
        """Return the surface of a `bsdf`."""
        if plugin not in self._surfaces:
            plugin.ignore()
            with plugin.locating():
                made = self._made(plugin)
                material = made.material.named(plugin.element.attributes.get("id", ""))
                self._surfaces[plugin] = dataclasses.replace(made, material=material)
        return self._surfaces[plugin]

    def _made(self, plugin: Plugin) -> Surface:
        if plugin.type == "null":
            return Surface(INVISIBLE, is_invisible=True)
        if plugin.type in ("twosided", "mask", "blendbsdf", "bumpmap", "normalmap"):
            return self._compound(plugin)
        model = _MODELS.get(plugin.type)
        if model is None:
            plugin.warn_of_all("this kind of bsdf is not known; grey stands in for it")
            return UNKNOWN
        if model.is_polarized:
            plugin.warn("polarisation is not simulated: as for unpolarised light")
        elif plugin.type == "roughdiffuse":
            plugin.warn("taken as plain diffuse")
        arguments = {name: read(plugin, self.textures) for name, read in model.arguments.items()}
        if model.is_rough:
            arguments |= _facets(plugin, self.textures)
        plugin.ignore(*model.ignored)
        # Light goes through a principled material with `spec_trans`.
        one_sided = model.one_sided and not plugin.has("spec_trans")
        return Surface(model.make(**arguments), one_sided)

    def _compound(self, plugin: Plugin) -> Surface:
        """Return the surface of a `bsdf` that is made of others."""
        parts = [self.surface(part) for part in plugin.of_kind("bsdf")]
        least, most = {"twosided": (1, 2), "blendbsdf": (2, 2)}.get(plugin.type, (1, 1))
        if not least <= len(parts) <= most:
            raise plugin.error(f"takes {least if least == most else f'{least} or {most}'} bsdf, not {len(parts)}")
        first, second = parts[0], parts[-1]
        if plugin.type == "twosided":
            same = first.material == second.material
            return Surface(first.material if same else TwoSided(first.material, second.material))
        if plugin.type == "blendbsdf":
            weight = self.textures.number(plugin, "weight", 0.5)
            if first.one_sided and second.one_sided:
                return Surface(Mix(first.material, second.material, weight=weight), one_sided=True)
            return Surface(Mix(first.both_sides, second.both_sides, weight=weight))
        if plugin.type == "mask":
            opacity = self.textures.number(plugin, "opacity", 0.5)
            if first.material.opacity == 1.0:
                return dataclasses.replace(first, material=dataclasses.replace(first.material, opacity=opacity))
            return dataclasses.replace(first, material=Mix(INVISIBLE, first.material, weight=opacity))
        normals = self.textures.normals(plugin)
        if normals is None:
            return first
        return dataclasses.replace(first, material=_with_normals(plugin, first.material, normals))


def _with_normals(plugin: Plugin, material: Material, normals: NormalMap) -> Material:
    """Return a material with a normal map, set on each part of a compound material."""
    for kind, names in ((Mix, ("first", "second")), (TwoSided, ("front", "back"))):
        if isinstance(material, kind):
            parts: Any = {name: _with_normals(plugin, getattr(material, name), normals) for name in names}
            return dataclasses.replace(material, **parts)
    if material.normal_map is not None:
        plugin.warn("a bump or normal map within another is left out")
        return material
    return dataclasses.replace(material, normal_map=normals)


# --- Arguments of models ---------------------------------------------------------------------------

Reader = Callable[[Plugin, Textures], Any]  # reads one argument of a material from a plugin


def _color(name: str, default: float, *, old_name: str = "") -> Reader:
    return lambda plugin, textures: textures.color(plugin, old_name if plugin.has(old_name) else name, default)


def _number(name: str, default: float = 0.0, *, most: float = 1.0) -> Reader:
    return lambda plugin, textures: textures.number(plugin, name, default, most=most)


def _index(name: str, default: str) -> Reader:
    return lambda plugin, textures: refractive_index(plugin, name, default)


def _principled_index(plugin: Plugin, textures: Textures) -> float:
    """Return the refractive index from `eta`, or from `specular`, where 0 to 1 is a reflectance of 0 to 0.08."""
    if plugin.named("eta") is not None:
        plugin.warn("'eta' cannot vary here; it is 1.5")
        return 1.5
    if plugin.has("eta"):
        return max(plugin.number("eta", 1.5), 1.0)
    specular = min(max(plugin.number("specular", 0.5), 0.0), 1.0)
    return 2.0 / (1.0 - math.sqrt(0.08 * specular)) - 1.0


def _optics(plugin: Plugin, textures: Textures) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
    """Return η and k of a metal; None for a perfect mirror."""
    if plugin.has("eta") or plugin.has("k"):
        if plugin.has("material"):
            raise plugin.error("a metal is given by 'material' or by 'eta' and 'k', not both")
        eta, k = (textures.constant(plugin, name, value) for name, value in (("eta", 0.0), ("k", 1.0)))
        around = refractive_index(plugin, "ext_eta", "vacuum")
        if not any(eta) and all(x == 1.0 for x in k):
            return None
        return tuple(max(x / around, 1e-4) for x in eta), tuple(max(x / around, 0.0) for x in k)
    name = plugin.text("material", "none")
    if name.lower() == "none":
        return None
    optics = named_conductor(name)
    if optics is None:
        plugin.warn(f"the index of {name!r} is not known; aluminium stands in for it")
    eta, k = optics or METALS["al"]
    return tuple(max(x, 1e-4) for x in eta), k


def _facets(plugin: Plugin, textures: Textures) -> dict[str, Any]:
    """Return the roughness, the distribution and the masking of a rough model."""
    plugin.ignore("sample_visible")
    distribution = plugin.text("distribution", "beckmann").lower()
    if distribution not in MASKINGS:
        plugin.warn(f"the distribution {distribution!r} is not known here; 'beckmann' stands in for it")
        distribution = "beckmann"
    names = ("alpha_u", "alpha_v") if plugin.has("alpha_u") or plugin.has("alpha_v") else ("alpha", "alpha")
    along_u, along_v = (textures.number(plugin, name, 0.1, least=LEAST_ALPHA) for name in names)
    alpha: Any = along_u
    if isinstance(along_u, float) and isinstance(along_v, float):
        alpha = along_u if along_u == along_v else (along_u, along_v)
    elif names[0] != names[1]:
        alpha = _two_channels(plugin, along_u, along_v)
    return {"alpha": alpha, "distribution": distribution, "masking": MASKINGS[distribution]}


def _two_channels(plugin: Plugin, along_u: ColorSource, along_v: ColorSource) -> ColorSource:
    """Return an image with the roughness along u in red and that along v in green."""
    images = [value for value in (along_u, along_v) if isinstance(value, ImageTexture)]
    placements = {
        (image.pixels.shape, *np.round(image.placement, 6).flat, image.wrap, image.filter) for image in images
    }
    if any(isinstance(value, VertexColor) for value in (along_u, along_v)) or len(placements) != 1:
        plugin.warn("'alpha_u' and 'alpha_v' are mapped differently; 'alpha_u' is used for both")
        return along_u
    channels: list[Any] = [
        value.pixels[..., 0] if isinstance(value, ImageTexture) else value for value in (along_u, along_v)
    ]
    red, green = np.broadcast_arrays(*channels)
    pixels = np.stack([red, green, np.zeros_like(red)], axis=-1).astype(np.float32)
    return dataclasses.replace(images[0], pixels=pixels)


# --- Models ----------------------------------------------------------------------------------------


def _conductor(optics: tuple[tuple[float, ...], tuple[float, ...]] | None, tint: ColorSource) -> Material:
    if optics is None:
        return Mirror(tint)
    if not isinstance(tint, (ImageTexture, VertexColor)) and np.all(np.asarray(tint) == 1.0):
        return Conductor(*optics)
    # Only rough metals have a tint; at the least roughness they are mirrors.
    return RoughConductor(LEAST_ALPHA, *optics, reflectance=tint)


def _rough_conductor(optics: Any, tint: ColorSource, **facets: Any) -> Material:
    if optics is None:
        return RoughConductor(f0=1.0, reflectance=tint, **facets)
    return RoughConductor(eta=optics[0], k=optics[1], reflectance=tint, **facets)


def _rough_plastic(**arguments: Any) -> Material:
    eta = arguments["ior"] / arguments["exterior_ior"]
    arguments["reflectance"] = as_in_mitsuba(
        arguments["reflectance"], arguments["alpha"], arguments["distribution"], eta, nonlinear=arguments["nonlinear"]
    )
    return RoughPlastic(**arguments, multiple_bounces=False)


def _polarized_plastic(**arguments: Any) -> Material:
    # Light from the base leaves at once or never, whereas in a RoughPlastic it is reflected to and fro, which
    # divides its share by that of diffuse light that enters the coat.
    share = 1.0 - diffuse_fresnel(arguments["ior"] / arguments["exterior_ior"])
    arguments["reflectance"] = scaled(arguments["reflectance"], share)
    return RoughPlastic(**arguments, multiple_bounces=False)


def _filter(share: float) -> Callable[..., Material]:
    """Return what makes a pane that bends nothing, and lets this share of unpolarised light pass."""
    return lambda tint: ThinDielectric(1.0, 1.0, specular_transmittance=scaled(tint, share))


def _principled_thin(diffuse_transmission: ColorSource, **arguments: Any) -> Material:
    """Return a `principledthin`, whose `diff_trans` is 2 where all light passes."""
    is_constant = isinstance(diffuse_transmission, float)
    half = 0.5 * diffuse_transmission if is_constant else scaled(diffuse_transmission, 0.5)  # type: ignore[operator]
    return Burley(**arguments, thin_walled=True, diffuse_transmission=half)


@dataclass(frozen=True)
class _Model:
    """A model that contains no other.

    Attributes:
        make: returns the material.
        arguments: how its arguments are read, but those of facets.
        one_sided: whether its back is black.
        is_rough: whether it has facets.
        is_polarized: whether Mitsuba simulates polarisation with it.
        ignored: parameters that do not affect the picture.
    """

    make: Callable[..., Material]
    arguments: Mapping[str, Reader]
    one_sided: bool = True
    is_rough: bool = False
    is_polarized: bool = False
    ignored: tuple[str, ...] = ()


_METAL: dict[str, Reader] = {"optics": _optics, "tint": _color("specular_reflectance", 1.0)}
_BOUNDARY = {
    "ior": _index("int_ior", "bk7"),
    "exterior_ior": _index("ext_ior", "air"),
    "specular_reflectance": _color("specular_reflectance", 1.0),
    "specular_transmittance": _color("specular_transmittance", 1.0),
}
_COAT: dict[str, Reader] = {
    "reflectance": _color("diffuse_reflectance", 0.5),
    "ior": _index("int_ior", "polypropylene"),
    "exterior_ior": _index("ext_ior", "air"),
    "nonlinear": lambda plugin, textures: plugin.boolean("nonlinear", False),
    "specular_reflectance": _color("specular_reflectance", 1.0),
}
_PRINCIPLED: dict[str, Reader] = {
    "base_color": _color("base_color", 0.5),
    "ior": _principled_index,
    "roughness": _number("roughness", 0.5),
    "anisotropy": _number("anisotropic"),
    "transmission": _number("spec_trans"),
    "specular_tint": _number("spec_tint"),
    "sheen": _number("sheen"),
    "sheen_tint": _number("sheen_tint"),
    "flatness": _number("flatness"),
}
_LAYERS = {
    "metallic": _number("metallic"),
    "coat": _number("clearcoat"),
    "coat_gloss": _number("clearcoat_gloss"),
}
_SAMPLING_RATES = tuple(
    f"{lobe}_sampling_rate"
    for lobe in (
        *("diffuse_reflectance", "specular_reflectance", "main_specular", "clearcoat", "spec_reflectance"),
        *("spec_trans", "diff_trans"),
    )
)
_FILTER: dict[str, Any] = {
    "arguments": {"tint": _color("transmittance", 1.0)},
    "one_sided": False,
    "is_polarized": True,
    "ignored": ("theta", "delta", "left_handed", "polarizing"),
}

_MODELS = {
    "diffuse": _Model(Diffuse, {"reflectance": _color("reflectance", 0.5)}),
    "roughdiffuse": _Model(
        Diffuse,
        {"reflectance": _color("reflectance", 0.5, old_name="diffuse_reflectance")},
        ignored=("alpha", "use_fast_approx"),
    ),
    "conductor": _Model(_conductor, _METAL),
    "roughconductor": _Model(_rough_conductor, _METAL, is_rough=True),
    "dielectric": _Model(Dielectric, _BOUNDARY, one_sided=False),
    "thindielectric": _Model(ThinDielectric, _BOUNDARY, one_sided=False),
    "roughdielectric": _Model(RoughDielectric, _BOUNDARY, one_sided=False, is_rough=True),
    "plastic": _Model(Plastic, _COAT),
    "roughplastic": _Model(_rough_plastic, _COAT, is_rough=True),
    "pplastic": _Model(_polarized_plastic, _COAT, is_rough=True, is_polarized=True),
    "measured": _Model(Measured, {"measurement": lambda plugin, textures: textures.measurement(plugin.file())}),
    "principled": _Model(Burley, {**_PRINCIPLED, **_LAYERS}, ignored=_SAMPLING_RATES),
    "principledthin": _Model(
        _principled_thin,
        {**_PRINCIPLED, "diffuse_transmission": _number("diff_trans", most=2.0)},
        one_sided=False,
        ignored=_SAMPLING_RATES,
    ),
    "polarizer": _Model(_filter(0.5), **_FILTER),
    "circular": _Model(_filter(0.5), **_FILTER),
    "retarder": _Model(_filter(1.0), **_FILTER),
}
