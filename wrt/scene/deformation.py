"""Deformation of meshes by keyframes of their vertices."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.scene.mesh import Mesh
from wrt.scene.motion import segments
from wrt.scene.normals import following_normals
from wrt.scene.tangents import following_tangents
from wrt.values import key_times, owned, sealed


@dataclass(frozen=True, eq=False)
class Deformation:
    """Keyframes of vertices, interpolated linearly; before the first and after the last nothing moves.

    Attributes:
        times: (K,) seconds, ascending; at least one.
        vertices: (K, N, 3) float32 positions, metres, in the mesh's own space; they replace the mesh's.
        normals: (K, N, 3) float32 shading normals; by default recomputed for each key if the mesh has normals.

    Raises:
        InputError: if shapes are wrong, values are not finite, or times do not ascend.
    """

    times: NDArray[np.float64]
    vertices: NDArray[np.float32] = field(repr=False)
    normals: NDArray[np.float32] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        times = sealed(key_times(self.times, "deformation"))
        object.__setattr__(self, "times", times)
        for name in ("vertices", "normals"):
            value = getattr(self, name)
            if value is None:
                continue
            with np.errstate(over="ignore"):
                array = owned(value, f"deformation {name}", np.float32)
            if array.ndim != 3 or array.shape[0] != len(times) or array.shape[2] != 3:
                raise InputError(f"deformation {name} must be ({len(times)}, N, 3), a set per key, not {array.shape}")
            if not np.isfinite(array).all():
                raise InputError(f"deformation {name} must be finite")
            object.__setattr__(self, name, array)
        if self.normals is not None and self.normals.shape != self.vertices.shape:
            vertices, normals = self.vertices.shape[1], self.normals.shape[1]
            raise InputError(f"a deformation of {vertices} vertices has {normals} normals per key")

    def keys_of(self, mesh: Mesh) -> list[Mesh]:
        """Return the mesh at each key."""
        normals: list[NDArray[np.float32] | None] = [None] * len(self.times)
        if self.normals is not None:
            normals = list(self.normals)
        elif mesh.normals is not None:
            normals = [following_normals(mesh, vertices) for vertices in self.vertices]
        return [
            _moved(mesh, vertices, normals_of_key)
            for vertices, normals_of_key in zip(self.vertices, normals, strict=True)
        ]

    def at(self, time: float, mesh: Mesh) -> Mesh:
        """Return the mesh at a time in seconds."""
        first, share = (float(a[0]) for a in segments(self.times, np.array([float(time)])))
        keys = self.keys_of(mesh)[int(first) : int(first) + 2]
        arrays = []
        for name in ("vertices", "normals"):
            a, b = getattr(keys[0], name), getattr(keys[-1], name)
            arrays.append(None if a is None else ((1.0 - share) * a.astype(np.float64) + share * b).astype(np.float32))
        vertices, normals = arrays
        assert vertices is not None
        return _moved(mesh, vertices, normals)


def _moved(mesh: Mesh, vertices: NDArray[np.float32], normals: NDArray[np.float32] | None) -> Mesh:
    """Return a mesh with other vertices and normals, whose tangents follow them."""
    tangents = None if mesh.tangents is None else following_tangents(mesh, vertices)
    return Mesh(vertices, mesh.faces, normals, mesh.uvs, mesh.colors, mesh.name, tangents, mesh.sides)
