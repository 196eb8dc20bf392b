"""Build two-level trees on a device: the host side of `kernels/core/ray_tree.py`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrt.backend import current_backend
from wrt.backend.device import Device
from wrt.errors import InputError
from wrt.linalg import determinant, inverse, product
from wrt.scene.mesh import Mesh
from wrt.upload.accel.bvh import BuiltBvh, build_bvh, build_upper_tree, refit_bvh
from wrt.upload.accel.geometry import upload_meshes
from wrt.values import array

FloatArray = NDArray[np.float64]


class PlacedTrees:
    """Meshes with a tree each, and their instances.

    Attributes:
        data: the InstanceTree struct that kernels take.
        triangles: triangles of all instances together.
    """

    def __init__(self, meshes: Sequence[Mesh], numbers: ArrayLike, transforms: ArrayLike, device: Device) -> None:
        """Build a tree for each mesh, and one over the instances.

        Args:
            meshes: the distinct meshes.
            numbers: (N,) the mesh of each instance, N at least 1.
            transforms: (N, 4, 4) or (N, 3, 4) affine matrices from mesh space to world space.
            device: the device.

        Raises:
            InputError: on arrays of other shapes, mesh numbers out of range, matrices that are not
                finite, not affine or not invertible, or more triangles than 32 bits can count.
        """
        self._device = device
        self._numbers = array(numbers, "numbers")
        if self._numbers.ndim != 1 or len(self._numbers) == 0 or self._numbers.dtype.kind not in "iu":
            raise InputError("numbers must be a list of mesh numbers, one an instance, at least one")
        if self._numbers.min() < 0 or self._numbers.max() >= len(meshes):
            raise InputError(f"mesh numbers must be 0 to {len(meshes) - 1}")
        counts = np.array([len(mesh.faces) for mesh in meshes], np.int64)[self._numbers]
        self.triangles = int(counts.sum())
        if self.triangles >= 2**31:
            raise InputError(f"{self.triangles} triangles in all instances are more than an int counts")
        self._first_triangles = np.cumsum(counts) - counts
        matrices = self._matrices(transforms)
        self._geometry = [upload_meshes([mesh], device.name) for mesh in meshes]
        self._trees = [build_bvh(points, indices, device) for points, indices in self._geometry]
        self._place(matrices)

    @property
    def meshes(self) -> int:
        """Number of distinct meshes."""
        return len(self._trees)

    @property
    def bytes(self) -> int:
        """Memory of the trees, the points, the indices and the instances."""
        record = current_backend().kernels("wrt.kernels.core.ray_tree").InstanceRecord.numpy_dtype()
        size = 4 * len(self.data.nodes) + len(self._numbers) * int(np.dtype(record).itemsize)
        for tree, (points, indices) in zip(self._trees, self._geometry, strict=True):
            size += tree.bytes + 12 * len(points) + 4 * len(indices)
        return size

    def move(self, transforms: ArrayLike) -> None:
        """Move the instances to new transforms, (N, 4, 4) or (N, 3, 4)."""
        self._place(self._matrices(transforms))

    def refit(self, mesh: int, points: Any) -> None:
        """Refit the tree of a mesh to its vertices, (V,) vec3 on the device."""
        self._geometry[mesh] = (points, self._geometry[mesh][1])
        refit_bvh(self._trees[mesh], points, self._geometry[mesh][1], self._device)
        self._place(self._transforms)

    def points(self, mesh: int) -> Any:
        """Return a mesh's vertices on the device."""
        return self._geometry[mesh][0]

    def _matrices(self, transforms: ArrayLike) -> FloatArray:
        matrices = array(transforms, "transforms", np.float64)
        n = len(self._numbers)
        if matrices.shape not in ((n, 4, 4), (n, 3, 4)) or not np.isfinite(matrices).all():
            raise InputError(f"transforms must be ({n}, 4, 4) finite numbers, not {matrices.shape}")
        projective = np.flatnonzero((matrices[:, 3:] != (0.0, 0.0, 0.0, 1.0)).any(axis=(1, 2)))
        if len(projective):
            raise InputError(f"the transform of instance {projective[0]} must be affine: its last row must be 0 0 0 1")
        singular = np.flatnonzero(determinant(matrices[:, :3, :3]) == 0.0)
        if len(singular):
            raise InputError(f"the transform of instance {singular[0]} is not invertible")
        # Kernels hold the matrix and its inverse in float32.
        with np.errstate(over="ignore"):
            rounded = np.concatenate([matrices[:, :3, :3], inverse(matrices[:, :3, :3])], axis=1).astype(np.float32)
        extreme = np.flatnonzero(~np.isfinite(rounded).all(axis=(1, 2)))
        if len(extreme):
            raise InputError(f"the transform of instance {extreme[0]} scales by over 1e38 or by under 1e-38")
        return matrices[:, :3]

    def _place(self, transforms: FloatArray) -> None:
        """Upload the instances and build the tree over them."""
        self._transforms = transforms
        records = instance_records(transforms)
        records["mesh"] = self._numbers
        records["first_triangle"] = self._first_triangles
        bounds = np.stack([tree.bounds for tree in self._trees])[self._numbers]
        trees = [placed_mesh(tree) for tree in self._trees]
        self.data = instance_tree(trees, records, world_boxes(bounds, transforms)[None], self._device)


def instance_records(transforms: FloatArray) -> NDArray[Any]:
    """Return InstanceRecords of (N, 3, 4) or (N, 4, 4) transforms to world space, still without mesh and triangles."""
    instances = current_backend().kernels("wrt.kernels.core.ray_tree")

    linear, position = transforms[:, :3, :3], transforms[:, :3, 3]
    to_mesh = inverse(linear)
    records = np.zeros(len(transforms), instances.InstanceRecord.numpy_dtype())
    records["linear"] = to_mesh
    records["offset"] = -np.einsum("nij,nj->ni", to_mesh, position)
    with np.errstate(over="ignore"):
        records["to_world"], records["position"] = linear, position
    records["side"] = np.where(determinant(linear) < 0.0, -1.0, 1.0)
    records["round_trip"] = round_trip(linear)
    records["motion"] = records["shape"] = -1
    return records


def round_trip(linear: FloatArray) -> FloatArray:
    """Return the bound ‖|M| |M⁻¹|‖ of (..., 3, 3) matrices on the growth of rounding errors in a round trip."""
    return np.asarray(product(np.abs(linear), np.abs(inverse(linear))).sum(axis=-1).max(axis=-1))


def placed_mesh(tree: BuiltBvh) -> Any:
    """Return the PlacedMesh of a tree over a rigid mesh."""
    instances = current_backend().kernels("wrt.kernels.core.ray_tree")

    mesh = instances.PlacedMesh()
    mesh.bvh = tree.data
    mesh.keys = 1
    return mesh


def instance_tree(meshes: Sequence[Any], records: NDArray[Any], boxes: NDArray[np.float32], device: Device) -> Any:
    """Return the InstanceTree struct of instances, without data on their motion.

    Args:
        meshes: PlacedMesh structs.
        records: (N,) InstanceRecords.
        boxes: (S, N, 2, 3) float32 boxes of the instances in each time slice.
        device: the device.
    """
    backend = current_backend()
    node_floats = backend.kernels("wrt.kernels.native.constants").NODE_FLOATS
    instances = backend.kernels("wrt.kernels.core.ray_tree")

    name = device.name
    trees = [build_upper_tree(slice_boxes[:, 0], slice_boxes[:, 1], device) for slice_boxes in boxes]
    counts = np.array([len(nodes) // node_floats for nodes in trees], np.int64)
    if counts.sum() * node_floats >= 2**31:
        raise InputError(f"ray trees over {len(records)} instances are larger than 32-bit offsets reach")
    data = instances.InstanceTree()
    data.nodes = trees[0]
    if len(trees) > 1:
        data.nodes = device.empty_large(int(counts.sum()) * node_floats)
        for nodes, first in zip(trees, np.cumsum(counts) - counts, strict=True):
            backend.copy(data.nodes, nodes, dest_offset=int(first) * node_floats, count=len(nodes))
    data.slice_nodes = backend.array(np.cumsum(counts) - counts, int, name)
    data.instances = backend.array(records, instances.InstanceRecord, name)
    structs = backend.array(list(meshes), instances.PlacedMesh, name)
    structs._ref = meshes  # keep the memory alive that the array points to
    data.meshes = structs
    return data


def world_boxes(bounds: FloatArray, transforms: FloatArray, roundings: float = 8.0) -> NDArray[np.float32]:
    """Return float32 boxes around transformed boxes, padded by the rounding error of transforming a ray.

    Args:
        bounds: (..., 2, 3) boxes in mesh space.
        transforms: (..., 3, 4) or (..., 4, 4) transforms to world space.
        roundings: number of roundings of the largest intermediate value.
    """
    linear, position = np.abs(transforms[..., :3, :3]), transforms[..., :3, 3]
    center, half = bounds.mean(axis=-2), 0.5 * (bounds[..., 1, :] - bounds[..., 0, :])
    middle = np.einsum("...ij,...j->...i", transforms[..., :3, :3], center) + position
    reach = np.einsum("...ij,...j->...i", linear, half)
    size = np.einsum("...ij,...j->...i", linear, np.abs(center)) + np.abs(position)
    slack = roundings * np.finfo(np.float32).eps * (size + reach)
    return np.stack([middle - reach - slack, middle + reach + slack], axis=-2).astype(np.float32)
