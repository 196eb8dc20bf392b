"""Tangents of meshes: moved by transforms, relative to triangles, and following triangles that move."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from wrt.linalg import determinant, product

if TYPE_CHECKING:
    from wrt.scene.mesh import Mesh

_Float = NDArray[np.float64]


def moved_tangents(tangents: NDArray[Any], linear: _Float) -> _Float:
    """Return (N, 4) tangents transformed by a (3, 3) matrix and made unit; mirrors turn the signs."""
    with np.errstate(all="ignore"):  # damaged files; checked with the mesh
        directions = _unit(product(tangents[:, :3].astype(np.float64), linear.T))
    sign = -1.0 if determinant(linear) < 0.0 else 1.0
    return np.column_stack([directions, sign * tangents[:, 3]])


def tangents_by_edges(mesh: Mesh) -> _Float:
    """Return (M, 3, 4) the tangents at the corners of a mesh, relative to each triangle; zero where there are none.

    They are the parts along the edges e1 and e2 and along the unit normal of the triangle, this one over √|e1 × e2|,
    and the sign of the bitangent about that normal.
    """
    assert mesh.tangents is not None
    e1, e2, normal, area = _edges(mesh.vertices, mesh.faces)
    given = mesh.tangents[mesh.faces].astype(np.float64)
    along = _unit(given[..., :3])
    sign = np.sign(given[..., 3]) * along.any(axis=2)
    if mesh.normals is not None:  # which may point either way
        sign *= np.where(np.einsum("mkj,mj->mk", mesh.normals[mesh.faces], normal) < 0.0, -1.0, 1.0)
    # Rows of the inverse of the matrix of e1, e2 and the scaled normal.
    inverse = [np.cross(e2, normal) / area, np.cross(normal, e1) / area, normal / np.sqrt(area)]
    return np.concatenate([np.einsum("imj,mkj->mki", inverse, along), sign[..., None]], axis=2)


def following_tangents(mesh: Mesh, vertices: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return (N, 4) unit tangents of a mesh whose vertices have moved: means over the triangles around each."""
    assert mesh.tangents is not None
    e1, e2, normal, area = _edges(vertices, mesh.faces)
    axes = np.stack([e1, e2, np.where(np.isfinite(area), np.sqrt(area), 0.0) * normal], axis=1)
    moved = _unit(np.einsum("mki,mij->mkj", tangents_by_edges(mesh)[..., :3], axes))
    sums = np.zeros((len(vertices), 3))
    np.add.at(sums, mesh.faces, moved)
    return np.column_stack([_unit(sums), mesh.tangents[:, 3]]).astype(np.float32)


def _edges(vertices: NDArray[np.float32], faces: NDArray[np.int32]) -> tuple[_Float, _Float, _Float, _Float]:
    """Return (M, 3) two edges of triangles, and their unit normals, and (M, 1) twice the area, infinite where it is 0.

    Rays do not meet triangles without area.
    """
    corners = vertices[faces].astype(np.float64)
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(e1, e2)
    area = np.linalg.norm(normal, axis=1, keepdims=True)
    area[area == 0.0] = np.inf
    return e1, e2, normal / area, area


def _unit(vectors: _Float) -> _Float:
    """Return vectors (..., 3) of length 1, or of length 0."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.where(length > 0.0, length, 1.0))
