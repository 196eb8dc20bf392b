"""From a Scene to SceneData: everything flattened, checked and uploaded once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from wrt.build.alias import make_alias_table
from wrt.build.bvh import build_bvh
from wrt.build.environment import environment_kind, resolve_environment, upload_environment
from wrt.build.geometry import upload_triangles
from wrt.build.lights import light_table
from wrt.build.materials import describe_materials
from wrt.device import Device
from wrt.errors import InputError
from wrt.mesh import Mesh
from wrt.scene import Scene


@dataclass(frozen=True)
class BuiltScene:
    """A scene on a device.

    Attributes:
        data: the SceneData struct that kernels take.
        features: what the scene uses, to choose the kernel by.
    """

    data: Any
    features: Any


def build_scene(scene: Scene, device: Device, *, texture_coordinates: bool = False) -> BuiltScene:
    """Upload a scene to a device and build its ray tree there.

    Args:
        scene: what to upload.
        device: where to.
        texture_coordinates: whether these are asked for even where no material does.

    Raises:
        InputError: where the scene has no shapes, or more triangles or vertices than an int counts.
    """
    import warp as wp

    from wrt.kernels.features import Features
    from wrt.kernels.scene_data import LightRecord, LightShape, SceneData, ShapeRecord

    if not scene.shapes:
        raise InputError("the scene has no shapes to render")
    meshes = [shape.mesh for shape in scene.shapes]
    materials = describe_materials(
        [shape.material for shape in scene.shapes], [shape.emission for shape in scene.shapes]
    )
    data = SceneData()
    _upload_geometry(
        data, meshes, device.name, textured=materials.textured or materials.tangents or texture_coordinates
    )
    data.bvh = build_bvh(data.points, data.indices, device).data
    materials.upload(data, device)

    counts = np.array([len(m.faces) for m in meshes])
    first_triangles = np.concatenate([[0], np.cumsum(counts)[:-1]])
    data.triangle_shape = wp.array(
        np.repeat(np.arange(len(meshes), dtype=np.int32), counts), dtype=int, device=device.name
    )

    environment, sky_lights = resolve_environment(scene.environment)
    data.environment, flux = upload_environment(environment, device.name)
    lights = light_table(scene.shapes, [*scene.lights, *sky_lights], first_triangles, flux)
    if lights.weights.sum() > 0.0:
        table = make_alias_table(lights.weights)
        lights.records["probability"] = table.probabilities
        data.light_thresholds = wp.array(table.thresholds, dtype=float, device=device.name)
        data.light_aliases = wp.array(table.aliases, dtype=int, device=device.name)
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
    shapes["first_light"] = lights.first_lights
    shapes["emission_slot"] = materials.emission_slots
    for row, shape in zip(shapes, scene.shapes, strict=True):
        if row["emission_slot"] < 0:
            row["emission"] = shape.emission
    shapes["two_sided"] = [shape.two_sided_emission for shape in scene.shapes]
    data.shapes = wp.array(shapes, dtype=ShapeRecord, device=device.name)

    features = Features(
        materials.models,
        materials.textured,
        environment_kind(environment),
        layered=materials.layered,
        tangents=materials.tangents,
        light_shapes=len(lights.shapes) > 0,
    )
    return BuiltScene(data, features)


def _upload_geometry(data: Any, meshes: list[Mesh], device: str, *, textured: bool) -> None:
    import warp as wp

    vertex_counts = [len(m.vertices) for m in meshes]
    data.points, data.indices = upload_triangles(meshes, device)

    def attribute(name: str, width: int, default: float) -> np.ndarray:
        arrays = [getattr(m, name) for m in meshes]
        return np.concatenate(
            [
                np.full((n, width), default, np.float32) if a is None else a
                for a, n in zip(arrays, vertex_counts, strict=True)
            ]
        )

    data.normals = wp.array(attribute("normals", 3, 0.0), dtype=wp.vec3, device=device)
    if textured:
        data.uvs = wp.array(attribute("uvs", 2, 0.0), dtype=wp.vec2, device=device)
        data.colors = wp.array(attribute("colors", 3, 1.0), dtype=wp.vec3, device=device)
