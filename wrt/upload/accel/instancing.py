"""Decide which shapes go into the world's tree, and which meshes become instances with their own tree."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from wrt.scene.deformation import Deformation
from wrt.scene.mesh import Mesh
from wrt.scene.motion import Motion
from wrt.scene.scene import Scene, Shape

WORTH_SHARING = 4096
"""A mesh gets its own tree if its instances have more triangles than this in total. Fewer are traced faster in the
world's tree, and take little more memory there."""


@dataclass
class SharedMesh:
    """A mesh with a tree of its own.

    Attributes:
        keys: the mesh at each of `times`; a single one unless it deforms.
        times: seconds.
    """

    keys: list[Mesh]
    times: NDArray[np.float64]


@dataclass
class Instance:
    """An instance of a shared mesh.

    Attributes:
        shape: number of the shape.
        mesh: number of the shared mesh.
        transform: (4, 4) from the mesh's space to the world, or a motion.
    """

    shape: int
    mesh: int
    transform: NDArray[np.float64] | Motion


@dataclass
class Layout:
    """The shapes of a scene, sorted into the world's tree and instances.

    Attributes:
        world_shapes: numbers of the shapes in the world's tree.
        world_meshes: their meshes, in world space.
        shared: meshes with trees of their own.
        instances: the instances of those.
        shutter: begin and end of the exposure, seconds.
    """

    shutter: tuple[float, float]
    world_shapes: list[int] = field(default_factory=list)
    world_meshes: list[Mesh] = field(default_factory=list)
    shared: list[SharedMesh] = field(default_factory=list)
    instances: list[Instance] = field(default_factory=list)

    @property
    def times(self) -> tuple[float, float, float]:
        """When the shutter opens, is half way, and closes, seconds."""
        opens, closes = self.shutter
        return opens, 0.5 * (opens + closes), closes

    @property
    def instance_numbers(self) -> dict[int, int]:
        """The number of each placed shape's record on the device; the world's triangles, if any, are instance 0."""
        first = int(bool(self.world_shapes))
        return {instance.shape: number for number, instance in enumerate(self.instances, first)}

    @property
    def kind(self) -> str:
        """The value of `Features.instances`."""
        if not self.instances:
            return "none"
        if any(len(mesh.keys) > 1 for mesh in self.shared):
            return "deforming"
        return "moving" if any(isinstance(instance.transform, Motion) for instance in self.instances) else "still"


def is_moving(shape: Shape, shutter: tuple[float, float]) -> bool:
    """Return whether a shape moves or deforms while the shutter is open."""
    return isinstance(_transform(shape, shutter), Motion) or _changes(shape.deformation, shutter)


def lay_out(scene: Scene) -> Layout:
    """Return the layout of a scene.

    The world's tree holds shapes without a transform, meshes with one static instance, and meshes with few triangles in
    all instances. Other meshes have a tree of their own: they move or deform while the shutter is open, or have several
    instances.
    """
    camera = scene.camera
    shutter = (camera.shutter_open, camera.shutter_close) if camera is not None else (0.0, 0.0)
    layout = Layout(shutter)
    transforms = [_transform(shape, shutter) for shape in scene.shapes]
    deforms = [_changes(shape.deformation, shutter) for shape in scene.shapes]
    keys = [(id(shape.mesh), id(shape.deformation)) for shape in scene.shapes]
    places: dict[tuple[int, int], int] = {}
    for key, transform in zip(keys, transforms, strict=True):
        if transform is not None:
            places[key] = places.get(key, 0) + 1
    numbers: dict[tuple[int, int], int] = {}
    still: dict[tuple[int, int], Mesh] = {}
    for i, (shape, transform) in enumerate(zip(scene.shapes, transforms, strict=True)):
        key = keys[i]
        copies = places.get(key, 0)
        shares = transform is not None and copies > 1 and copies * len(shape.mesh.faces) > WORTH_SHARING
        if not (shares or deforms[i] or isinstance(transform, Motion)):
            if key not in still:
                still[key] = shape.mesh
                if shape.deformation is not None:
                    still[key] = shape.deformation.at(shutter[0], shape.mesh)
            layout.world_shapes.append(i)
            layout.world_meshes.append(still[key] if transform is None else still[key].transformed(transform))
            continue
        if key not in numbers:
            numbers[key] = len(layout.shared)
            layout.shared.append(_shared(shape, deforms[i], shutter))
        layout.instances.append(Instance(i, numbers[key], np.eye(4) if transform is None else transform))
    return layout


def _transform(shape: Shape, shutter: tuple[float, float]) -> NDArray[np.float64] | Motion | None:
    """Return a shape's transform; a matrix if it does not move while the shutter is open."""
    motion = shape.transform
    if not isinstance(motion, Motion):
        return motion
    moves = motion.moves and _overlap(motion.times, shutter)
    return motion if moves else motion.at(shutter[0])


def _changes(deformation: Deformation | None, shutter: tuple[float, float]) -> bool:
    """Return whether a mesh deforms while the shutter is open."""
    return deformation is not None and _overlap(deformation.times, shutter)


def _overlap(times: NDArray[np.float64], shutter: tuple[float, float]) -> bool:
    return bool(shutter[0] < shutter[1] and times[0] < shutter[1] and shutter[0] < times[-1])


def _shared(shape: Shape, deforms: bool, shutter: tuple[float, float]) -> SharedMesh:
    if shape.deformation is None:
        return SharedMesh([shape.mesh], np.zeros(1))
    if not deforms:
        return SharedMesh([shape.deformation.at(shutter[0], shape.mesh)], np.zeros(1))
    return SharedMesh(shape.deformation.keys_of(shape.mesh), shape.deformation.times)
