"""How high the studio's ground may be under what stands on it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wrt.linalg import determinant, product
from wrt.scene.mesh import Mesh
from wrt.scene.scene import Shape

_FLAT = 1e-5
"""Greatest height above the lowest point at which triangles lie on the ground, in sizes of the shapes."""

_DROP = 2.0**-13
"""How far below them the ground is, in sizes: a hundred times the error of a ray's hit in float32, and unseen."""

_OPEN = 0.01
"""Least share of a bottom that must be open to the sky to count as seen."""


def ground_height(shapes: list[Shape], lowest: float, size: float) -> float:
    """Return the height of a ground that is not in the same plane as a surface that is seen.

    The lower side of a closed body lies on the ground and is hidden. A road at the height of its kerb's bottom, or the
    floor of a room without a ceiling, is seen, and would be speckled with the ground.

    Args:
        shapes: what stands on the ground, with y up.
        lowest: the height of their lowest point, metres.
        size: their diagonal, metres.

    Returns:
        `lowest`, or a little less if triangles in that plane face up, or face down under the open sky.
    """
    facing_up = facing_down = 0.0  # area of the triangles in the lowest plane, times two
    for shape in shapes:
        mesh, up, height = _local(shape)
        flat = product(mesh.vertices.astype(np.float64), up) + height <= lowest + _FLAT * size
        if flat.any():
            areas = product(_areas(mesh, mesh.faces[flat[mesh.faces].all(axis=1)]), _area_row(shape))
            facing_up += float(areas[areas > 0.0].sum())
            facing_down -= float(areas[areas < 0.0].sum())
    if facing_up == facing_down == 0.0:
        return lowest
    if facing_up == 0.0:
        facing_up = -_upward_area(shapes)  # 0 for closed bodies
    return lowest - _DROP * size if facing_up > _OPEN * facing_down else lowest


def _local(shape: Shape) -> tuple[Mesh, NDArray[np.float64], float]:
    """Return a mesh, and the (3,) row and the offset that make heights in the world of its vertices."""
    if shape.deformation is not None:
        return shape.mesh_at(0.0), np.array([0.0, 1.0, 0.0]), 0.0
    matrix = shape.transform_at(0.0)
    return shape.mesh, matrix[1, :3], float(matrix[1, 3])


def _area_row(shape: Shape) -> NDArray[np.float64]:
    """Return the (3,) row that makes the upward part in the world of area vectors of `_local`'s mesh."""
    if shape.deformation is not None:
        return np.array([0.0, 1.0, 0.0])
    linear = shape.transform_at(0.0)[:3, :3]
    cofactors = np.cross(linear[2], linear[0])
    return cofactors if determinant(linear) > 0.0 else -cofactors  # a mirrored mesh keeps its front


def _areas(mesh: Mesh, faces: NDArray[np.int32]) -> NDArray[np.float64]:
    """Return (M, 3) area vectors of triangles, times two."""
    a, b, c = (mesh.vertices[faces[:, k]].astype(np.float64) for k in range(3))
    return np.cross(b - a, c - a)


def _upward_area(shapes: list[Shape]) -> float:
    """Return the sum of the upward parts of all area vectors, times two."""
    total, sums = 0.0, {}
    for shape in shapes:
        mesh, _, _ = _local(shape)
        if id(mesh) not in sums:
            sums[id(mesh)] = mesh, _areas(mesh, mesh.faces).sum(axis=0)  # holds the mesh, so that its id stays its own
        total += float(product(sums[id(mesh)][1], _area_row(shape)))
    return total
