"""Smooth normals of large meshes: the host's side of `kernels/vertex_normals.py`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wrt.device import Device
from wrt.mesh import Mesh


def smooth_normals(mesh: Mesh, groups: NDArray[np.intp], size: float) -> NDArray[np.float32]:
    """Return (N, 3) unit normals, weighted by angle as `wrt.normals.with_normals` says; zero where they cancel.

    Args:
        mesh: whose vertices they are for.
        groups: (N,) for each vertex which ones it shares its normal with, numbered without gaps.
        size: of the mesh, metres.
    """
    import warp as wp

    from wrt.kernels import vertex_normals as k

    device = Device()
    count = int(groups.max()) + 1
    # Without gaps: as many groups as vertices are each vertex by itself.
    shared = groups.astype(np.int32) if count < len(groups) else np.zeros(0, np.int32)
    points, indices, of_vertices = (
        wp.array(rows, dtype=dtype, device=device.name, copy=False)
        for rows, dtype in ((mesh.vertices, wp.vec3), (mesh.faces.reshape(-1), int), (shared, int))
    )
    sums = device.empty_large(count, wp.vec4d)
    sums.zero_()
    device.launch(k.sum_normals, device.threads, [device.threads, points, 1.0 / size, indices, of_vertices, sums])
    normals = device.empty_large(len(mesh.vertices), wp.vec3)
    device.launch(k.write_normals, len(normals), [sums, of_vertices, normals])
    return np.asarray(normals.numpy())
