"""Meshes whose vertices change between pictures: their arrays, their normals and the world's ray tree follow."""

from __future__ import annotations

from typing import Any

import numpy as np

from wrt.build.bvh import BuiltBvh, refit_bvh
from wrt.build.geometry import device_vectors, first_not_finite
from wrt.device import Device
from wrt.errors import InputError
from wrt.mesh import Mesh
from wrt.normals import same_positions
from wrt.scene import Shape


class WorldMeshes:
    """The shapes in the world's own tree, on a device."""

    def __init__(
        self, device: Device, data: Any, tree: BuiltBvh | None, first_vertices: dict[int, int], *, alone: bool
    ) -> None:
        """Take a scene's arrays.

        Args:
            device: where they are.
            data: the SceneData struct that holds them.
            tree: the world's tree.
            first_vertices: number of the first vertex of each shape that is in it, by the shape's number.
            alone: whether there is no tree above it.
        """
        self._device, self._data, self._tree, self._first = device, data, tree, first_vertices
        self._alone = alone
        self._own = False
        self._corners: dict[int, tuple[Any, Any]] = {}

    def update(self, number: int, shape: Shape, vertices: Any, normals: Any) -> None:
        """Move a shape's vertices.

        Args:
            number: which shape.
            shape: its description, whose faces and smoothness stay.
            vertices: (N, 3) NumPy array, or Warp array of vec3 on the device.
            normals: likewise, or None: those of a smooth mesh are computed anew then.

        Raises:
            InputError: on arrays of other sizes, values that are not finite, or shapes that cannot be updated.
        """
        import warp as wp

        if number not in self._first or self._tree is None or not self._alone:
            raise InputError(
                f"{shape.name}: vertices can be updated in scenes without instances and without shapes in motion; "
                "make a new Renderer"
            )
        if shape.emits:
            raise InputError(f"{shape.name}: vertices of what gives off light cannot be updated; make a new Renderer")
        first, count = self._first[number], len(shape.mesh.vertices)
        points = self._given(f"{shape.name}: vertices", vertices, count)
        bad = first_not_finite(points, self._device)
        if bad >= 0:
            raise InputError(f"{shape.name}: vertex {bad} is not finite")
        if not self._own:  # the scene's meshes may share them
            self._data.points, self._data.normals = wp.clone(self._data.points), wp.clone(self._data.normals)
            self._own = True
        wp.copy(self._data.points, points, dest_offset=first, count=count)
        if normals is not None:
            given = self._given(f"{shape.name}: normals", normals, count)
            wp.copy(self._data.normals, given, dest_offset=first, count=count)
            if shape.mesh.normals is None:
                shapes = self._data.shapes.numpy()
                shapes["smooth"][number] = True
                self._data.shapes.assign(shapes)
        elif shape.mesh.normals is not None:
            self._smooth(number, shape.mesh, first, count)
        refit_bvh(self._tree, self._data.points, self._data.indices, self._device)

    def _given(self, name: str, values: Any, count: int) -> Any:
        array = device_vectors(name, values, self._device.name)
        if len(array) != count:
            raise InputError(f"{name} are {len(array)}, but the mesh has {count}")
        return array

    def _smooth(self, number: int, mesh: Mesh, first: int, count: int) -> None:
        """Compute normals from the faces around each vertex; what had one normal still has one."""
        import warp as wp

        from wrt.kernels.mesh_normals import smooth_normals

        if number not in self._corners:
            assert mesh.normals is not None
            groups = same_positions(np.hstack([mesh.vertices, mesh.normals]))
            of_corners = groups[mesh.faces.ravel()]
            order = np.argsort(of_corners, kind="stable").astype(np.int32)
            starts = np.searchsorted(of_corners[order], np.arange(groups.max() + 2)).astype(np.int32)
            # A corner's number is that of its face times three, plus its place there.
            upload = [starts[groups], starts[groups + 1], order, mesh.faces.ravel() + np.int32(first)]
            self._corners[number] = tuple(wp.array(a, dtype=int, device=self._device.name) for a in upload)
        self._device.launch(
            smooth_normals, count, [first, *self._corners[number], self._data.points, self._data.normals]
        )
