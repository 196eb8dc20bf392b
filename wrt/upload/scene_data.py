"""Upload a Scene as SceneData, and build its trees."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wrt.backend import current_backend
from wrt.backend.device import Device
from wrt.backend.memory import MEMORY_ADVICE
from wrt.errors import InputError
from wrt.scene.camera import Camera
from wrt.scene.mesh import columns
from wrt.scene.scene import Scene
from wrt.upload.accel.bvh import build_bvh
from wrt.upload.accel.geometry import corner_tangents, drawn_sides, joined, numbered, upload, upload_triangles
from wrt.upload.accel.instancing import Layout
from wrt.upload.accel.scene_instances import place
from wrt.upload.bodies import bodies_around, set_camera_bodies
from wrt.upload.casters import CasterTable, light_places, upload_casters
from wrt.upload.memory import SceneMemory, tree_memory
from wrt.upload.prepare import PreparedScene
from wrt.upload.scene_values import SceneValues
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
        values: all else of the scene, which can be changed between pictures.
        device: the device.
        has_edges: whether it has the sides of triangles that are drawn as lines.
        casters: what photons are aimed at, if anything.
    """

    data: Any
    features: Any
    read: Any
    world: WorldMeshes
    values: SceneValues
    device: Device
    has_edges: bool
    casters: CasterTable | None

    def look_from(self, camera: Camera) -> None:
        """Find the bodies around a camera, in which its paths begin."""
        if self.features.bodies:
            set_camera_bodies(self.data, self.values.bodies, camera, self.features.geometry, self.device)


def _require_memory(prepared: PreparedScene, device: Device, texture_coordinates: bool) -> None:
    """Raise NotEnoughMemory if the device lacks memory for the upload.

    On the CPU only trees and their builder count, as it shares the other arrays with the scene.
    """
    if device.is_cpu:
        _, most, _ = tree_memory(prepared.layout, is_cpu=True)
        if most < WORTH_ASKING:
            return
    else:
        memory = SceneMemory(prepared, is_cpu=False, texture_coordinates=texture_coordinates)
        most = memory.lasting + memory.scratch
    triangles = sum(len(shape.mesh.faces) for shape in prepared.scene.shapes)
    device.require_memory(most, f"building a scene of {triangles:,} triangles", advice=MEMORY_ADVICE)


class SceneUpload:
    """A scene whose materials, lights and bodies are uploaded, and whose meshes are not yet.

    Attributes:
        features: the features of the scene, which choose its kernel. That can be compiled while `finish` runs.
        casters: what photons are aimed at, if anything.
    """

    def __init__(
        self,
        scene: Scene,
        device: Device,
        *,
        texture_coordinates: bool = False,
        edges: bool = False,
        light_choice: str = "auto",
        caustics: bool = False,
    ) -> None:
        """Upload all but the meshes.

        Args:
            scene: the scene.
            device: the device.
            texture_coordinates: whether to upload these even if no material needs them.
            edges: whether to upload which sides of triangles are drawn.
            light_choice: one of `wrt.upload.lights.choice.LIGHT_CHOICES`.
            caustics: whether to list what photons are aimed at, and to tell it apart.

        Raises:
            InputError: when the scene has no shapes, or more triangles or vertices than 32 bits can count.
        """
        self._prepared = prepared = PreparedScene(scene, caustics=caustics)
        self._device, self._texture_coordinates, self._edges = device, texture_coordinates, edges
        _require_memory(prepared, device, texture_coordinates)
        self._data = current_backend().kernels("wrt.kernels.core.scene_data").SceneData()
        self._places = _Places(prepared.layout)
        self._values = SceneValues(prepared, self._places.of_shapes, self._data, device, light_choice)
        self.features = self._values.features
        self.casters: CasterTable | None = None
        if caustics:
            self.casters = upload_casters(prepared.scene, prepared.layout, self._places.of_shapes, device.name)
            self.features = replace(self.features, caustics=self.casters is not None)

    def finish(self, read: Any = None) -> BuiltScene:
        """Upload the meshes and build their trees.

        Args:
            read: the features of the kernel that will read the scene, by default its own; it may have more (see
                `Features.covers`).
        """
        read = read or self.features
        data, device, layout, places = self._data, self._device, self._prepared.layout, self._places
        textured = read.textured or read.tangents or self._texture_coordinates
        data.needs = self._needs()
        _upload_geometry(data, layout, places, device, textured=textured, uv2_alpha=read.uv2_alpha)
        if self._prepared.has_tangents:
            data.aligns_tangents = 2
            data.tangents = upload(corner_tangents(places.faces), "vec4", device.name)
        if self._edges:
            data.edges = upload(drawn_sides(places.faces), int, device.name)
        world = _build_trees(data, layout, places, device)
        built = BuiltScene(data, self.features, read, world, self._values, device, self._edges, self.casters)
        if self._prepared.scene.camera is not None:
            built.look_from(self._prepared.scene.camera)
        if self.casters is not None and self.features.bodies:
            self._require_photons_outside(data)
        return built

    def _needs(self) -> int:
        """Return SceneData.needs."""
        k, own = current_backend().kernels("wrt.kernels.core.scene_data"), self.features
        needs = {
            k.NEEDS_COORDINATES: own.textured or own.tangents or self._texture_coordinates,
            k.NEEDS_MORE_COORDINATES: own.uv2_alpha,
            k.NEEDS_LEVELS: own.mipmapped,
            k.NEEDS_SIDES: own.single_sided,
            k.NEEDS_ATTENUATION: own.lets_light_pass,
            k.NEEDS_EXACT: own.has_exact,
            k.NEEDS_BODIES: own.bodies,
        }
        return sum(int(bit) for bit, is_needed in needs.items() if is_needed)

    def _require_photons_outside(self, data: Any) -> None:
        """Raise InputError if any light is in a body, where photons would begin as if in the open."""
        for time in sorted(set(self._prepared.layout.times)):
            for name, point in light_places(self._prepared.scene, time):
                if bodies_around(data, self._values.bodies, point, time, self.features.geometry, self._device):
                    raise InputError(f"caustics: {name} lies inside another body; render without caustics")


class _Places:
    """Offsets of the meshes of a layout in the common arrays; the world's meshes come first.

    Attributes:
        copies: meshes in the array of vertices; a deforming mesh has one for each key.
        faces: meshes in the array of triangles.
        first_vertices: number of the first vertex of each of `faces`.
        first_triangles: number of the first triangle of each of `faces`.
        counts: number of triangles of each of `faces`.
        of_shapes: first triangle of each shape.
    """

    def __init__(self, layout: Layout) -> None:
        world = layout.world_meshes
        self.copies = [*world, *(key for shared in layout.shared for key in shared.keys)]
        # All keys of a mesh share the faces of the first.
        self.faces = [*world, *(shared.keys[0] for shared in layout.shared)]
        bases = np.cumsum([0, *(len(m.vertices) for m in self.copies)])
        repeats = np.array([1] * len(world) + [len(shared.keys) for shared in layout.shared])
        self.first_vertices = bases[np.cumsum(repeats) - repeats]
        self.counts = np.array([len(m.faces) for m in self.faces])
        self.first_triangles = np.cumsum(self.counts) - self.counts
        self.of_shapes = np.empty(len(layout.world_shapes) + len(layout.instances), np.int64)
        self.of_shapes[layout.world_shapes] = self.first_triangles[: len(world)]
        for instance in layout.instances:
            self.of_shapes[instance.shape] = self.first_triangles[len(world) + instance.mesh]


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
        rows = [np.hstack([columns(m, "uvs", 2, 4, 0.0), columns(m, "colors", 3, 4, 1.0)]) for m in copies]
        data.uv2_alpha = upload(np.concatenate(rows), "vec3", name)
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
    return WorldMeshes(device, data, tree, first if not layout.instances else {})
