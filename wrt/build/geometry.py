"""The triangles of several meshes as one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
    if len(vertices) == 1:
        points, indices = vertices[0].vertices, faces[0].faces
    else:
        first = first_vertices.astype(np.int32)
        points = np.concatenate([m.vertices for m in vertices])
        indices = np.concatenate([m.faces + start for m, start in zip(faces, first, strict=True)])
    return wp.array(points, dtype=wp.vec3, device=device), wp.array(indices.ravel(), dtype=int, device=device)
