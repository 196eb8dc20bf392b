"""Check a scene and prepare its upload: shapes sorted into trees, lights, and materials as tables."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from wrt.backend import current_backend
from wrt.errors import InputError, warn
from wrt.linalg import norm
from wrt.scene.exact.analytic import Analytic
from wrt.scene.exact.distances import Distances
from wrt.scene.exact.quadrics import Quadrics
from wrt.scene.lights import Light
from wrt.scene.materials import Material
from wrt.scene.mesh import LARGEST, SMALLEST, Mesh, box_around
from wrt.scene.motion import Motion
from wrt.scene.scene import Scene, Shape
from wrt.scene.textures import ImageTexture, NormalMap, Texture, VertexColor
from wrt.upload.accel.instancing import Layout, lay_out
from wrt.upload.lights.environment import resolve_environment
from wrt.upload.lights.table import texture_of
from wrt.upload.materials import MaterialTable

UP_TO_ONE = frozenset(
    ["reflectance", "base_color", "specular_reflectance", "specular_transmittance", "sheen_color", "opacity", "weight"]
)
"""Attributes of materials that constants of at most 1 may have."""

TOLERANCE = 1e-3
"""Vertex colours may exceed 1 by what rounding adds; 16-bit floats near 1 are half as far apart."""

VISIBLE = 1.01
"""Images of files may exceed 1 by this factor without a warning: resampling overshoots."""


class PreparedScene:
    """A scene as the upload takes it.

    Attributes:
        scene: the scene, in which exact shapes that kernels cannot meet as such are triangles.
        layout: its shapes, sorted into trees.
        exact: which exact shapes it has, as `Features.exact` names them.
        environment: the environment as kernels have it.
        lights: the lights without triangles.
        textures: the textures of those, by their numbers.
        materials: its materials.
        has_tangents: whether a material may read tangents of meshes.
    """

    def __init__(self, scene: Scene, *, caustics: bool = False) -> None:
        """Check a scene and prepare its upload, for photons or not; raise InputError as `SceneUpload` does."""
        if not scene.shapes:
            raise InputError("the scene has no shapes to render")
        _check_sizes(scene)
        check_attributes(scene.shapes)
        self.scene = scene = _with_exact_shapes(scene)
        self.layout = lay_out(scene)
        self.exact, self._caustics = _mark_exact(self.layout), caustics
        self.environment, self._sky_lights = resolve_environment(scene.environment)
        self._list_values()
        meshes = {id(shape.mesh): shape.mesh for shape in scene.shapes}.values()
        self.has_tangents = self.materials.tangents and any(mesh.tangents is not None for mesh in meshes)

    def _list_values(self, **options: Any) -> None:
        """Set what does not depend on the geometry; `options` are those of the MaterialTable."""
        scene = self.scene
        self.lights: list[Light] = [*scene.lights, *self._sky_lights]
        textures = ((i, texture_of(light)) for i, light in enumerate(self.lights))
        self.textures = {i: texture for i, texture in textures if texture is not None}
        emissions = [*(shape.emission for shape in scene.shapes), *self.textures.values()]
        options["caustics"] = self._caustics
        self.materials = MaterialTable([shape.material for shape in scene.shapes], emissions, **options)

    def without_meshes(self) -> PreparedScene:
        """Return it without the meshes in world space, for `changed`."""
        kept = copy.copy(self)
        kept.layout = dataclasses.replace(self.layout, world_meshes=[], shared=[])
        return kept

    def changed(self, scene: Scene) -> PreparedScene:
        """Return it for the same shapes, lights and environment with other values, those of `scene`.

        Raises:
            InputError: as `check_attributes` does.
        """
        shapes = list(zip(scene.shapes, self.scene.shapes, strict=True))
        check_attributes([new for new, old in shapes if new is not old])
        changed = copy.copy(self)
        # An exact shape may have become triangles.
        kept = [dataclasses.replace(new, mesh=old.mesh) if _is_exact(new, old) else new for new, old in shapes]
        changed.scene = dataclasses.replace(scene, shapes=kept)
        if scene.environment is not self.scene.environment:
            changed.environment, changed._sky_lights = resolve_environment(scene.environment)
        changed._list_values(editable=True, before=self.materials)
        return changed


def _is_exact(new: Shape, old: Shape) -> bool:
    return new.mesh is not old.mesh and isinstance(new.mesh, Analytic)


def _check_sizes(scene: Scene) -> None:
    """Raise InputError when static meshes are too large or too small for rays."""
    meshes = {id(shape.mesh): shape for shape in scene.shapes if shape.transform is None and shape.deformation is None}
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for shape in meshes.values():
        bounds = shape.mesh.bounds
        reach = float(np.abs(bounds).max())
        if not reach <= LARGEST:
            raise InputError(f"{shape.name}: its vertices reach to {reach:g}; rays reach to {LARGEST:g}; scale it down")
        low, high = np.minimum(low, bounds[0]), np.maximum(high, bounds[1])
    size = norm(high - low) if len(meshes) == len(scene.shapes) else np.inf
    if size < SMALLEST:
        what = f"the scene is {size:g} across" if size else "all vertices of the scene are in one place"
        raise InputError(f"{what}; rays need a size of {SMALLEST:g} at least; scale it up")


# --- Attributes that materials read ----------------------------------------------------------------


def check_attributes(shapes: Iterable[Shape]) -> None:
    """Check the vertex attributes and images of shapes.

    Warns of images on meshes without texture coordinates, and of images that reflect more than all light.

    Raises:
        InputError: where vertex colours that a material reads are not from 0 to 1, or emitted ones are below 0.
    """
    bright: set[int] = set()
    varying: dict[int, list[tuple[str, object]]] = {}  # of materials, since many shapes share one
    alike = {(id(shape.mesh), id(shape.material), id(shape.emission)): shape for shape in shapes}  # not every instance
    for shape in alike.values():
        if id(shape.material) not in varying:
            varying[id(shape.material)] = [*_varying(shape.material)]
        values = [*varying[id(shape.material)], ("emission", shape.emission)]
        for name, value in values:
            if isinstance(value, VertexColor):
                _check_colors(shape, name, value)
            elif isinstance(value, ImageTexture) and name in UP_TO_ONE and id(value) not in bright:
                bright.add(id(value))
                most = float(value.pixels.max()) * max(value.factor)  # type: ignore[arg-type]
                if most > VISIBLE:
                    warn(f"texture {value.name}: as {name} it must be at most 1, but it reaches {most:g}")
        if shape.mesh.uvs is None and any(_needs_uv(value) for _, value in values):
            warn(f"{shape.name}: its material has an image, but its mesh no texture coordinates; it shows one texel")


def _needs_uv(value: object) -> bool:
    return value.needs_uv if isinstance(value, Texture) else isinstance(value, (ImageTexture, NormalMap))


def _varying(material: Material) -> Iterator[tuple[str, object]]:
    """Yield the names and values of those attributes of a material, and of its parts, that vary over a surface."""
    for field in dataclasses.fields(material):
        value = getattr(material, field.name)
        if isinstance(value, (ImageTexture, NormalMap, Texture, VertexColor)):
            yield field.name, value
    for part in material.parts:
        yield from _varying(part)


def _check_colors(shape: Shape, name: str, value: VertexColor) -> None:
    """Raise InputError unless the vertex colours that an attribute of a material reads are in its range."""
    colors = shape.mesh.colors
    if colors is None or (value.alpha and colors.shape[1] < 4):  # 1 everywhere
        return
    bounds = box_around(colors)
    bounds = bounds[:, 3:] if value.alpha else bounds[:, :3] * np.asarray(value.factor)
    low, high = float(bounds.min()), float(bounds.max())
    if name == "emission" and low < 0.0:
        raise InputError(f"{shape.name}: vertex colors that shine must be at least 0, not {low:g}")
    if name in UP_TO_ONE and (low < 0.0 or high > 1.0 + TOLERANCE):
        raise InputError(f"{shape.name}: vertex colors must be linear, from 0 to 1; they are from {low:g} to {high:g}")


# --- Exact shapes ----------------------------------------------------------------------------------


def _with_exact_shapes(scene: Scene) -> Scene:
    """Return a scene in which exact shapes whose transform does not keep them are triangles."""
    triangles: dict[int, Mesh] = {}
    shapes = list(scene.shapes)
    for i, shape in enumerate(shapes):
        mesh, motion = shape.mesh, shape.transform
        if not isinstance(mesh, Analytic) or motion is None:
            continue
        if not mesh.keeps(motion.transforms if isinstance(motion, Motion) else motion[None]):
            if id(mesh) not in triangles:
                triangles[id(mesh)] = mesh.tessellated()
            shapes[i] = dataclasses.replace(shape, mesh=triangles[id(mesh)])
    return dataclasses.replace(scene, shapes=shapes) if triangles else scene


def _mark_exact(layout: Layout) -> str:
    """Return which exact shapes a layout has, as `Features.exact` names them.

    A triangle whose third corner is its first is never hit. So that it is not taken for an exact shape, its second
    corner becomes the same.
    """
    shared = [key for mesh in layout.shared for key in mesh.keys]
    exact = [mesh for mesh in (*layout.world_meshes, *shared) if isinstance(mesh, Analytic)]
    if not exact:
        return "none"
    layout.world_meshes[:] = [_without_needles([mesh])[0] for mesh in layout.world_meshes]
    for each in layout.shared:
        each.keys = _without_needles(each.keys)
    if names := sorted({_distance_of(mesh) for mesh in exact if isinstance(mesh, Distances)}):
        return "-".join(["quadrics", *names])
    return "quadrics" if any(isinstance(mesh, Quadrics) for mesh in exact) else "spheres"


def _distance_of(mesh: Distances) -> str:
    """Return the name by which kernels know the distance function of a shape, or raise InputError if it is wrong."""
    called, model = type(mesh.description).__name__, mesh.description.model
    given = len(mesh.description.numbers())
    backend, module = current_backend(), "wrt.kernels.geometry.distances"
    try:
        name: str = backend.call(module, "current_name", model)
        taken = backend.call(module, "numbers_of", name)
    except KeyError:
        raise InputError(f"{called}: there is no distance function {model!r}") from None
    if given != taken:
        raise InputError(f"{called}: its distance function takes {taken} numbers, but the shape has {given}")
    return name


def _without_needles(keys: list[Mesh]) -> list[Mesh]:
    """Return meshes of the same faces, without triangles whose third corner is their first, as exact shapes have."""
    if isinstance(keys[0], Analytic):
        return keys
    faces = keys[0].faces
    needles = np.zeros(len(faces), bool)
    for mesh in keys:
        needles |= (mesh.vertices[faces[:, 0]] == mesh.vertices[faces[:, 2]]).all(axis=1)
    if not needles.any():
        return keys
    faces = faces.copy()
    faces[needles] = faces[needles][:, :1]
    return [dataclasses.replace(mesh, faces=faces) for mesh in keys]
