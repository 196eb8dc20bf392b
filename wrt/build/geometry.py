"""The triangles of several meshes as one."""

from __future__ import annotations

from typing import Any

import numpy as np

from wrt.errors import InputError
from wrt.mesh import Mesh


def upload_triangles(meshes: list[Mesh], device: str) -> tuple[Any, Any]:
    """Return the meshes' vertices and faces on a device: arrays of vec3 and of int, three a triangle.

    Vertices and triangles are numbered through, mesh after mesh.

    Raises:
        InputError: where they are more than an int counts.
    """
    import warp as wp

    counts = [len(m.vertices) for m in meshes]
    if sum(counts) >= 2**31 or 3 * sum(len(m.faces) for m in meshes) >= 2**31:
        raise InputError("there are more than 2^31 triangle corners or vertices")
    first = np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int32)
    if len(meshes) == 1:
        points, indices = meshes[0].vertices, meshes[0].faces
    else:
        points = np.concatenate([m.vertices for m in meshes])
        indices = np.concatenate([m.faces + start for m, start in zip(meshes, first, strict=True)])
    return wp.array(points, dtype=wp.vec3, device=device), wp.array(indices.ravel(), dtype=int, device=device)
