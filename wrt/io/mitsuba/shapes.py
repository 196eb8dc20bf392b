"""Read Mitsuba's shapes: mesh files, analytic shapes as triangles, and instances of groups."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from wrt.io import memory_limits
from wrt.io.mitsuba.curves import CURVES, read_curves
from wrt.io.mitsuba.materials import BLACK, CLEAR, UNKNOWN, Materials, Surface
from wrt.io.mitsuba.media import Media, filled
from wrt.io.mitsuba.meshes import MESH_FILES, read_mesh
from wrt.io.mitsuba.plugin import Plugin
from wrt.io.mitsuba.sdfgrid import read_sdfgrid
from wrt.io.mitsuba.surfaces import Detail, cube, is_closed
from wrt.io.mitsuba.textures import Textures
from wrt.linalg import determinant, norm, product, singular_values
from wrt.scene.camera import PerspectiveCamera
from wrt.scene.exact.analytic import Analytic
from wrt.scene.exact.quadrics import basis, quadrics_of, unit_cylinder, unit_disk
from wrt.scene.exact.spheres import ball, spheres
from wrt.scene.lights import DiskLight, Light, RectangleLight, SphereLight
from wrt.scene.materials.body import Null
from wrt.scene.mesh import Mesh
from wrt.scene.scene import Shape
from wrt.scene.shapes import quad
from wrt.scene.textures import ColorSource, shines
from wrt.values import Vec3, vec3

Matrix = NDArray[np.float64]


_LEAST_RADIUS = 1e-5
"""Smaller spheres, relative to the distance of the origin, are triangles: float32 resolves an exact one no better."""


class Shapes:
    """Turns `shape` plugins into wrt's shapes, or into lights if they only emit.

    Attributes:
        lights: the shapes that became lights.
    """

    def __init__(self, textures: Textures, media: Media, detail: Detail) -> None:
        """Start without shapes; `detail` is the tessellation of curved shapes."""
        self.textures, self.media, self.detail = textures, media, detail
        self.materials = Materials(textures)
        self.lights: list[Light] = []
        self._exact_lights = True
        self._groups: dict[Plugin, list[Shape]] = {}

    def all_of(self, plugins: list[Plugin]) -> list[Shape]:
        """Return the shapes of a scene; black shapes that emit become lights unless rays could hit nothing else."""
        made = [shape for plugin in plugins for shape in self._shapes(plugin)]
        if made or not self.lights:
            return made
        self.lights, self._groups, self._exact_lights = [], {}, False
        return [shape for plugin in plugins for shape in self._shapes(plugin)]

    def _shapes(self, plugin: Plugin) -> list[Shape]:
        """Return the shapes of a plugin; none for a shape group, or for a shape that became a light."""
        plugin.ignore("silhouette_sampling_weight")
        if plugin.type == "shapegroup":
            return []  # only its instances are visible
        if plugin.type == "instance":
            return list(self._instance(plugin))
        if plugin.type == "merge":
            if any(inner.type == "merge" for inner in plugin.of_kind("shape")):
                raise plugin.error("a merged shape must not hold merged shapes")
            made = [shape for inner in plugin.of_kind("shape") for shape in self._shapes(inner)]
        elif plugin.type in (*_UNIT_SHAPES, *MESH_FILES, *CURVES, "sdfgrid"):
            with plugin.locating():
                made = self._shape(plugin)
        else:
            plugin.warn("this kind of shape is not known; left out")
            made = []
        return made

    def _instance(self, plugin: Plugin) -> Iterator[Shape]:
        group = next((each for each in plugin.of_kind("shape") if each.type == "shapegroup"), None)
        if group is None:
            raise plugin.error("names no shapegroup")
        if any(inner.type in ("instance", "shapegroup", "merge") for inner in group.of_kind("shape")):
            raise group.error("a group must not hold groups or instances")
        if group not in self._groups:
            # The distance of the instances to the camera is not known yet.
            detail, self.detail = self.detail, Detail(None, self.detail.height)
            self._groups[group] = [shape for inner in group.of_kind("shape") for shape in self._shapes(inner)]
            self.detail = detail
        matrix = plugin.transform()
        for shape in self._groups[group]:
            memory_limits.take(memory_limits.SHAPES, memory_limits.BYTES_PER_SHAPE)
            yield dataclasses.replace(shape, transform=matrix)

    def _shape(self, plugin: Plugin) -> list[Shape]:
        """Return the shape of a plugin that holds no others; none if it is invisible or became a light."""
        emission = self._emission(plugin.only("emitter"))
        emits = shines(emission)
        bsdf = plugin.only("bsdf")
        default = BLACK if emits else UNKNOWN
        surface = default if bsdf is None else self.materials.surface(bsdf)
        inside = self.media.interior(plugin)
        self.media.note_exterior(plugin)
        flip = plugin.boolean("flip_normals", False)
        if self._exact_lights and emits and isinstance(emission, tuple) and surface.is_black:
            light = self._exact_light(plugin, emission, flip)
            if light is not None:
                self.lights.append(light)
                return []
        if surface.is_invisible and not emits and inside is None:
            plugin.transform()
            plugin.ignore_all()
            return []
        has_open_ends = False
        if plugin.type in CURVES:
            mesh, has_open_ends = read_curves(plugin, self.detail)
        else:
            mesh = self._mesh(plugin, emits)
        memory_limits.take(memory_limits.SHAPES, memory_limits.BYTES_PER_ELEMENT)
        limit = memory_limits.MESHES if plugin.type in MESH_FILES else memory_limits.MADE
        memory_limits.take(limit, memory_limits.size_of(mesh))
        if inside is not None:
            inside = self.media.filling(plugin, inside, mesh.bounds.astype(float))
        if flip and isinstance(mesh, Analytic):
            mesh = mesh.turned_inside_out()
        elif flip:
            normals = None if mesh.normals is None else -mesh.normals
            mesh = dataclasses.replace(mesh, faces=mesh.faces[:, ::-1], normals=normals)
        if surface.is_invisible:
            surface = Surface(CLEAR if emits or inside is None else Null(interior=inside))
        elif inside is not None:
            surface = dataclasses.replace(surface, material=filled(plugin, surface.material, inside))
        if has_open_ends:
            surface = surface.without_back()
        # The black back is left out where no path can reach it.
        hides_back = surface.one_sided and self._outside(mesh) and is_closed(mesh)
        material = surface.material if hides_back else surface.both_sides
        return [Shape(mesh, material, emission, name=plugin.element.attributes.get("id") or plugin.type)]

    def _outside(self, mesh: Mesh) -> bool:
        """Return whether the camera is certainly outside the bounds of a mesh."""
        camera = self.detail.camera
        if not isinstance(camera, PerspectiveCamera):
            return False
        low, high = mesh.bounds
        reach = camera.aperture_radius
        origin = np.array(camera.origin)
        return bool(((origin < low - reach) | (origin > high + reach)).any())

    def _emission(self, emitter: Plugin | None) -> ColorSource:
        if emitter is None:
            return (0.0, 0.0, 0.0)
        if emitter.type != "area":
            emitter.warn("only area lights can be on a shape; left out")
            return (0.0, 0.0, 0.0)
        radiance = self.textures.color(emitter, "radiance", 1.0, emits=True, most=math.inf)
        emitter.ignore("sampling_weight")
        return (radiance,) * 3 if isinstance(radiance, float) else radiance

    def _mesh(self, plugin: Plugin, emits: bool) -> Mesh:
        if plugin.type in MESH_FILES:
            return read_mesh(plugin, self._attribute(plugin))
        matrix = plugin.transform()
        if plugin.type == "sdfgrid":
            return read_sdfgrid(plugin).transformed(matrix)
        if plugin.type in ("rectangle", "cube"):
            return _UNIT_SHAPES[plugin.type]().transformed(matrix)
        if plugin.type != "disk":
            matrix = product(matrix, _own_transform(plugin))
        # The centre, and the axes that a circle of the shape lies along.
        center = product(matrix[:3], np.array((0.0, 0.0, 0.5 * (plugin.type == "cylinder"), 1.0)))
        axes = matrix[:3, :3] if plugin.type == "sphere" else matrix[:3, :2]
        radius = float(singular_values(axes)[0])
        sides = matrix[:3, : 2 if plugin.type == "disk" else 3]
        smallest = radius if plugin.type == "sphere" else float(singular_values(sides)[-1])
        if smallest > _LEAST_RADIUS * np.abs(center).max() and (exact := _exact(plugin.type, matrix)) is not None:
            return exact
        segments, is_coarse = self.detail.segments(center, radius, emits=emits)
        if is_coarse:
            plugin.warn(f"is limited to {segments} segments around, which may show this close to the camera")
        return _UNIT_SHAPES[plugin.type](segments).transformed(matrix)

    def _attribute(self, plugin: Plugin) -> str | None:
        """Return the attribute of the mesh that the material or the emission reads, or None; there can be only one."""
        first: str | None = None
        waiting = list(plugin.of_kind("bsdf", "emitter"))
        visited = set()
        while waiting:
            each = waiting.pop()
            if each.type == "mesh_attribute":
                name = each.text("name", "")
                if first not in (None, name):
                    each.warn(f"a shape can have one attribute only; {first!r} stands in for {name!r}")
                first = first or name
            visited.add(each)
            waiting += [inner for _, inner in reversed(each.objects) if inner not in visited]
        return first

    def _exact_light(self, plugin: Plugin, radiance: Vec3, flip: bool) -> Light | None:
        """Return the analytic light of this shape, or None if there is none."""
        if plugin.type not in ("sphere", "disk", "rectangle"):
            return None
        matrix = plugin.transform()
        if plugin.type == "sphere":
            matrix = product(matrix, _own_transform(plugin))
        x, y, _, center = matrix[:3].T
        sizes = np.linalg.norm(matrix[:3, :3], axis=0)
        straight = abs(product(x, y)) < 1e-5 * sizes[0] * sizes[1]
        normal = np.cross(x, y) * np.sign(determinant(matrix[:3, :3])) * (-1.0 if flip else 1.0)
        round_ = straight and math.isclose(sizes[0], sizes[1], rel_tol=1e-5)
        if plugin.type == "rectangle" and straight:
            u, v = (x, y) if product(np.cross(x, y), normal) > 0.0 else (y, x)
            return RectangleLight(vec3(center - x - y), vec3(2.0 * u), vec3(2.0 * v), radiance)
        if plugin.type == "disk" and round_:
            return DiskLight(vec3(center), vec3(normal), float(sizes[0]), radiance)
        ball = round_ and np.allclose(product(matrix[:3, :3].T, matrix[:3, :3]), sizes[0] ** 2 * np.eye(3), rtol=1e-4)
        if plugin.type == "sphere" and ball and not flip:
            return SphereLight(vec3(center), float(sizes[0]), radiance)
        return None


_UNIT_SHAPES: dict[str, Callable[..., Mesh]] = {
    "rectangle": partial(quad, (-1.0, -1.0, 0.0), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0)),
    "cube": cube,
    "sphere": ball,
    "disk": unit_disk,
    "cylinder": unit_cylinder,
}


def _own_transform(plugin: Plugin) -> Matrix:
    """Return the transform of a unit shape to the one that `radius` and `center`, or `p0` and `p1`, describe."""
    radius = plugin.number("radius", 1.0, positive=True)
    result = np.diag([radius, radius, radius, 1.0])
    if plugin.type == "sphere":
        result[:3, 3] = plugin.point("center", (0.0, 0.0, 0.0))
        return result
    start, end = (np.array(plugin.point(name, value)) for name, value in (("p0", (0, 0, 0)), ("p1", (0, 0, 1))))
    along = end - start
    length = norm(along)
    if length == 0.0:
        raise plugin.error("'p0' and 'p1' must differ")
    x, y, _ = basis(along / length)
    result[:3, :3], result[:3, 3] = np.stack([radius * x, radius * y, along], axis=1), start
    return result


def _exact(kind: str, matrix: Matrix) -> Mesh | None:
    """Return the exact shape that a matrix makes of the unit shape, or None if there is none."""
    unit = np.eye(3)[None]
    if kind == "sphere":
        made: Analytic = spheres([(0.0, 0.0, 0.0)], 1.0, name=kind)
    elif kind == "disk":
        made = quadrics_of([True], np.zeros((1, 3)), unit, kind)
    else:
        made = quadrics_of([False], np.array([(0.0, 0.0, 0.5)]), unit, kind)
    return made.transformed(matrix) if made.keeps(matrix[None]) else None
