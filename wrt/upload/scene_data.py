"""Upload a Scene as SceneData: check it, flatten it, and build its trees."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrt.backend import current_backend
from wrt.backend.device import Device
from wrt.backend.memory import MEMORY_ADVICE
from wrt.errors import InputError
from wrt.linalg import norm
from wrt.scene.camera import Camera
from wrt.scene.environment import ConstantEnvironment, ImageEnvironment
from wrt.scene.lights import Light
from wrt.scene.mesh import LARGEST, SMALLEST, Mesh, columns
from wrt.scene.scene import Scene, Shape
from wrt.scene.textures import ImageTexture
from wrt.upload.accel.bvh import build_bvh
from wrt.upload.accel.geometry import joined, numbered, upload, upload_triangles
from wrt.upload.accel.instancing import Layout, lay_out
from wrt.upload.accel.scene_instances import place
from wrt.upload.analytic import mark_exact, with_exact_shapes
from wrt.upload.attributes import check_attributes
from wrt.upload.bodies import BodyTable, describe_bodies, set_camera_bodies
from wrt.upload.lights.choice import upload_light_choice
from wrt.upload.lights.environment import environment_kind, resolve_environment, upload_environment
from wrt.upload.lights.table import LightTable, light_table, texture_of
from wrt.upload.materials import MaterialTable, describe_materials
from wrt.upload.memory import SceneMemory, scene_memory, tree_memory
from wrt.upload.vertex_updates import WorldMeshes

WORTH_ASKING = 1 << 26
"""Bytes from which the CPU is asked whether it has them; the question takes 0.2 ms."""


@dataclass(frozen=True)
class BuiltScene:
    """A scene on a device.

    Attributes:
        data: the SceneData struct that kernels take.
        features: the features of the scene, which choose the kernel.
        read: the features for which it was uploaded, those of the kernel.
        world: the meshes in the world's tree, whose vertices can be updated between frames.
        bodies: the bodies and media.
        device: the device.
    """

    data: Any
    features: Any
    read: Any
    world: WorldMeshes
    bodies: BodyTable
    device: Device

    def look_from(self, camera: Camera) -> None:
        """Find the bodies around a camera, in which its paths begin."""
        if self.features.bodies:
            set_camera_bodies(self.data, self.bodies, camera, self.features.geometry, self.device)


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


class Described(NamedTuple):
    """A scene as the upload takes it.

    Attributes:
        scene: the scene, in which exact shapes that kernels cannot meet as such are triangles.
        layout: its shapes, sorted into trees.
        exact: which exact shapes it has, as `Features.exact` names them.
        environment: the environment as kernels have it.
        lights: the lights without triangles.
        textures: the textures of those, by their numbers.
        materials: its materials.
    """

    scene: Scene
    layout: Layout
    exact: str
    environment: ConstantEnvironment | ImageEnvironment | None
    lights: list[Light]
    textures: dict[int, ImageTexture]
    materials: MaterialTable


def describe_scene(scene: Scene) -> Described:
    """Check a scene and prepare its upload; raise InputError as `build_scene` does."""
    if not scene.shapes:
        raise InputError("the scene has no shapes to render")
    _check_sizes(scene)
    check_attributes(scene.shapes)
    scene = with_exact_shapes(scene)
    layout = lay_out(scene)
    exact = mark_exact(layout)
    environment, sky_lights = resolve_environment(scene.environment)
    lights = [*scene.lights, *sky_lights]
    textures = {i: texture for i, light in enumerate(lights) if (texture := texture_of(light)) is not None}
    materials = describe_materials(
        [shape.material for shape in scene.shapes],
        [*(shape.emission for shape in scene.shapes), *textures.values()],
    )
    return Described(scene, layout, exact, environment, lights, textures, materials)


def memory_of(described: Described, *, is_cpu: bool, texture_coordinates: bool = False) -> SceneMemory:
    """Return the memory that the upload will take on the CPU or on a GPU, see `scene_memory`."""
    scene, layout, _, environment, lights, _, materials = described
    return scene_memory(
        scene, layout, materials, environment, lights, is_cpu=is_cpu, texture_coordinates=texture_coordinates
    )


def _require_memory(described: Described, device: Device, texture_coordinates: bool) -> None:
    """Raise NotEnoughMemory if the device lacks what the upload takes at least.

    On the CPU only trees and their builder count, as it shares the other arrays with the scene.
    """
    if device.is_cpu:
        needed = tree_memory(described.layout, is_cpu=True).most
        if needed < WORTH_ASKING:
            return
    else:
        memory = memory_of(described, is_cpu=False, texture_coordinates=texture_coordinates)
        needed = memory.kept + memory.scratch
    triangles = sum(len(shape.mesh.faces) for shape in described.scene.shapes)
    device.require_memory(needed, f"building a scene of {triangles:,} triangles", advice=MEMORY_ADVICE)


def build_scene(
    scene: Scene,
    device: Device,
    *,
    texture_coordinates: bool = False,
    light_choice: str = "auto",
    on_features: Callable[[Any], Any] = lambda features: features,
) -> BuiltScene:
    """Upload a scene to a device and build its ray tree there.

    Args:
        scene: the scene.
        device: the device.
        texture_coordinates: whether to upload these even if no material needs them.
        light_choice: one of `wrt.upload.lights.choice.LIGHT_CHOICES`.
        on_features: called with the features as soon as they are known, before the tree is built; returns those of the
            kernel that will read the scene, which may have more (see `Features.covers`).

    Raises:
        InputError: when the scene has no shapes, or more triangles or vertices than 32 bits can count.
    """
    backend = current_backend()
    scene_data = backend.kernels("wrt.kernels.core.scene_data")

    from wrt.kernels.core.features import Features

    described = describe_scene(scene)
    scene, layout, exact, environment, lights, textures, materials = described
    _require_memory(described, device, texture_coordinates)
    data = scene_data.SceneData()
    places = _places(layout)
    first_triangles = places.of_shapes
    materials.upload(data, device)
    bodies = describe_bodies(scene)
    bodies.upload(data, device)

    data.environment, flux = upload_environment(environment, device.name)
    slots = dict(zip(textures, materials.emission_slots[len(scene.shapes) :], strict=True))
    table = light_table(scene.shapes, lights, layout, first_triangles, flux, slots)
    light_tree = _upload_lights(data, table, device, light_choice)
    records = _shape_records(scene, materials, bodies, table, first_triangles)
    data.shapes = backend.array(records, scene_data.ShapeRecord, device.name)

    features = Features(
        materials.models,
        materials.textured,
        environment_kind(environment),
        composite=materials.composite,
        tangents=materials.tangents,
        light_shapes=table.shape_models,
        instances=layout.kind,
        light_tree=light_tree,
        media=bodies.kind,
        grid_media=bodies.has_grids,
        nested=bodies.nested,
        uv2_alpha=materials.uv2_alpha,
        mipmapped=materials.mipmapped,
        exact=exact,
    )
    read = on_features(features)
    textured = read.textured or read.tangents or texture_coordinates
    _upload_geometry(data, layout, places, device, textured=textured, uv2_alpha=read.uv2_alpha)
    world = _build_trees(data, layout, places, device)
    built = BuiltScene(data, features, read, world, bodies, device)
    if scene.camera is not None:
        built.look_from(scene.camera)
    return built


class _Places(NamedTuple):
    """Offsets of the meshes of a layout in the common arrays; the world's meshes come first.

    Attributes:
        copies: meshes in the array of vertices; a deforming mesh has one for each key.
        faces: meshes in the array of triangles.
        first_vertices: number of the first vertex of each of `faces`.
        first_triangles: number of the first triangle of each of `faces`.
        counts: number of triangles of each of `faces`.
        of_shapes: first triangle of each shape.
    """

    copies: list[Mesh]
    faces: list[Mesh]
    first_vertices: NDArray[np.int64]
    first_triangles: NDArray[np.int64]
    counts: NDArray[np.int64]
    of_shapes: NDArray[np.int64]


def _places(layout: Layout) -> _Places:
    world = layout.world_meshes
    copies = [*world, *(key for shared in layout.shared for key in shared.keys)]
    # All keys of a mesh share the faces of the first.
    faces = [*world, *(shared.keys[0] for shared in layout.shared)]
    bases = np.cumsum([0, *(len(m.vertices) for m in copies)])
    repeats = np.array([1] * len(world) + [len(shared.keys) for shared in layout.shared])
    counts = np.array([len(m.faces) for m in faces])
    first_triangles = np.cumsum(counts) - counts
    of_shapes = np.empty(len(layout.world_shapes) + len(layout.instances), np.int64)
    of_shapes[layout.world_shapes] = first_triangles[: len(world)]
    for instance in layout.instances:
        of_shapes[instance.shape] = first_triangles[len(world) + instance.mesh]
    return _Places(copies, faces, bases[np.cumsum(repeats) - repeats], first_triangles, counts, of_shapes)


def _upload_lights(data: Any, lights: LightTable, device: Device, choice: str) -> bool:
    """Upload the lights and the tables for selecting one, and return whether these include a tree."""
    backend = current_backend()
    records = backend.kernels("wrt.kernels.core.scene_data")
    has_tree = False
    if lights.weights.sum() > 0.0:
        has_tree = upload_light_choice(data, lights, device, choice)
        data.lights = backend.array(lights.records, records.LightRecord, device.name)
        data.environment.light = lights.environment
    else:
        lights.first_lights[:] = -1
        data.lights = backend.zeros(0, records.LightRecord, device.name)
    if len(lights.shapes):
        data.light_shapes = backend.array(lights.shapes, records.LightShape, device.name)
        data.solid_light_shapes = lights.solid_count
        data.sun_light_shapes = lights.solid_count + lights.sun_count
    return has_tree


def _shape_records(
    scene: Scene, materials: MaterialTable, bodies: BodyTable, lights: LightTable, first_triangles: NDArray[np.int64]
) -> NDArray[Any]:
    """Return a ShapeRecord for each shape."""
    record = current_backend().kernels("wrt.kernels.core.scene_data").ShapeRecord
    records = np.zeros(len(scene.shapes), record.numpy_dtype())
    records["material"] = materials.of_shapes
    records["first_triangle"] = first_triangles
    records["smooth"] = [_is_smooth(shape) for shape in scene.shapes]
    records["first_light"] = lights.first_lights
    records["emission_slot"] = materials.emission_slots[: len(scene.shapes)]
    for record, shape in zip(records, scene.shapes, strict=True):
        if record["emission_slot"] < 0:
            record["emission"] = shape.emission
    records["two_sided"] = [shape.two_sided_emission for shape in scene.shapes]
    records["body"] = bodies.of_shapes
    return records


def _is_smooth(shape: Shape) -> bool:
    """Return whether a shape has vertex normals, at any time."""
    deforms = shape.deformation is not None and shape.deformation.normals is not None
    return deforms or shape.mesh.normals is not None


def _upload_geometry(
    data: Any, layout: Layout, places: _Places, device: Device, *, textured: bool, uv2_alpha: bool
) -> None:
    """Upload all meshes."""
    name, copies = device.name, places.copies
    data.points, data.indices = upload_triangles(copies, places.faces, places.first_vertices, name)
    data.corners = current_backend().view(data.indices, "vec3i", len(data.indices) // 3)
    data.normals = upload(joined(copies, "normals", 3, 0.0, name), "vec3", name)
    if textured:
        data.uvs = upload(joined(copies, "uvs", 2, 0.0, name), "vec2", name)
        data.colors = upload(joined(copies, "colors", 3, 1.0, name), "vec3", name)
    if uv2_alpha:
        more = [(columns(m, "uvs", 2, 4, 0.0), columns(m, "colors", 3, 4, 1.0)) for m in copies]
        data.uv2_alpha = upload(np.concatenate([np.concatenate(each, axis=1) for each in more]), "vec3", name)
    shape_numbers = np.array([*layout.world_shapes, *[-1] * len(layout.shared)], np.int32)
    data.triangle_shape = upload(numbered(shape_numbers, places.counts), int, name)


def _build_trees(data: Any, layout: Layout, places: _Places, device: Device) -> WorldMeshes:
    """Build the world's tree and those of shared meshes, and return the meshes in the world's tree."""
    count = len(layout.world_meshes)
    first_vertices = places.first_vertices.tolist()
    tree = None
    if count:
        data.bvh = (tree := build_bvh(data.points, data.indices[: 3 * int(places.counts[:count].sum())], device)).data
    if layout.instances:
        pools = list(zip(first_vertices[count:], places.first_triangles[count:].tolist(), strict=True))
        data.placed = place(layout, pools, tree, data.points, device)
    first = dict(zip(layout.world_shapes, first_vertices[:count], strict=True))
    return WorldMeshes(device, data, tree, first, alone=not layout.instances)
