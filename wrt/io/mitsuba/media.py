"""Read Mitsuba's media, inside shapes and around them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Iterable

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.io.mitsuba.materials.textures import Textures
from wrt.io.mitsuba.plugin import Plugin
from wrt.scene.materials import Material
from wrt.scene.materials.body import Body, Null
from wrt.scene.medium import Medium
from wrt.scene.mesh import Mesh
from wrt.scene.scene import Scene


def medium_of(plugin: Plugin, textures: Textures) -> Medium | None:
    """Return a `homogeneous` medium; for others warn and return None.

    Raises:
        InputError: when its numbers cannot be used.
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
    """Return a material with a medium behind it, or warn and return it unchanged if light cannot enter."""
    if isinstance(material, Body):
        return dataclasses.replace(material, interior=medium)
    shape.warn("its 'interior' is left out: light enters only dielectric, roughdielectric and null")
    return material


def boundary_of_nothing(medium: Medium) -> Material:
    """Return the invisible boundary of a medium."""
    return Null(interior=medium)


def surrounding(
    scene: Scene, seen_from: Medium | None, exteriors: Iterable[tuple[Plugin, Medium]], interiors: Collection[Medium]
) -> Medium | None:
    """Return the medium outside all shapes, or None.

    It is the sensor's medium, unless the camera is inside a shape that this medium fills. Otherwise it is the first
    `exterior` that is not also an `interior`: such an `exterior` belongs to a shape inside another shape and does not
    reach outside. Media with equal values count as one.

    Args:
        scene: the shapes and the camera.
        seen_from: the medium of the sensor.
        exteriors: the `exterior` media of shapes in file order, each with its shape.
        interiors: the `interior` media of shapes.
    """
    in_a_body = seen_from in interiors and _camera_is_within(scene, seen_from)
    around = None if in_a_body else seen_from
    for shape, medium in exteriors:
        if medium in interiors or medium == around:
            continue
        if around is None:
            around = medium
        else:
            shape.warn("its 'exterior' is left out: another medium fills the space outside of all bodies")
    return around


def _camera_is_within(scene: Scene, medium: Medium | None) -> bool:
    """Return whether the camera is inside the shapes whose interior is this medium."""
    if scene.camera is None:
        return False
    bounds = [shape.mesh_at(0.0) for shape in scene.shapes if getattr(shape.material, "interior", None) == medium]
    return abs(sum(_windings(mesh, np.array(scene.camera.origin)) for mesh in bounds)) > 0.5


def _windings(mesh: Mesh, point: NDArray[np.float64]) -> float:
    """Return the winding number of a mesh around a point: the sum of the triangles' solid angles over 4 π.

    Van Oosterom and Strackee 1983, "The Solid Angle of a Plane Triangle", equation 8.
    """
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(np.float64) - point for k in range(3))
    u, v, w = (np.linalg.norm(x, axis=1) for x in (a, b, c))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    ab, bc, ca = (np.einsum("ij,ij->i", x, y) for x, y in ((a, b), (b, c), (c, a)))
    angles = 2.0 * np.arctan2(volume, u * v * w + ab * w + bc * u + ca * v)
    return float(angles.sum()) / (4.0 * math.pi)
