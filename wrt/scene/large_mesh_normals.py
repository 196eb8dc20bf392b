"""Smooth normals of large meshes, computed on the device by `kernels/geometry/vertex_normals.py`.

The only module of `wrt.scene` that runs kernels. `with_normals` imports it for meshes that take NumPy seconds.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wrt.backend import current_backend
from wrt.backend.device import Device


def smooth_normals(
    vertices: NDArray[np.float32], faces: NDArray[np.int32], groups: NDArray[np.intp], size: float
) -> NDArray[np.float32]:
    """Return (N, 3) unit normals, weighted by angle as `wrt.scene.normals.with_normals` says; zero where they cancel.

    Args:
        vertices: (N, 3) positions.
        faces: (M, 3) vertex indices.
        groups: (N,) index of the group that shares a normal, for each vertex, numbered without gaps.
        size: extent of the mesh, metres.
    """
    backend = current_backend()
    kernels = backend.kernels("wrt.kernels.geometry.vertex_normals")
    device = Device()
    count = int(groups.max()) + 1
    # As many groups as vertices means that each vertex is its own group.
    shared = groups.astype(np.int32) if count < len(groups) else np.zeros(0, np.int32)
    points, indices, of_vertices = (
        backend.array(rows, dtype, device.name, copy=False)
        for rows, dtype in ((vertices, "vec3"), (faces.reshape(-1), int), (shared, int))
    )
    sums = device.empty_large(count, "vec4d")
    sums.zero_()
    device.launch(kernels.sum_normals, device.threads, [device.threads, points, 1.0 / size, indices, of_vertices, sums])
    normals = device.empty_large(len(vertices), "vec3")
    device.launch(kernels.write_normals, len(normals), [sums, of_vertices, normals])
    return np.asarray(normals.numpy())
