"""Upload the instances of a scene: trees of shared meshes, instance records, and top-level trees over time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.backend import current_backend
from wrt.backend.device import Device
from wrt.errors import InputError
from wrt.scene.mesh import Mesh
from wrt.scene.motion import Motion
from wrt.upload.accel.bvh import build_bvh, refit_bvh
from wrt.upload.accel.instances import instance_records, instance_tree, placed_mesh, round_trip, world_boxes
from wrt.upload.accel.instancing import Layout, SharedMesh
from wrt.upload.accel.swept_boxes import swept_boxes
from wrt.upload.camera import motion_records

FloatArray = NDArray[np.float64]

MOST_SLICES = 32
"""Most time slices of the exposure; each has its own top-level tree."""

WORTH_SLICING = 1.1
"""Two slices are joined unless that grows the boxes of moving instances by more than this factor in area."""


def place(layout: Layout, pools: list[tuple[int, int]], world: Any, points: Any, device: Device) -> Any:
    """Return the InstanceTree struct of a scene.

    Args:
        layout: the layout of the scene, with instances.
        pools: numbers of the first vertex and the first triangle of each shared mesh.
        world: the BuiltBvh of the world's triangles, or None if there are none.
        points: all vertices on the device.
        device: the device.
    """
    backend = current_backend()
    motion = backend.kernels("wrt.kernels.core.motion")

    trees = [placed_mesh(world)] if world is not None else []
    first_time = 0
    for mesh, (first_vertex, _) in zip(layout.shared, pools, strict=True):
        trees.append(_shared_tree(mesh, first_vertex, first_time, points, device))
        first_time += len(mesh.times)
    records, motions = _records(layout, pools, world is not None)
    times, boxes = _boxes(layout, world)
    data = instance_tree(trees, records, boxes, device)
    data.first_slice = times[0]
    data.slices_per_second = len(boxes) / (times[1] - times[0]) if times[1] > times[0] else 0.0
    keys, motion_data = motion_records(motions)
    data.motion_keys = backend.array(keys, motion.MotionKey, device.name)
    data.motions = backend.array(motion_data, motion.MotionRecord, device.name)
    all_times = np.concatenate([mesh.times for mesh in layout.shared])
    data.key_times = backend.array(all_times, float, device.name)
    return data


def _shared_tree(mesh: SharedMesh, first_vertex: int, first_time: int, points: Any, device: Device) -> Any:
    """Return the PlacedMesh of a shared mesh, with a tree refitted to each key if it deforms."""
    backend = current_backend()

    count = len(mesh.keys[0].vertices)
    indices = backend.array(mesh.keys[0].faces.ravel(), int, device.name)

    def own_points(key: int) -> Any:
        return points[first_vertex + key * count : first_vertex + (key + 1) * count]

    keys = len(mesh.keys)
    built = build_bvh(own_points(keys // 2), indices, device)
    placed = placed_mesh(built)
    if keys == 1:
        return placed
    placed.keys, placed.first_time, placed.vertex_stride = keys, first_time, count
    placed.node_stride, placed.leaf_stride = len(built.data.nodes), len(built.data.leaves)
    if keys * max(placed.node_stride, placed.leaf_stride) >= 2**31:
        raise InputError(f"{keys} copies of a ray tree over {len(indices) // 3} triangles are more than 32 bits count")
    nodes = device.empty_large(keys * placed.node_stride)
    leaves = device.empty_large(keys * placed.leaf_stride)
    for key in range(keys):
        refit_bvh(built, own_points(key), indices, device)
        backend.copy(nodes, built.data.nodes, dest_offset=key * placed.node_stride, count=placed.node_stride)
        backend.copy(leaves, built.data.leaves, dest_offset=key * placed.leaf_stride, count=placed.leaf_stride)
    placed.bvh.nodes, placed.bvh.leaves = nodes, leaves
    return placed


def _records(layout: Layout, pools: list[tuple[int, int]], has_world: bool) -> tuple[NDArray[Any], list[Motion]]:
    """Return the InstanceRecords, the first for the world, and their motions."""
    transforms = [np.eye(4)] if has_world else []
    motions: list[Motion] = []
    motion_numbers: dict[int, int] = {}
    for instance in layout.instances:
        if isinstance(instance.transform, Motion):
            if id(instance.transform) not in motion_numbers:
                motion_numbers[id(instance.transform)] = len(motions)
                motions.append(instance.transform)
            transforms.append(instance.transform.at(layout.shutter[0]))
        else:
            transforms.append(instance.transform)
    records = instance_records(np.stack(transforms))
    placed = records
    if has_world:
        records["round_trip"][0] = 0.0
        placed = records[1:]
    placed["mesh"] = [instance.mesh + has_world for instance in layout.instances]
    placed["shape"] = [instance.shape for instance in layout.instances]
    placed["first_triangle"] = [pools[instance.mesh][1] for instance in layout.instances]
    for record, instance in zip(placed, layout.instances, strict=True):
        if isinstance(instance.transform, Motion):
            record["motion"] = motion_numbers[id(instance.transform)]
            linear = instance.transform.at(np.linspace(*layout.shutter, 65))[:, :3, :3]
            # Interpolating the transform for each ray adds a few roundings.
            record["round_trip"] = 2.0 * round_trip(linear).max() + 2.0
    return records, motions


def _boxes(layout: Layout, world: Any) -> tuple[tuple[float, float], NDArray[np.float32]]:
    """Return the exposure, which is sliced evenly, and the (S, N, 2, 3) boxes of the instances in each slice."""
    has_world = world is not None
    count = has_world + len(layout.instances)
    changing = [
        i
        for i, instance in enumerate(layout.instances)
        if isinstance(instance.transform, Motion) or len(layout.shared[instance.mesh].keys) > 1
    ]
    slices = MOST_SLICES if changing else 1
    boxes = np.empty((slices, count, 2, 3), np.float32)
    if has_world:
        boxes[:, 0] = world_boxes(world.bounds, np.eye(4))
    bounds = [np.stack([key.bounds for key in mesh.keys]) for mesh in layout.shared]
    radii = [
        max(map(_radius, mesh.keys, of_keys.mean(axis=1))) for mesh, of_keys in zip(layout.shared, bounds, strict=True)
    ]
    still = np.setdiff1d(np.arange(len(layout.instances)), changing)
    if len(still):
        numbers = [layout.instances[i].mesh for i in still]
        matrices = np.stack([layout.instances[i].transform for i in still])
        first_bounds = np.stack([of_keys[0] for of_keys in bounds])
        boxes[:, has_world + still] = _still_boxes(first_bounds[numbers], np.array(radii)[numbers], matrices)
    for i in changing:
        instance = layout.instances[i]
        k, motion = instance.mesh, instance.transform
        if not isinstance(motion, Motion):
            motion = Motion(np.zeros(1), motion[None])
        times = layout.shared[k].times
        boxes[:, has_world + i] = swept_boxes(motion, times, bounds[k], radii[k], layout.shutter, slices)
    if changing:
        boxes = _join_slices(boxes, has_world + np.array(changing))
    return layout.shutter, boxes


def _radius(mesh: Mesh, center: FloatArray) -> float:
    return float(np.linalg.norm(mesh.vertices - center, axis=1).max())


def _still_boxes(bounds: FloatArray, radii: FloatArray, matrices: FloatArray) -> NDArray[np.float32]:
    """Return (N, 2, 3) boxes around the intersections of boxes with spheres around their centres."""
    around_box = world_boxes(bounds, matrices)
    # A sphere becomes an ellipsoid, whose extent along an axis is the length of that row of the matrix.
    center = world_boxes(np.repeat(bounds.mean(axis=1, keepdims=True), 2, axis=1), matrices)
    reach = (1.0 + 1e-6) * radii[:, None] * np.linalg.norm(matrices[:, :3, :3], axis=2)
    low = np.maximum(around_box[:, 0], (center[:, 0] - reach).astype(np.float32))
    return np.stack([low, np.minimum(around_box[:, 1], (center[:, 1] + reach).astype(np.float32))], axis=1)


def _join_slices(boxes: NDArray[np.float32], changing: NDArray[np.int64]) -> NDArray[np.float32]:
    """Halve the number of slices as long as the boxes of moving instances grow little."""

    def size(b: NDArray[np.float32]) -> float:
        x, y, z = np.moveaxis(b[:, changing, 1].astype(np.float64) - b[:, changing, 0], 2, 0)
        return float((x * y + y * z + z * x).mean())

    while len(boxes) > 1:
        a, b = boxes[0::2], boxes[1::2]
        joined = np.stack([np.minimum(a[:, :, 0], b[:, :, 0]), np.maximum(a[:, :, 1], b[:, :, 1])], axis=2)
        if size(joined) > WORTH_SLICING * size(boxes):
            break
        boxes = joined
    return boxes
