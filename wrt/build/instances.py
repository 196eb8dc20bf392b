"""Two levels of trees on a device: the host's side of `kernels/instances.py`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrt.build.bvh import BuiltBvh, build_bvh, build_upper_tree, refit_bvh
from wrt.build.geometry import upload_triangles
from wrt.device import Device
from wrt.errors import InputError
from wrt.mesh import Mesh


class PlacedTrees:
    """Meshes with a tree each, and where they stand.

    Attributes:
        data: the InstanceTree struct that kernels take.
        triangles: triangles of all instances together.
        bytes: memory of all trees and of the meshes.
    """

    def __init__(self, meshes: Sequence[Mesh], numbers: ArrayLike, transforms: ArrayLike, device: Device) -> None:
        """Build a tree for each mesh, and one over the instances.

        Args:
            meshes: the distinct meshes.
            numbers: (N,) which mesh each instance is, N at least 1.
            transforms: (N, 4, 4) or (N, 3, 4) affine matrices from the mesh's space to the world.
            device: where to build.

        Raises:
            InputError: on arrays of other shapes, mesh numbers out of range, matrices that are not
                finite or not invertible, or more triangles than an int counts.
        """
        self._device = device
        self._numbers = np.asarray(numbers)
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
        self._geometry = [upload_triangles([mesh], device.name) for mesh in meshes]
        self._trees = [build_bvh(points, indices, device) for points, indices in self._geometry]
        self._place(matrices)

    @property
    def meshes(self) -> int:
        """How many distinct meshes there are."""
        return len(self._trees)

    @property
    def bytes(self) -> int:
        """Memory of the trees, the points and the indices, and of the instances."""
        from wrt.kernels.instances import InstanceRecord

        size: int = sum(
            tree.bytes + 12 * len(p) + 4 * len(i) for tree, (p, i) in zip(self._trees, self._geometry, strict=True)
        )
        return (
            size + 4 * len(self.data.nodes) + len(self._numbers) * int(np.dtype(InstanceRecord.numpy_dtype()).itemsize)
        )

    def move(self, transforms: ArrayLike) -> None:
        """Put the instances elsewhere: (N, 4, 4) or (N, 3, 4) as before."""
        self._place(self._matrices(transforms))

    def refit(self, mesh: int, points: Any) -> None:
        """Let a mesh's tree follow its vertices, (V,) vec3 on the device."""
        self._geometry[mesh] = (points, self._geometry[mesh][1])
        refit_bvh(self._trees[mesh], points, self._geometry[mesh][1], self._device)
        self._place(self._transforms)

    def points(self, mesh: int) -> Any:
        """Return a mesh's vertices on the device."""
        return self._geometry[mesh][0]

    def _matrices(self, transforms: ArrayLike) -> NDArray[np.float64]:
        matrices = np.asarray(transforms, np.float64)
        n = len(self._numbers)
        if matrices.shape not in ((n, 4, 4), (n, 3, 4)) or not np.isfinite(matrices).all():
            raise InputError(f"transforms must be ({n}, 4, 4) finite numbers, not {matrices.shape}")
        flat = np.flatnonzero(np.linalg.det(matrices[:, :3, :3]) == 0.0)
        if len(flat):
            raise InputError(f"the transform of instance {flat[0]} is not invertible")
        # Kernels have both directions in float32.
        with np.errstate(over="ignore"):
            both = np.concatenate([matrices[:, :3, :3], np.linalg.inv(matrices[:, :3, :3])], axis=1).astype(np.float32)
        extreme = np.flatnonzero(~np.isfinite(both).all(axis=(1, 2)))
        if len(extreme):
            raise InputError(f"the transform of instance {extreme[0]} scales by over 1e38 or by under 1e-38")
        return matrices[:, :3]

    def _place(self, transforms: NDArray[np.float64]) -> None:
        """Upload the instances and build the tree over them."""
        import warp as wp

        from wrt.kernels.bvh import Bvh
        from wrt.kernels.instances import InstanceRecord, InstanceTree

        self._transforms = transforms
        inverse = np.linalg.inv(transforms[:, :, :3])
        records = np.zeros(len(transforms), InstanceRecord.numpy_dtype())
        records["mesh"] = self._numbers
        records["first_triangle"] = self._first_triangles
        records["linear"] = inverse
        records["offset"] = -np.einsum("nij,nj->ni", inverse, transforms[:, :, 3])
        bounds = np.stack([_bounds_now(tree) for tree in self._trees])[self._numbers]
        lower, upper = _world_boxes(bounds, transforms)
        self.data = InstanceTree()
        self.data.nodes = build_upper_tree(lower, upper, self._device)
        self.data.instances = wp.array(records, dtype=InstanceRecord, device=self._device.name)
        self.data.meshes = wp.array([tree.data for tree in self._trees], dtype=Bvh, device=self._device.name)


def _bounds_now(tree: BuiltBvh) -> NDArray[np.float64]:
    """Return (2, 3) the bounds of a tree, which may have been refitted."""
    root = tree.data.nodes[:48].numpy().reshape(2, 3, 8).astype(np.float64)
    return np.stack([root[0].min(axis=1), root[1].max(axis=1)])


def _world_boxes(bounds: NDArray[np.float64], transforms: NDArray[np.float64]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the float32 boxes around transformed boxes, wider by what moving a ray into a mesh's space rounds."""
    center, half = bounds.mean(axis=1), 0.5 * (bounds[:, 1] - bounds[:, 0])
    middle = np.einsum("nij,nj->ni", transforms[:, :, :3], center) + transforms[:, :, 3]
    reach = np.einsum("nij,nj->ni", np.abs(transforms[:, :, :3]), half)
    size = np.abs(np.einsum("nij,nj->ni", np.abs(transforms[:, :, :3]), np.abs(center))) + np.abs(transforms[:, :, 3])
    slack = 8.0 * np.finfo(np.float32).eps * (size + reach)
    return (middle - reach - slack).astype(np.float32), (middle + reach + slack).astype(np.float32)
