"""Media: what fills bodies, and the space around them."""

from __future__ import annotations

import dataclasses

from wrt.errors import InputError
from wrt.formats.mitsuba.plugin import Plugin
from wrt.formats.mitsuba.textures import Textures
from wrt.materials import Material
from wrt.materials.body import Body, Null
from wrt.medium import Medium


def medium_of(plugin: Plugin, textures: Textures) -> Medium | None:
    """Return a `homogeneous` medium; None, with a warning, where it is another.

    Raises:
        InputError: where its numbers cannot be used.
    """
    if plugin.type != "homogeneous":
        plugin.warn("only homogeneous media are supported; left out")
        return None
    for name in ("sigma_t", "albedo", "sigma_s", "sigma_a"):
        if any(
            given == name and each.kind == "volume" and each.type != "constvolume" for given, each in plugin.objects
        ):
            plugin.warn(f"{name!r} cannot vary in a medium; left out")
            return None
    scale = plugin.number("scale", 1.0)
    if plugin.has("sigma_s") or plugin.has("sigma_a"):  # as in Mitsuba 0.x
        scattering, absorption = (_color(plugin, textures, name, 0.0) for name in ("sigma_s", "sigma_a"))
    else:
        extinction, albedo = _color(plugin, textures, "sigma_t", 1.0), _color(plugin, textures, "albedo", 0.75)
        scattering = tuple(a * t for a, t in zip(albedo, extinction, strict=True))
        absorption = tuple((1.0 - a) * t for a, t in zip(albedo, extinction, strict=True))
    mean_cosine = 0.0
    phase = plugin.only("phase")
    if phase is not None:
        if phase.type == "hg":
            mean_cosine = phase.number("g", 0.8)
        elif phase.type != "isotropic":
            phase.warn("this phase function is not known; 'isotropic' stands in for it")
            phase.ignore_all()
        phase.finish()
    plugin.ignore("has_spectral_extinction", "sample_emitters", "material")
    plugin.finish()
    try:
        return Medium(tuple(scale * x for x in absorption), tuple(scale * x for x in scattering), mean_cosine)
    except InputError as error:
        raise plugin.placed(error) from None


def _color(plugin: Plugin, textures: Textures, name: str, default: float) -> tuple[float, ...]:
    volume = plugin.named(name)
    if volume is not None and volume.kind == "volume":
        result = textures.constant(volume, "value", default)
        volume.finish()
        return result
    return textures.constant(plugin, name, default)


def filled(shape: Plugin, material: Material, medium: Medium) -> Material:
    """Return a material of a boundary with a medium behind it; the material itself where it bounds no body."""
    if isinstance(material, Body):
        return dataclasses.replace(material, interior=medium)
    shape.warn("its 'interior' is left out: light enters only dielectric, roughdielectric and null")
    return material


def boundary_of_nothing(medium: Medium) -> Material:
    """Return what bounds a medium and does nothing to light itself."""
    return Null(interior=medium)
