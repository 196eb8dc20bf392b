"""Parallelograms of many triangles, flat or with bumps."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import wrt
from wrt.scene.normals import following_normals


def grid(corner: ArrayLike, u: ArrayLike, v: ArrayLike, count: int = 4, **attributes: Any) -> wrt.Mesh:
    """Return a parallelogram of count x count vertices, with texture coordinates."""
    a, b = (each.reshape(-1, 1) for each in np.meshgrid(*[np.linspace(0, 1, count)] * 2, indexing="ij"))
    i = (count * np.arange(count - 1)[:, None] + np.arange(count - 1)).reshape(-1, 1)
    faces = np.vstack([i + (0, count, count + 1), i + (0, count + 1, 1)])
    vertices = np.asarray(corner) + a * np.asarray(u) + b * np.asarray(v)
    return wrt.Mesh(vertices.astype(np.float32), faces, uvs=np.hstack([a, b]), **attributes)


def with_bumps(mesh: wrt.Mesh, height: float, axis: ArrayLike) -> wrt.Mesh:
    """Return a mesh whose vertices are moved along an axis at random, with normals."""
    bumps = np.random.default_rng(5).uniform(-height, height, (len(mesh.vertices), 1))
    moved = dataclasses.replace(mesh, vertices=mesh.vertices + (bumps * np.asarray(axis)).astype(np.float32))
    return dataclasses.replace(
        moved, normals=following_normals(dataclasses.replace(moved, normals=moved.vertices), moved.vertices)
    )
