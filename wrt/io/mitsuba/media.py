"""Read Mitsuba's media, inside shapes and around them."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.io.mitsuba.plugin import Plugin
from wrt.io.mitsuba.textures import Textures
from wrt.io.volume.read import Volume, read_volume
from wrt.linalg import inverse, product
from wrt.scene.exact.quadrics import Quadrics
from wrt.scene.exact.spheres import Spheres
from wrt.scene.materials import Material
from wrt.scene.materials.body import Body
from wrt.scene.medium import DensityGrid, Medium
from wrt.scene.mesh import Mesh
from wrt.scene.scene import Scene

_GRIDS = ("gridvolume", "grid")

_BEYOND = 1e-4  # margin of a grid around the shape that it fills, relative to the grid
_MOST_CONTINUED = 2**26  # most numbers in a grid that is continued
Coefficients = tuple[float, ...]


class Media:
    """The media of a scene, inside shapes and around them.

    Equal media are one, and an element always gives the same densities, also where several shapes refer to it.
    """

    def __init__(self, textures: Textures) -> None:
        self.textures = textures
        self._interiors: set[Medium] = set()
        self._exteriors: list[tuple[Plugin, Medium]] = []  # each with its shape, in the order of the file
        self._densities: dict[Plugin, DensityGrid] = {}
        self._continued: dict[tuple[Any, ...], DensityGrid] = {}

    def interior(self, shape: Plugin) -> Medium | None:
        """Return the medium inside a shape."""
        medium = self._medium(shape.named("interior"))
        if medium is not None:
            self._interiors.add(medium)
        return medium

    def note_exterior(self, shape: Plugin) -> None:
        """Read the medium outside a shape, which `around` may return."""
        medium = self._medium(shape.named("exterior"))
        if medium is not None:
            if medium.density is not None:
                shape.warn("beyond the box of its grid, its 'exterior' is empty")
            self._exteriors.append((shape, medium))

    def around(self, sensor: Plugin | None, scene: Scene) -> Medium | None:
        """Return the medium outside all shapes of a scene, or None.

        It is the sensor's medium, unless the camera is inside a shape that this medium fills. Otherwise it is the first
        `exterior` that is not also an `interior`: such an `exterior` belongs to a shape inside another shape and does
        not reach outside.
        """
        plugin = None if sensor is None else sensor.only("medium")
        around = self._medium(plugin)
        if plugin is not None and around is None:
            return None  # a kind of medium that is not supported
        if around in self._interiors and _camera_is_within(scene, around):
            around = None
        for shape, medium in self._exteriors:
            if medium in self._interiors or medium == around:
                continue
            if around is None:
                around = medium
            else:
                shape.warn("its 'exterior' is left out: another medium fills the space outside of all bodies")
        return around

    def _medium(self, plugin: Plugin | None) -> Medium | None:
        """Return a `homogeneous` or `heterogeneous` medium; for others warn and return None."""
        if plugin is None or plugin.kind != "medium":
            return None
        if plugin.type not in ("homogeneous", "heterogeneous"):
            plugin.warn("only homogeneous and heterogeneous media are supported; left out")
            return None
        grids = ("sigma_t", "albedo") if plugin.type == "heterogeneous" else ("albedo",)
        for name in ("sigma_t", "albedo", "sigma_s", "sigma_a"):
            volume = plugin.named(name)
            if volume is None or volume.kind != "volume" or volume.type == "constvolume":
                continue
            if name not in grids or volume.type not in _GRIDS:
                plugin.warn(f"{name!r} cannot vary in a medium; left out")
                return None
        scale = plugin.number("scale", 1.0)
        density = None
        if plugin.has("sigma_s") or plugin.has("sigma_a"):  # as in Mitsuba 0.x
            scattering, absorption = (self._color(plugin, name, 0.0) for name in ("sigma_s", "sigma_a"))
        else:
            extinction, density = self._extinction(plugin)
            albedo, density = self._albedo(plugin, density)
            scattering = tuple(a * t for a, t in zip(albedo, extinction, strict=True))
            absorption = tuple((1.0 - a) * t for a, t in zip(albedo, extinction, strict=True))
        mean_cosine = 0.0
        phase = plugin.only("phase")
        if phase is not None:
            if phase.type == "hg":
                mean_cosine = phase.number("g", 0.8)
            elif phase.type != "isotropic":
                phase.warn_of_all("this phase function is not known; 'isotropic' stands in for it")
        plugin.ignore("has_spectral_extinction", "sample_emitters", "material")
        absorption, scattering = (tuple(scale * x for x in coefficient) for coefficient in (absorption, scattering))
        with plugin.locating():
            return Medium(absorption, scattering, mean_cosine, density=density)

    def _color(self, plugin: Plugin, name: str, default: float) -> Coefficients:
        volume = plugin.named(name)
        if volume is None or volume.kind != "volume":
            return self.textures.constant(plugin, name, default)
        return self.textures.constant(volume, "value", default)

    def _extinction(self, plugin: Plugin) -> tuple[Coefficients, DensityGrid | None]:
        """Return the extinction where the density is 1, and the density if it varies."""
        grid = _grid(plugin, "sigma_t")
        if grid is None:
            return self._color(plugin, "sigma_t", 1.0), None
        volume, places = _volume(grid)
        values = volume.values
        color: Coefficients = (1.0, 1.0, 1.0)
        if values.ndim == 4:
            values, color = _split_colors(grid, values)
        if plugin not in self._densities:
            with grid.locating():
                self._densities[plugin] = DensityGrid(values, **places, name=grid.file().name)
        return color, self._densities[plugin]

    def _albedo(self, plugin: Plugin, density: DensityGrid | None) -> tuple[Coefficients, DensityGrid | None]:
        """Return the albedo, and the density with that albedo if it varies."""
        grid = _grid(plugin, "albedo")
        if grid is None:
            return self._color(plugin, "albedo", 0.75), density
        if density is None or density.albedo is None:
            is_homogeneous = plugin.type == "homogeneous"
            volume, places = _volume(grid, fills_all=is_homogeneous)
            cells = volume.values.shape[:3]
            colors = np.broadcast_to(volume.values.reshape(*cells, -1), (*cells, 3))
            box = DensityGrid(np.ones((1, 1, 1), np.float32), **places, name=grid.file().name)
            if is_homogeneous:
                density = box
            elif density is None or not np.allclose(box.to_world, density.to_world):
                grid.warn("'albedo' can vary only in the box of 'sigma_t'; its mean is used")
                return tuple(colors.mean(axis=(0, 1, 2)).tolist()), density
            with grid.locating():
                density = dataclasses.replace(density, albedo=colors)
            if not is_homogeneous:
                self._densities[plugin] = density
        return (0.0, 0.0, 0.0), density

    def filling(self, shape: Plugin, medium: Medium, bounds: NDArray[np.float64]) -> Medium:
        """Return the interior of a shape; the grid of an albedo that alone varies is continued to fill the bounds."""
        plugin = shape.named("interior")
        assert plugin is not None
        density, grid = medium.density, _grid(plugin, "albedo")
        if plugin.type != "homogeneous" or density is None or grid is None or density.albedo is None:
            return medium
        corners = np.stack(np.meshgrid(*bounds.T, indexing="ij"), axis=-1).reshape(-1, 3)
        to_unit = inverse(density.to_world)
        places = product(corners, to_unit[:3, :3].T) + to_unit[:3, 3]
        first = np.floor(places.min(axis=0) - _BEYOND).astype(int)
        last = np.ceil(places.max(axis=0) + _BEYOND).astype(int)
        key = plugin, *first.tolist(), *last.tolist()
        if key not in self._continued:
            albedo = density.albedo
            if albedo.size * int((last - first).prod()) > _MOST_CONTINUED:
                grid.warn("its box is too small beside the shape; its mean is used")
                albedo = np.broadcast_to(albedo.mean(axis=(0, 1, 2)), (1, 1, 1, 3))
            else:
                wrap = grid.choice("wrap_mode", "clamp", "repeat", "mirror")
                for axis in range(3):  # the grid has z first
                    albedo = _along(albedo, 2 - axis, int(first[axis]), int(last[axis]), wrap)
            place = np.eye(4)
            place[:3, :3], place[:3, 3] = np.diag(last - first), first
            self._continued[key] = DensityGrid(
                density.values, transform=product(density.to_world, place), albedo=albedo, name=density.name
            )
        medium = dataclasses.replace(medium, density=self._continued[key])
        self._interiors.add(medium)
        return medium


def _grid(plugin: Plugin, name: str) -> Plugin | None:
    """Return a parameter that is a grid, or None."""
    volume = plugin.named(name)
    return volume if volume is not None and volume.kind == "volume" and volume.type in _GRIDS else None


def _along(values: NDArray[Any], axis: int, first: int, last: int, wrap: str) -> NDArray[Any]:
    """Return a grid over the boxes from `first` to `last` along an axis, where box 0 has the values."""
    size = values.shape[axis]
    index = np.arange(first * size, last * size)
    if wrap == "clamp":
        index = index.clip(0, size - 1)
    else:
        index %= size if wrap == "repeat" else 2 * size
        index = np.minimum(index, 2 * size - 1 - index)  # every other box is mirrored
    return np.take(values, index, axis)


def _volume(grid: Plugin, *, fills_all: bool = False) -> tuple[Volume, dict[str, Any]]:
    """Return a grid, and where its box is as arguments of DensityGrid."""
    file = grid.file()
    with grid.locating():
        volume = read_volume(file)
    if grid.choice("filter_type", "trilinear", "nearest") == "nearest":
        grid.warn("'nearest' is not known; values are interpolated")
    if grid.choice("wrap_mode", "clamp", "repeat", "mirror") != "clamp" and not fills_all:
        grid.warn("outside of its box the density is 0; its 'wrap_mode' is left out")
    places: dict[str, Any] = {"transform": grid.transform()}
    if grid.boolean("use_grid_bbox", False):
        places |= {key: value for key, value in volume.places.items() if key != "transform"}
    grid.ignore("raw", "accel", "max_value")
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
        is_inside = np.linalg.norm(mesh.centers - point, axis=1) < mesh.radii
        return float(np.where(mesh.inside_out, -1.0, 1.0)[is_inside].sum())
    if isinstance(mesh, Quadrics):
        mesh = mesh.tessellated()
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(np.float64) - point for k in range(3))
    u, v, w = (np.linalg.norm(x, axis=1) for x in (a, b, c))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    ab, bc, ca = (np.einsum("ij,ij->i", x, y) for x, y in ((a, b), (b, c), (c, a)))
    angles = 2.0 * np.arctan2(volume, u * v * w + ab * w + bc * u + ca * v)
    return float(angles.sum()) / (4.0 * math.pi)
