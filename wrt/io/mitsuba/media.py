"""Read Mitsuba's media, inside shapes and around them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.io.mitsuba.materials.textures import Textures
from wrt.io.mitsuba.plugin import Plugin
from wrt.io.volume.read import read_volume
from wrt.io.volume.volume import Volume
from wrt.linalg import inverse, product
from wrt.scene.exact.quadrics import Quadrics
from wrt.scene.exact.spheres import Spheres
from wrt.scene.materials import Material
from wrt.scene.materials.body import Body, Null
from wrt.scene.medium import DensityGrid, Medium
from wrt.scene.mesh import Mesh
from wrt.scene.scene import Scene

_GRIDS = ("gridvolume", "grid")

_BEYOND = 1e-4
"""A grid reaches this far beyond the shape it fills, in its own lengths."""

_MOST_CONTINUED = 2**26
"""Most numbers in a grid that is continued."""


def medium_of(plugin: Plugin, textures: Textures) -> Medium | None:
    """Return a `homogeneous` or `heterogeneous` medium; for others warn and return None.

    Raises:
        InputError: when its numbers or files cannot be used.
    """
    if plugin.type not in ("homogeneous", "heterogeneous"):
        plugin.warn("only homogeneous and heterogeneous media are supported; left out")
        return None
    varies = plugin.type == "heterogeneous"
    for name in ("sigma_t", "albedo", "sigma_s", "sigma_a"):
        volume = plugin.named(name)
        grid_is_fine = name in (("sigma_t", "albedo") if varies else ("albedo",))
        grid_is_fine = grid_is_fine and volume is not None and volume.type in _GRIDS
        if volume is not None and volume.kind == "volume" and volume.type != "constvolume" and not grid_is_fine:
            plugin.warn(f"{name!r} cannot vary in a medium; left out")
            return None
    scale = plugin.number("scale", 1.0)
    density = None
    if plugin.has("sigma_s") or plugin.has("sigma_a"):  # as in Mitsuba 0.x
        scattering, absorption = (_color(plugin, textures, name, 0.0) for name in ("sigma_s", "sigma_a"))
    else:
        extinction, density = _extinction(plugin, textures)
        albedo, density = _albedo(plugin, textures, density)
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
        absorption, scattering = (tuple(scale * x for x in coefficient) for coefficient in (absorption, scattering))
        return Medium(absorption, scattering, mean_cosine, density=density)
    except InputError as error:
        raise plugin.placed(error) from None


def _color(plugin: Plugin, textures: Textures, name: str, default: float) -> tuple[float, ...]:
    volume = plugin.named(name)
    if volume is not None and volume.kind == "volume":
        result = textures.constant(volume, "value", default)
        volume.finish()
        return result
    return textures.constant(plugin, name, default)


def _grid(plugin: Plugin, name: str) -> Plugin | None:
    """Return a parameter that is a grid, or None."""
    volume = plugin.named(name)
    return volume if volume is not None and volume.kind == "volume" and volume.type in _GRIDS else None


def _extinction(plugin: Plugin, textures: Textures) -> tuple[tuple[float, ...], DensityGrid | None]:
    """Return the extinction where the density is 1, and the density if it varies."""
    grid = _grid(plugin, "sigma_t")
    if grid is None:
        return _color(plugin, textures, "sigma_t", 1.0), None
    volume, places = _volume(grid)
    values = volume.values
    color: tuple[float, ...] = (1.0, 1.0, 1.0)
    if values.ndim == 4:
        values, color = _split_colors(grid, values)
    # One element is one medium, also where several shapes refer to it.
    key = id(plugin.element)
    if key not in textures.densities:
        try:
            textures.densities[key] = DensityGrid(values, **places, name=grid.file().name)
        except InputError as error:
            raise grid.placed(error) from None
    return color, textures.densities[key]


def _albedo(
    plugin: Plugin, textures: Textures, density: DensityGrid | None
) -> tuple[tuple[float, ...], DensityGrid | None]:
    """Return the albedo, and the density with that albedo if it varies."""
    grid = _grid(plugin, "albedo")
    if grid is None:
        return _color(plugin, textures, "albedo", 0.75), density
    if density is not None and density.albedo is not None:
        return (0.0, 0.0, 0.0), density
    volume, places = _volume(grid, fills_all=plugin.type == "homogeneous")
    colors = np.broadcast_to(volume.values.reshape(*volume.values.shape[:3], -1), (*volume.values.shape[:3], 3))
    one_cell = np.ones((1, 1, 1), np.float32)
    if plugin.type == "homogeneous":
        place = DensityGrid(one_cell, **places, name=grid.file().name)
        return (0.0, 0.0, 0.0), _with_albedo(grid, place, colors)
    same = density is not None and np.allclose(DensityGrid(one_cell, **places).to_world, density.to_world)
    if density is None or not same:
        grid.warn("'albedo' can vary only in the box of 'sigma_t'; its mean is used")
        return tuple(colors.mean(axis=(0, 1, 2)).tolist()), density
    density = _with_albedo(grid, density, colors)
    textures.densities[id(plugin.element)] = density
    return (0.0, 0.0, 0.0), density


def _with_albedo(grid: Plugin, density: DensityGrid, colors: NDArray[Any]) -> DensityGrid:
    try:
        return dataclasses.replace(density, albedo=colors)
    except InputError as error:
        raise grid.placed(error) from None


def continued(plugin: Plugin, medium: Medium, bounds: NDArray[np.float64], textures: Textures) -> Medium:
    """Return a homogeneous medium whose albedo varies, continued beyond the box of its grid to fill a shape.

    Args:
        plugin: the medium.
        medium: the same, as `medium_of` returns it.
        bounds: (2, 3) corners of the shape, in the world.
        textures: which keep the grid, so that equal shapes share it.
    """
    density, grid = medium.density, _grid(plugin, "albedo")
    if plugin.type != "homogeneous" or density is None or grid is None or density.albedo is None:
        return medium
    corners = np.stack(np.meshgrid(*bounds.T, indexing="ij"), axis=-1).reshape(-1, 3)
    to_unit = inverse(density.to_world)
    within = product(corners, to_unit[:3, :3].T) + to_unit[:3, 3]
    first = np.floor(within.min(axis=0) - _BEYOND).astype(int)
    last = np.ceil(within.max(axis=0) + _BEYOND).astype(int)
    key = id(plugin.element), *first.tolist(), *last.tolist()
    if key not in textures.continuations:
        cells = density.albedo.size * int((last - first).prod())
        if cells > _MOST_CONTINUED:
            grid.warn("its box is too small beside the shape; its mean is used")
            albedo = np.broadcast_to(density.albedo.mean(axis=(0, 1, 2)), (1, 1, 1, 3))
        else:
            wrap = grid.choice("wrap_mode", "clamp", "clamp", "repeat", "mirror")
            albedo = density.albedo
            for axis in range(3):  # the grid has z first
                albedo = _along(albedo, 2 - axis, int(first[axis]), int(last[axis]), wrap)
        place = np.eye(4)
        place[:3, :3], place[:3, 3] = np.diag(last - first), first
        textures.continuations[key] = DensityGrid(
            density.values, transform=product(density.to_world, place), albedo=albedo, name=density.name
        )
    return dataclasses.replace(medium, density=textures.continuations[key])


def _along(values: NDArray[Any], axis: int, first: int, last: int, wrap: str) -> NDArray[Any]:
    """Return a grid over the boxes from `first` to `last` along an axis, where box 0 has the values."""
    pieces = []
    for k in range(first, last):
        if wrap == "repeat" or k == 0:
            pieces.append(values)
        elif wrap == "mirror":
            pieces.append(np.flip(values, axis) if k % 2 else values)
        else:
            edge = np.take(values, [0 if k < 0 else -1], axis)
            pieces.append(np.repeat(edge, values.shape[axis], axis))
    return np.concatenate(pieces, axis)


def _volume(grid: Plugin, *, fills_all: bool = False) -> tuple[Volume, dict[str, Any]]:
    """Return a grid, and where its box is as arguments of DensityGrid."""
    file = grid.file()
    try:
        volume = read_volume(file)
    except InputError as error:
        raise grid.error(str(error)) from None
    if grid.choice("filter_type", "trilinear", "trilinear", "nearest") == "nearest":
        grid.warn("'nearest' is not known; values are interpolated")
    if grid.choice("wrap_mode", "clamp", "clamp", "repeat", "mirror") != "clamp" and not fills_all:
        grid.warn("beyond its box there is nothing, whatever its 'wrap_mode'")
    places: dict[str, Any] = {"transform": grid.transform()}
    if grid.boolean("use_grid_bbox", False):
        places |= {key: value for key, value in volume.places.items() if key != "transform"}
    grid.ignore("raw", "accel", "max_value")
    grid.finish()
    return volume, places


def _split_colors(grid: Plugin, values: NDArray[Any]) -> tuple[NDArray[Any], tuple[float, ...]]:
    """Return coefficients of three channels as a density and a colour."""
    total = values.sum(axis=(0, 1, 2), dtype=np.float64)
    color = total / max(float(total.max()), 1e-300)
    density = values.max(axis=3)
    if not np.allclose(density[..., None] * color, values, rtol=1e-3, atol=1e-6 * float(density.max())):
        grid.warn("the colour of 'sigma_t' cannot vary; its mean is used")
    return density, tuple(color.tolist())


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
    if isinstance(mesh, Spheres):
        within = np.linalg.norm(mesh.centers - point, axis=1) < mesh.radii
        return float(np.where(mesh.inside_out, -1.0, 1.0)[within].sum())
    if isinstance(mesh, Quadrics):
        mesh = mesh.tessellated()
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(np.float64) - point for k in range(3))
    u, v, w = (np.linalg.norm(x, axis=1) for x in (a, b, c))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    ab, bc, ca = (np.einsum("ij,ij->i", x, y) for x, y in ((a, b), (b, c), (c, a)))
    angles = 2.0 * np.arctan2(volume, u * v * w + ab * w + bc * u + ca * v)
    return float(angles.sum()) / (4.0 * math.pi)
