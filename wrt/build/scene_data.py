"""From a Scene to SceneData: everything flattened, checked and uploaded once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrt.build.bodies import describe_bodies, set_camera_bodies
from wrt.build.bvh import build_bvh
from wrt.build.environment import environment_kind, resolve_environment, upload_environment
from wrt.build.geometry import joined, numbered, upload, upload_triangles
from wrt.build.layout import Layout, lay_out
from wrt.build.light_choice import upload_light_choice
from wrt.build.lights import light_table
from wrt.build.materials import describe_materials
from wrt.build.placed import place
from wrt.build.world import WorldMeshes
from wrt.device import Device
from wrt.errors import InputError
from wrt.mesh import LARGEST, SMALLEST, Mesh, columns
from wrt.scene import Scene, Shape


@dataclass(frozen=True)
class BuiltScene:
    """A scene on a device.

    Attributes:
        data: the SceneData struct that kernels take.
        features: what the scene uses, to choose the kernel by.
        world: the meshes in the world's own tree, whose vertices may change between pictures.
    """

    data: Any
    features: Any
    world: WorldMeshes


def _check_sizes(scene: Scene) -> None:
    """Raise InputError where meshes that stand where they are would be missed by every ray."""
    meshes = {id(shape.mesh): shape for shape in scene.shapes if shape.transform is None and shape.deformation is None}
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for shape in meshes.values():
        bounds = shape.mesh.bounds
        reach = float(np.abs(bounds).max())
        if not reach <= LARGEST:
            raise InputError(
                f"{shape.name}: its vertices reach to {reach:g}, beyond the {LARGEST:g} of rays; scale it down"
            )
        low, high = np.minimum(low, bounds[0]), np.maximum(high, bounds[1])
    size = float(np.linalg.norm(high - low)) if len(meshes) == len(scene.shapes) else np.inf
    if size < SMALLEST:
        what = f"the scene is {size:g} across" if size else "all vertices of the scene are in one place"
        raise InputError(f"{what}; rays need a size of {SMALLEST:g} at least; scale it up")


def build_scene(
    scene: Scene,
    device: Device,
    *,
    texture_coordinates: bool = False,
    light_choice: str = "auto",
    on_features: Callable[[Any], object] = lambda features: None,
) -> BuiltScene:
    """Upload a scene to a device and build its ray tree there.

    Args:
        scene: what to upload.
        device: where to.
        texture_coordinates: whether these are asked for even where no material does.
        light_choice: one of `wrt.build.light_choice.LIGHT_CHOICES`.
        on_features: called with them as soon as they are known, before the tree is built.

    Raises:
        InputError: where the scene has no shapes, or more triangles or vertices than an int counts.
    """
    import warp as wp

    from wrt.kernels.features import Features
    from wrt.kernels.scene_data import LightRecord, LightShape, SceneData, ShapeRecord

    if not scene.shapes:
        raise InputError("the scene has no shapes to render")
    _check_sizes(scene)
    layout = lay_out(scene)
    materials = describe_materials(
        [shape.material for shape in scene.shapes], [shape.emission for shape in scene.shapes]
    )
    data = SceneData()
    textured = materials.textured or materials.tangents or texture_coordinates
    places = _places(layout)
    first_triangles = places.of_shapes
    _upload_geometry(data, layout, places, device, textured=textured, extras=materials.extras)
    materials.upload(data, device)
    bodies = describe_bodies(scene)
    bodies.upload(data, device)

    environment, sky_lights = resolve_environment(scene.environment)
    data.environment, flux = upload_environment(environment, device.name)
    lights = light_table(scene.shapes, [*scene.lights, *sky_lights], layout, first_triangles, flux)
    light_tree = False
    if lights.weights.sum() > 0.0:
        light_tree = upload_light_choice(data, lights, device, light_choice)
        data.lights = wp.array(lights.records, dtype=LightRecord, device=device.name)
        data.environment.light = lights.environment
    else:
        lights.first_lights[:] = -1
        data.lights = wp.zeros(0, dtype=LightRecord, device=device.name)
    if len(lights.shapes):
        data.light_shapes = wp.array(lights.shapes, dtype=LightShape, device=device.name)
        data.solid_light_shapes = lights.solid_count
        data.sun_light_shapes = lights.solid_count + lights.sun_count

    shapes = np.zeros(len(scene.shapes), ShapeRecord.numpy_dtype())
    shapes["material"] = materials.of_shapes
    shapes["first_triangle"] = first_triangles
    shapes["smooth"] = [_is_smooth(shape) for shape in scene.shapes]
    shapes["first_light"] = lights.first_lights
    shapes["emission_slot"] = materials.emission_slots
    for row, shape in zip(shapes, scene.shapes, strict=True):
        if row["emission_slot"] < 0:
            row["emission"] = shape.emission
    shapes["two_sided"] = [shape.two_sided_emission for shape in scene.shapes]
    shapes["body"] = bodies.of_shapes
    data.shapes = wp.array(shapes, dtype=ShapeRecord, device=device.name)

    features = Features(
        materials.models,
        materials.textured,
        environment_kind(environment),
        layered=materials.layered,
        tangents=materials.tangents,
        light_shapes=len(lights.shapes) > 0,
        instances=layout.kind,
        light_tree=light_tree,
        media=bodies.kind,
        nested=bodies.nested,
        extras=materials.extras,
        mipmapped=materials.mipmapped,
    )
    on_features(features)
    world = _build_trees(data, layout, places, device)
    if features.bodies:
        set_camera_bodies(data, bodies, scene, features.instances, device)
    return BuiltScene(data, features, world)


class _Places(NamedTuple):
    """Where the vertices and triangles of a layout's meshes are among all, those in the world first.

    Attributes:
        copies: meshes whose vertices are numbered through.
        faces: meshes whose triangles are.
        first_vertices: of each of the latter.
        first_triangles: of each of the latter.
        counts: of their triangles.
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
    # All keys of a mesh have the faces of the first.
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


def _is_smooth(shape: Shape) -> bool:
    """Return whether a shape's vertices have normals, at any time."""
    deforms = shape.deformation is not None and shape.deformation.normals is not None
    return deforms or shape.mesh.normals is not None


def _upload_geometry(
    data: Any, layout: Layout, places: _Places, device: Device, *, textured: bool, extras: bool
) -> None:
    """Upload all meshes."""
    import warp as wp

    name, copies = device.name, places.copies
    data.points, data.indices = upload_triangles(copies, places.faces, places.first_vertices, name)
    data.corners = wp.array(ptr=data.indices.ptr, dtype=wp.vec3i, shape=len(data.indices) // 3, device=name)
    data.normals = upload(joined(copies, "normals", 3, 0.0, name), wp.vec3, name)
    if textured:
        data.uvs = upload(joined(copies, "uvs", 2, 0.0, name), wp.vec2, name)
        data.colors = upload(joined(copies, "colors", 3, 1.0, name), wp.vec3, name)
    if extras:
        more = [(columns(m, "uvs", 2, 4, 0.0), columns(m, "colors", 3, 4, 1.0)) for m in copies]
        data.extras = upload(np.concatenate([np.concatenate(each, axis=1) for each in more]), wp.vec3, name)
    shape_numbers = np.array([*layout.world_shapes, *[-1] * len(layout.shared)], np.int32)
    data.triangle_shape = upload(numbered(shape_numbers, places.counts), int, name)


def _build_trees(data: Any, layout: Layout, places: _Places, device: Device) -> WorldMeshes:
    """Build the world's tree and those of shared meshes over what was uploaded; return the meshes in the world."""
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
