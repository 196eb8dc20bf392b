"""Update vertices between frames, with the normals of the mesh and the world's ray tree."""

from __future__ import annotations

from typing import Any

import numpy as np

from wrt.backend.device import Device
from wrt.errors import InputError
from wrt.scene.exact.analytic import Analytic
from wrt.scene.mesh import LARGEST, Mesh
from wrt.scene.normals import same_positions
from wrt.scene.scene import Scene, Shape
from wrt.upload.accel.bvh import BuiltBvh, refit_bvh
from wrt.upload.accel.geometry import device_vectors, first_outside
from wrt.values import FLOAT32_MAX, integer


def shape_number(scene: Scene, shape: Shape | int) -> int:
    """Return the number of one of a scene's shapes, or raise InputError."""
    if not isinstance(shape, Shape) and not hasattr(shape, "__index__"):
        kind = type(shape).__name__
        raise InputError(
            f"shape must be one of the scene's shapes, as wrt.Scene.add returns it, or its number, not {kind}"
        )
    if not isinstance(shape, Shape):
        return integer(shape, "shape", minimum=0, maximum=len(scene.shapes) - 1)
    numbers = [i for i, each in enumerate(scene.shapes) if each is shape]
    if not numbers:
        raise InputError(f"{shape.name}: not one of the scene's shapes")
    return numbers[0]


class WorldMeshes:
    """The shapes in the world's tree, on a device.

    Attributes:
        first_vertices: the first vertex of shapes that can be updated, by number.
    """

    def __init__(self, device: Device, data: Any, tree: BuiltBvh | None, first_vertices: dict[int, int]) -> None:
        """Keep a SceneData struct, the world's tree, and the first vertex of shapes that can be updated by number."""
        self._device, self._data, self._tree, self.first_vertices = device, data, tree, first_vertices
        self._has_copies = False
        self._corners: dict[int, tuple[Any, ...]] = {}

    def require(self, number: int, shape: Shape) -> None:
        """Raise InputError unless a shape's vertices can be updated."""
        if number not in self.first_vertices or self._tree is None:
            raise InputError(
                f"{shape.name}: vertices can be updated in scenes without instances and without shapes in motion; "
                "make a new Renderer"
            )
        if isinstance(shape.mesh, Analytic):
            raise InputError(f"{shape.name}: exact shapes have no vertices to update; make a new Renderer")

    def update(self, number: int, shape: Shape, vertices: Any, normals: Any) -> None:
        """Move a shape's vertices: (N, 3) in NumPy, or a Warp array of vec3; normals likewise, or None.

        Without normals, those of a smooth mesh are recomputed.

        Raises:
            InputError: on arrays of other sizes, non-finite values, or shapes that cannot be updated.
        """
        self.require(number, shape)
        assert self._tree is not None
        first, count = self.first_vertices[number], len(shape.mesh.vertices)
        points = self._checked(shape.name, "vertices", "vertex", vertices, count, limit=LARGEST)
        if normals is not None:
            normals = self._checked(shape.name, "normals", "normal", normals, count, limit=FLOAT32_MAX)
        backend = self._device.backend
        if not self._has_copies:  # the scene's meshes may share the arrays
            self._data.points, self._data.normals = map(backend.clone, (self._data.points, self._data.normals))
            self._has_copies = True
        backend.copy(self._data.points, points, first, count)
        if normals is not None:
            backend.copy(self._data.normals, normals, first, count)
            if shape.mesh.normals is None:
                shapes = backend.fetch(self._data.shapes)
                shapes["smooth"][number] = True
                record = backend.kernels("wrt.kernels.core.scene_data").ShapeRecord
                self._data.shapes = backend.array(shapes, record, self._device.name)
        elif shape.mesh.normals is not None:
            self._smooth(number, shape.mesh, first, count)
        refit_bvh(self._tree, self._data.points, self._data.indices, self._device)

    def _checked(self, name: str, several: str, one: str, values: Any, count: int, *, limit: float) -> Any:
        """Return vectors on the device, or raise InputError unless there are `count`, all within a limit."""
        array = device_vectors(f"{name}: {several}", values, self._device.name)
        if len(array) != count:
            raise InputError(f"{name}: {several} are {len(array)}, but the mesh has {count}")
        bad = first_outside(array, limit, self._device)
        if bad >= 0:
            value = self._device.backend.fetch(array[bad : bad + 1])[0]
            if not np.isfinite(value).all():
                raise InputError(f"{name}: {one} {bad} is not finite")
            where = " ".join(f"{x:g}" for x in value)
            raise InputError(f"{name}: {one} {bad} is at {where}; rays reach to {limit:g}; scale it down")
        return array

    def _smooth(self, number: int, mesh: Mesh, first: int, count: int) -> None:
        """Compute normals from the faces around each vertex; vertices that shared a normal still do."""
        if number not in self._corners:
            assert mesh.normals is not None
            groups = same_positions(np.hstack([mesh.vertices, mesh.normals]))
            of_corners = groups[mesh.faces.ravel()]
            order = np.argsort(of_corners, kind="stable").astype(np.int32)
            starts = np.searchsorted(of_corners[order], np.arange(groups.max() + 2)).astype(np.int32)
            # Corners are numbered 3 * face + corner.
            upload = [starts[groups], starts[groups + 1], order, mesh.faces.ravel() + np.int32(first)]
            self._corners[number] = tuple(self._device.backend.array(a, int, self._device.name) for a in upload)
        kernel = self._device.backend.kernels("wrt.kernels.accel.build.refit").smooth_normals
        self._device.launch(kernel, count, [first, *self._corners[number], self._data.points, self._data.normals])
