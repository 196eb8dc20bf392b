"""The triangles of several meshes as one, and vectors that a person gives, on a device."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.device import Device, zeros
from wrt.errors import InputError
from wrt.mesh import Mesh


def upload_meshes(meshes: Sequence[Mesh], device: str) -> tuple[Any, Any]:
    """Return the meshes' vertices and faces on a device, vertices and triangles numbered through, mesh after mesh.

    Raises:
        InputError: where they are more than an int counts.
    """
    counts = np.array([len(mesh.vertices) for mesh in meshes])
    return upload_triangles(meshes, meshes, np.cumsum(counts) - counts, device)


def upload_triangles(
    vertices: Sequence[Mesh], faces: Sequence[Mesh], first_vertices: NDArray[np.int64], device: str
) -> tuple[Any, Any]:
    """Return vertices and faces on a device: arrays of vec3 and of int, three a triangle.

    Args:
        vertices: meshes whose vertices are numbered through.
        faces: meshes whose triangles are numbered through.
        first_vertices: number of vertex 0 of each of the latter.
        device: where to.

    Raises:
        InputError: where they are more than an int counts.
    """
    import warp as wp

    if sum(len(m.vertices) for m in vertices) >= 2**31 or 3 * sum(len(m.faces) for m in faces) >= 2**31:
        raise InputError("there are more than 2^31 triangle corners or vertices")
    indices = zeros((sum(len(m.faces) for m in faces), 3), np.int32)
    stop = 0
    for mesh, first in zip(faces, first_vertices.tolist(), strict=True):
        start, stop = stop, stop + len(mesh.faces)
        np.add(mesh.faces, np.int32(first), out=indices[start:stop])
        if device == "cpu" and first == 0:
            mesh.share("faces", indices[start:stop])
    points = joined(vertices, "vertices", 3, 0.0, device)
    return upload(points, wp.vec3, device), upload(indices.reshape(-1), int, device)


def joined(meshes: Sequence[Mesh], name: str, width: int, default: float, device: str) -> NDArray[np.float32]:
    """Return an array of the first columns of all vertices' `name`, `default` where a mesh has none.

    What is to be uploaded to the CPU, meshes share, whose own arrays cannot be written to: so it is in memory once.
    """
    rows = zeros((sum(len(mesh.vertices) for mesh in meshes), width), np.float32)
    stop = 0
    for mesh in meshes:
        start, stop = stop, stop + len(mesh.vertices)
        own = getattr(mesh, name)
        if own is not None:
            rows[start:stop] = own[:, :width]
            if own.shape[1] == width and device == "cpu":
                mesh.share(name, rows[start:stop])
        elif default:  # zeros that nobody writes take no memory
            rows[start:stop] = default
    return rows


def numbered(numbers: NDArray[np.int32], counts: NDArray[np.int64]) -> NDArray[np.int32]:
    """Return each number as many times as `counts` says; where it is 0, memory is taken only when it is written to."""
    rows = zeros((int(counts.sum()),), np.int32)
    for number, stop, count in zip(numbers.tolist(), np.cumsum(counts).tolist(), counts.tolist(), strict=True):
        if number:
            rows[stop - count : stop] = number
    return rows


def upload(rows: NDArray[Any], dtype: Any, device: str) -> Any:
    """Return an array on a device; on the CPU the very memory that is given, which nobody else may write to."""
    import warp as wp

    return wp.array(rows, dtype=dtype, device=device, copy=False)


def device_vectors(name: str, value: Any, device: str) -> Any:
    """Return an array of vec3 on the device; neither a Warp array there nor, on the CPU, a float32 one is copied.

    Args:
        name: for messages.
        value: (N, 3) NumPy array, or Warp array of vec3.
        device: "cpu" or "cuda:N".

    Raises:
        InputError: on arrays of other shapes or kinds, or elsewhere.
    """
    import warp as wp

    if isinstance(value, wp.array):
        if value.dtype is not wp.vec3 or value.ndim != 1 or str(value.device) != device:
            raise InputError(f"{name} must be a Warp array of vec3 on {device}, of one dimension")
        return value.contiguous()
    try:
        rows = np.ascontiguousarray(value, dtype=np.float32)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be numbers") from None
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise InputError(f"{name} must be (N, 3), not {rows.shape}")
    return wp.array(rows, dtype=wp.vec3, device=device, copy=False)


def first_not_finite(points: Any, device: Device) -> int:
    """Return the number of the first of device vectors that is not finite, −1 where all are."""
    import warp as wp

    from wrt.kernels.bvh_refit import find_not_finite

    found = wp.full(1, -1, dtype=int, device=device.name)
    device.launch(find_not_finite, len(points), [points, found])
    return int(found.numpy()[0])
