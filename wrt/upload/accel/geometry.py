"""Upload the triangles of several meshes as one array, and vectors that the user gives."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.backend import current_backend
from wrt.backend.device import Device
from wrt.backend.memory import zeros
from wrt.errors import InputError
from wrt.scene.exact.analytic import Analytic
from wrt.scene.mesh import Mesh, sides_of
from wrt.scene.tangents import tangents_by_edges
from wrt.upload.arrays import require_countable
from wrt.values import refuse_masked


def upload_meshes(meshes: Sequence[Mesh], device: str) -> tuple[Any, Any]:
    """Upload the vertices and faces of meshes, one mesh after the other.

    Raises:
        InputError: when there are more than 32 bits can count.
    """
    counts = np.array([len(mesh.vertices) for mesh in meshes])
    return upload_triangles(meshes, meshes, np.cumsum(counts) - counts, device)


def upload_triangles(
    vertices: Sequence[Mesh], faces: Sequence[Mesh], first_vertices: NDArray[np.int64], device: str
) -> tuple[Any, Any]:
    """Upload vertices and faces: arrays of vec3 and of int, three a triangle.

    Args:
        vertices: meshes whose vertices are joined.
        faces: meshes whose triangles are joined.
        first_vertices: offset of the vertices of each mesh in `faces`.
        device: the device.

    Raises:
        InputError: when there are more than 32 bits can count.
    """
    require_countable(sum(len(m.vertices) for m in vertices), "vertices of the scene")
    require_countable(3 * sum(len(m.faces) for m in faces), "corners of the scene's triangles")
    indices = zeros((sum(len(m.faces) for m in faces), 3), np.int32)
    stop = 0
    for mesh, first in zip(faces, first_vertices.tolist(), strict=True):
        start, stop = stop, stop + len(mesh.faces)
        np.add(mesh.faces, np.int32(first), out=indices[start:stop])
        if device == "cpu" and first == 0:
            mesh.share("faces", indices[start:stop])
    points = joined(vertices, "vertices", 3, 0.0, device)
    return upload(points, "vec3", device), upload(indices.reshape(-1), int, device)


def joined(meshes: Sequence[Mesh], name: str, width: int, default: float, device: str) -> NDArray[np.float32]:
    """Join the first `width` columns of a vertex array of all meshes; `default` stands for a missing array.

    On the CPU the meshes share the joined array from then on, so that it is in memory only once.
    """
    rows = zeros((sum(len(mesh.vertices) for mesh in meshes), width), np.float32)
    stop = 0
    for mesh in meshes:
        start, stop = stop, stop + len(mesh.vertices)
        values = getattr(mesh, name)
        if values is not None:
            rows[start:stop] = values[:, :width]
            if values.shape[1] == width and device == "cpu":
                mesh.share(name, rows[start:stop])
        elif default:  # untouched zero pages take no memory
            rows[start:stop] = default
    return rows


def corner_tangents(meshes: Sequence[Mesh]) -> NDArray[np.float32]:
    """Return (3M, 4) `tangents_by_edges` of all meshes, zero where there are none."""
    rows = zeros((3 * sum(len(mesh.faces) for mesh in meshes), 4), np.float32)
    stop = 0
    for mesh in meshes:
        start, stop = stop, stop + 3 * len(mesh.faces)
        if mesh.tangents is not None:
            rows[start:stop] = tangents_by_edges(mesh).reshape(-1, 4)
    return rows


def drawn_sides(meshes: Sequence[Mesh]) -> NDArray[np.int32]:
    """Return (M,) `Mesh.sides` of all meshes; exact shapes have none."""
    return np.concatenate([sides_of(mesh) * np.int32(not isinstance(mesh, Analytic)) for mesh in meshes])


def numbered(numbers: NDArray[np.int32], counts: NDArray[np.int64]) -> NDArray[np.int32]:
    """Repeat each number as `counts` says; untouched zero pages take no memory."""
    rows = zeros((int(counts.sum()),), np.int32)
    for number, stop, count in zip(numbers.tolist(), np.cumsum(counts).tolist(), counts.tolist(), strict=True):
        if number:
            rows[stop - count : stop] = number
    return rows


def upload(rows: NDArray[Any], dtype: Any, device: str) -> Any:
    """Upload an array; on the CPU it is not copied, so nothing else may write to it."""
    return current_backend().array(rows, dtype, device, copy=False)


def is_warp_array(value: Any) -> bool:
    """Return whether a value is an array of Warp, which need not be imported."""
    warp = sys.modules.get("warp")
    return warp is not None and isinstance(value, warp.array)


def device_vectors(name: str, value: Any, device: str) -> Any:
    """Return an array of vec3 on the device, without copying Warp arrays there or, on the CPU, float32 ones.

    Args:
        name: name of the array in messages.
        value: (N, 3) NumPy array, or Warp array of vec3.
        device: "cpu" or "cuda:N".

    Raises:
        InputError: on arrays of other shapes or types, or on another device.
    """
    if is_warp_array(value):
        if value.dtype is not sys.modules["warp"].vec3 or value.ndim != 1 or str(value.device) != device:
            raise InputError(f"{name} must be a Warp array of vec3 on {device}, of one dimension")
        return current_backend().from_warp(value.contiguous(), "vec3")
    refuse_masked(value, name)
    try:
        rows = np.ascontiguousarray(value, dtype=np.float32)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be numbers") from None
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise InputError(f"{name} must be (N, 3), not {rows.shape}")
    return upload(rows, "vec3", device)


def first_outside(points: Any, limit: float, device: Device) -> int:
    """Return the index of the first vector of a device array with a NaN or a value beyond the limit, or −1."""
    backend = current_backend()
    refit = backend.kernels("wrt.kernels.accel.build.refit")

    found = backend.array([len(points)], int, device.name)
    device.launch(refit.find_outside, len(points), [points, limit, found])
    first = int(backend.fetch(found)[0])
    return -1 if first == len(points) else first
