"""Exact shapes of a scene that kernels can meet as such, and triangles in place of others."""

from __future__ import annotations

import dataclasses

import numpy as np

from wrt.scene.exact.analytic import Analytic
from wrt.scene.exact.quadrics import Quadrics
from wrt.scene.mesh import Mesh
from wrt.scene.motion import Motion
from wrt.scene.scene import Scene, Shape
from wrt.upload.accel.instancing import Layout


def with_exact_shapes(scene: Scene) -> Scene:
    """Return a scene in which exact shapes whose transform does not keep them are triangles."""
    cut: dict[int, Mesh] = {}

    def whole(shape: Shape) -> Shape:
        if not isinstance(shape.mesh, Analytic) or shape.transform is None:
            return shape
        motion = shape.transform
        if shape.mesh.keeps(motion.transforms if isinstance(motion, Motion) else motion[None]):
            return shape
        mesh = cut.setdefault(id(shape.mesh), shape.mesh.tessellated())
        return dataclasses.replace(shape, mesh=mesh)

    shapes = [whole(shape) for shape in scene.shapes]
    return dataclasses.replace(scene, shapes=shapes) if cut else scene


def mark_exact(layout: Layout) -> str:
    """Return which exact shapes a layout has, as `Features.exact` names them.

    See to it that no triangle is taken for one: a triangle whose third corner is its first is never hit; where there
    are exact shapes, its second becomes the same.
    """
    shared = [key for mesh in layout.shared for key in mesh.keys]
    exact = [mesh for mesh in (*layout.world_meshes, *shared) if isinstance(mesh, Analytic)]
    if not exact:
        return "none"
    layout.world_meshes[:] = [_without_needles([mesh])[0] for mesh in layout.world_meshes]
    for each in layout.shared:
        each.keys = _without_needles(each.keys)
    return "quadrics" if any(isinstance(mesh, Quadrics) for mesh in exact) else "spheres"


def _without_needles(keys: list[Mesh]) -> list[Mesh]:
    """Return meshes of the same faces, none of which has two equal corners where exact shapes have."""
    if isinstance(keys[0], Analytic):
        return keys
    faces = keys[0].faces
    found = np.zeros(len(faces), bool)
    for mesh in keys:
        found |= (mesh.vertices[faces[:, 0]] == mesh.vertices[faces[:, 2]]).all(axis=1)
    if not found.any():
        return keys
    faces = faces.copy()
    faces[found] = faces[found][:, :1]
    return [dataclasses.replace(mesh, faces=faces) for mesh in keys]
