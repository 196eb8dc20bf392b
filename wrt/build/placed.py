"""The instances of a scene on the device: trees of shared meshes, records, and upper trees over the time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.build.bvh import build_bvh, refit_bvh
from wrt.build.instances import instance_records, instance_tree, placed_mesh, round_trip, world_boxes
from wrt.build.layout import Layout, SharedMesh
from wrt.build.motion import motion_records, swept_boxes
from wrt.device import Device
from wrt.errors import InputError
from wrt.mesh import Mesh
from wrt.motion import Motion

FloatArray = NDArray[np.float64]

MOST_SLICES = 32
"""Slices into which the time is cut at most; each has an upper tree of its own."""

WORTH_SLICING = 1.1
"""How much larger the boxes of moving instances may be, by surface, than in twice as many slices."""


def place(layout: Layout, pools: list[tuple[int, int]], world: Any, points: Any, device: Device) -> Any:
    """Return the InstanceTree struct of a scene.

    Args:
        layout: with instances.
        pools: number of the first vertex and of the first triangle of each shared mesh.
        world: the BuiltBvh over all triangles that are in the world already, or None where there are none.
        points: all vertices on the device.
        device: where to build.
    """
    import warp as wp

    from wrt.kernels.motion import MotionKey, MotionRecord

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
    data.motion_keys = wp.array(keys, dtype=MotionKey, device=device.name)
    data.motions = wp.array(motion_data, dtype=MotionRecord, device=device.name)
    all_times = np.concatenate([mesh.times for mesh in layout.shared])
    data.key_times = wp.array(all_times, dtype=float, device=device.name)
    return data


def _shared_tree(mesh: SharedMesh, first_vertex: int, first_time: int, points: Any, device: Device) -> Any:
    """Return the PlacedMesh of a shared mesh; of one that changes its shape, the same tree fitted to each key."""
    import warp as wp

    count = len(mesh.keys[0].vertices)
    indices = wp.array(mesh.keys[0].faces.ravel(), dtype=int, device=device.name)

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
        wp.copy(nodes, built.data.nodes, dest_offset=key * placed.node_stride, count=placed.node_stride)
        wp.copy(leaves, built.data.leaves, dest_offset=key * placed.leaf_stride, count=placed.leaf_stride)
    placed.bvh.nodes, placed.bvh.leaves = nodes, leaves
    return placed


def _records(layout: Layout, pools: list[tuple[int, int]], has_world: bool) -> tuple[NDArray[Any], list[Motion]]:
    """Return the InstanceRecords, the world's first, and the motions that they name."""
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
    own = records
    if has_world:
        records["round_trip"][0] = 0.0
        own = records[1:]
    own["mesh"] = [instance.mesh + has_world for instance in layout.instances]
    own["shape"] = [instance.shape for instance in layout.instances]
    own["first_triangle"] = [pools[instance.mesh][1] for instance in layout.instances]
    for record, instance in zip(own, layout.instances, strict=True):
        if isinstance(instance.transform, Motion):
            record["motion"] = motion_numbers[id(instance.transform)]
            linear = instance.transform.at(np.linspace(*layout.shutter, 65))[:, :3, :3]
            # The map is worked out from the keys anew for each ray, which rounds a few times more.
            record["round_trip"] = 2.0 * round_trip(linear).max() + 2.0
    return records, motions


def _boxes(layout: Layout, world: Any) -> tuple[tuple[float, float], NDArray[np.float32]]:
    """Return the times that slices cut evenly, and the (S, N, 2, 3) boxes of the instances in each slice."""
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
    still = np.setdiff1d(np.arange(len(layout.instances)), changing)
    if len(still):
        numbers = np.array([layout.instances[i].mesh for i in still])
        matrices = np.stack([layout.instances[i].transform for i in still])
        bounds = np.stack([mesh.keys[0].bounds for mesh in layout.shared])
        radii = np.array([_radius(mesh.keys[0], b.mean(axis=0)) for mesh, b in zip(layout.shared, bounds, strict=True)])
        boxes[:, has_world + still] = _still_boxes(bounds[numbers], radii[numbers], matrices)
    forms: dict[int, tuple[FloatArray, float]] = {}
    for i in changing:
        instance = layout.instances[i]
        mesh = layout.shared[instance.mesh]
        if instance.mesh not in forms:
            bounds = np.stack([key.bounds for key in mesh.keys])
            forms[instance.mesh] = bounds, max(map(_radius, mesh.keys, bounds.mean(axis=1)))
        motion = instance.transform
        if not isinstance(motion, Motion):
            motion = Motion(np.zeros(1), motion[None])
        boxes[:, has_world + i] = swept_boxes(motion, mesh.times, *forms[instance.mesh], layout.shutter, slices)
    if changing:
        boxes = _join_slices(boxes, has_world + np.array(changing))
    return layout.shutter, boxes


def _radius(mesh: Mesh, center: FloatArray) -> float:
    return float(np.linalg.norm(mesh.vertices - center, axis=1).max())


def _still_boxes(bounds: FloatArray, radii: FloatArray, matrices: FloatArray) -> NDArray[np.float32]:
    """Return (N, 2, 3) boxes around what lies both in boxes and in balls around their centres."""
    around_box = world_boxes(bounds, matrices)
    # The ball's image is an ellipsoid, which reaches as far along an axis as that row of the matrix is long.
    center = world_boxes(np.repeat(bounds.mean(axis=1, keepdims=True), 2, axis=1), matrices)
    reach = (1.0 + 1e-6) * radii[:, None] * np.linalg.norm(matrices[:, :3, :3], axis=2)
    low = np.maximum(around_box[:, 0], (center[:, 0] - reach).astype(np.float32))
    return np.stack([low, np.minimum(around_box[:, 1], (center[:, 1] + reach).astype(np.float32))], axis=1)


def _join_slices(boxes: NDArray[np.float32], changing: NDArray[np.int64]) -> NDArray[np.float32]:
    """Return boxes of half as many slices as long as that makes those of what moves little larger."""

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
