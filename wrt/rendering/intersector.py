"""Intersect batches of rays with triangles, for users who want hits rather than pictures."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wrt.backend.device import Device
from wrt.errors import InputError
from wrt.scene.mesh import Mesh
from wrt.upload.accel.bvh import build_bvh, refit_bvh
from wrt.upload.accel.geometry import device_vectors, first_outside, is_warp_array, upload_meshes
from wrt.upload.accel.instances import PlacedTrees
from wrt.values import FLOAT32_MAX, integer, number

SMALL_BATCH = 4096
"""Smaller batches use the kernel that compiles fastest; the way of tracing hardly matters for them."""

LARGE_TREE = 128 * 2**20
"""Bytes of a tree above which packets stall on memory longer than interleaved single rays, measured."""

SPREAD = 0.05
"""Largest difference between neighbours, in unit directions and in origins over the extent, for packet tracing."""


class Hits(NamedTuple):
    """The hits of rays, one entry a ray, as NumPy or Warp arrays like the rays.

    Attributes:
        t: float32 distance in units of the direction; infinite for a miss.
        triangle: int32 number of the triangle; −1 for a miss.
        u: float32 weight of the triangle's second corner.
        v: float32 weight of its third corner; the first has 1 − u − v.
    """

    t: Any
    triangle: Any
    u: Any
    v: Any


class Intersector:
    """A ray tree over a mesh or a scene.

    Closed meshes are watertight: no ray passes between two triangles. Of triangles hit at the same distance, the one
    with the lowest number is reported, whatever the tree. Hits nearer than the rounding error of their own distance
    are left out, so a ray may start on a surface.

    Sizes from 10^-11 to 10^12 give the same hits bit for bit. Beyond, products of three coordinates underflow or
    overflow in float32, and triangles are missed.
    """

    def __init__(self, source: Any, *, device: str = "cpu", threads: int | None = None) -> None:
        """Build the tree.

        Args:
            source: a `wrt.Mesh`, a trimesh object, or a `wrt.Scene`, with triangles numbered shape after shape, as the
                shutter opens.
            device: "cpu", "cuda" or "cuda:N".
            threads: CPU threads; by default all cores.

        Raises:
            InputError: when there is nothing to hit, or the device does not exist.
        """
        self.device = Device(device, threads=threads)
        self._placed: PlacedTrees | None = None
        self._points, self._indices = upload_meshes(_meshes(source), self.device.name)
        self._built = build_bvh(self._points, self._indices, self.device)

    @classmethod
    def of_instances(
        cls,
        meshes: Sequence[Mesh],
        numbers: ArrayLike,
        transforms: ArrayLike,
        *,
        device: str = "cpu",
        threads: int | None = None,
    ) -> Intersector:
        """Return an intersector over instances of meshes; each mesh takes memory once.

        Triangles are numbered instance after instance.

        Args:
            meshes: the distinct meshes.
            numbers: (N,) the mesh of each instance.
            transforms: (N, 4, 4) affine matrices from mesh space to world space.
            device: "cpu", "cuda" or "cuda:N".
            threads: CPU threads; by default all cores.

        Raises:
            InputError: on exact shapes, arrays of other shapes, mesh numbers out of range, or matrices that are not
                finite, not affine or not invertible.
        """
        made = cls.__new__(cls)
        made.device = Device(device, threads=threads)
        made._placed = PlacedTrees([_triangles(mesh) for mesh in meshes], numbers, transforms, made.device)
        return made

    @property
    def triangles(self) -> int:
        """Number of triangles in all instances."""
        return self._placed.triangles if self._placed else len(self._indices) // 3

    @property
    def bytes_per_triangle(self) -> float:
        """Memory of the tree, points and indices per triangle."""
        if self._placed:
            return self._placed.bytes / self.triangles
        return (self._built.bytes + 12 * len(self._points) + 4 * len(self._indices)) / self.triangles

    def move(self, transforms: ArrayLike) -> None:
        """Move the instances; the trees of the meshes are kept.

        Args:
            transforms: (N, 4, 4) matrices as for `of_instances`.

        Raises:
            InputError: when there are no instances, or on matrices that `of_instances` rejects.
        """
        if self._placed is None:
            raise InputError("only instances can be moved; create the intersector with Intersector.of_instances")
        self._placed.move(transforms)

    def refit(self, vertices: Any, mesh: int = 0) -> None:
        """Refit the tree to moved vertices.

        Rays find all hits however far the vertices move, but tracing is fastest near the positions of the build.

        Args:
            vertices: (V, 3) NumPy array, or Warp array of vec3 on the device (not copied), as many as before.
            mesh: number of the mesh, if there are instances.

        Raises:
            InputError: on another number of vertices, or non-finite values.
        """
        if self._placed is None:
            self._points = self._moved(vertices, self._points)
            refit_bvh(self._built, self._points, self._indices, self.device)
        else:
            mesh = integer(mesh, "mesh", minimum=0, maximum=self._placed.meshes - 1)
            self._placed.refit(mesh, self._moved(vertices, self._placed.points(mesh)))

    def _moved(self, vertices: Any, before: Any) -> Any:
        """Return new vertices on the device, checked."""
        points = device_vectors("vertices", vertices, self.device.name)
        if len(points) != len(before):
            raise InputError(f"there are {len(points)} vertices, but the tree was built over {len(before)}")
        bad = first_outside(points, FLOAT32_MAX, self.device)
        if bad >= 0:
            place = self.device.backend.fetch(points[bad : bad + 1])[0]
            raise InputError(f"vertex {bad} is not finite: {place}")
        return points if is_warp_array(vertices) else self.device.backend.clone(points)

    def closest_hit(self, origins: Any, directions: Any, t_min: float = 0.0, t_max: Any = math.inf) -> Hits:
        """Return the nearest hit of each ray with t in [t_min, t_max].

        Args:
            origins: (N, 3) NumPy array, or Warp array of vec3, which is not copied if on the device.
            directions: likewise, of length 10^-15 to 10^30, the unit of t. A ray that is not finite or has no direction
                hits nothing.
            t_min: minimum distance, not negative.
            t_max: maximum distance, one number for all or (N,).

        Raises:
            InputError: on arrays of other shapes or types.
        """
        rays, as_numpy = self._rays(origins, directions)
        n, name, backend = len(rays[0]), self.device.name, self.device.backend
        triangle = backend.empty(n, int, name)
        t = backend.empty(n, float, name)
        uv = backend.empty(n, "vec2", name)
        self._trace(rays, t_min, t_max, [triangle, t, uv], any_hit=False)
        if as_numpy:
            weights = backend.fetch(uv)
            return Hits(backend.fetch(t), backend.fetch(triangle), weights[:, 0], weights[:, 1])
        weights = backend.to_warp(backend.view(uv, float, (n, 2)), "float32")
        return Hits(backend.to_warp(t, "float32"), backend.to_warp(triangle, "int32"), weights[:, 0], weights[:, 1])

    def any_hit(self, origins: Any, directions: Any, t_min: float = 0.0, t_max: Any = math.inf) -> Any:
        """Return (N,) bool, whether each ray hits anything with t in [t_min, t_max]; see `closest_hit`."""
        rays, as_numpy = self._rays(origins, directions)
        backend, name = self.device.backend, self.device.name
        triangle = backend.empty(len(rays[0]), int, name)
        unused = [backend.empty(0, float, name), backend.empty(0, "vec2", name)]
        self._trace(rays, t_min, t_max, [triangle, *unused], any_hit=True)
        if as_numpy:
            return backend.fetch(triangle) >= 0
        hit = backend.empty(len(triangle), "bool", name)
        kernel = backend.kernels("wrt.kernels.accel.ray_batch").is_hit
        self.device.launch(kernel, len(triangle), [triangle, hit])
        return backend.to_warp(hit, "bool")

    def _rays(self, origins: Any, directions: Any) -> tuple[list[Any], bool]:
        """Return both arrays on the device, and whether they were NumPy's."""
        arrays = [
            device_vectors(name, value, self.device.name)
            for name, value in (("origins", origins), ("directions", directions))
        ]
        if len(arrays[0]) != len(arrays[1]):
            raise InputError(f"there are {len(arrays[0])} origins but {len(arrays[1])} directions")
        return arrays, not (is_warp_array(origins) or is_warp_array(directions))

    def _trace(self, rays: list[Any], t_min: float, t_max: Any, outputs: list[Any], *, any_hit: bool) -> None:
        n, name, backend = len(rays[0]), self.device.name, self.device.backend
        if n == 0:
            return
        t_min = number(t_min, "t_min", minimum=0.0)
        if is_warp_array(t_max):
            if (
                t_max.dtype is not sys.modules["warp"].float32
                or t_max.shape not in ((1,), (n,))
                or str(t_max.device) != name
            ):
                raise InputError(f"t_max must be a Warp array of 1 or {n} floats on {name}")
            t_max = backend.from_warp(t_max.contiguous(), float)
        else:
            limits = np.atleast_1d(np.asarray(t_max, dtype=np.float32))
            if limits.shape not in ((1,), (n,)) or np.isnan(limits).any():
                raise InputError(f"t_max must be a number or ({n},), and not NaN")
            t_max = backend.array(limits, float, name)
        batches = backend.kernels("wrt.kernels.accel.ray_batch")
        rays_per_thread = 1
        if self._placed:
            kernel = batches.trace_rays_instances
        elif self.device.is_cpu and n >= SMALL_BATCH:
            together = self._built.bytes <= LARGE_TREE and self._coherent(*rays)
            constants = backend.kernels("wrt.kernels.native.constants")
            if together:
                kernel = batches.trace_packets
                rays_per_thread = constants.PACKET
            else:
                kernel = batches.trace_interleaved
                rays_per_thread = constants.RAYS_PER_THREAD
        else:
            kernel = batches.trace_rays
        batch = batches.RayBatch()
        batch.origins, batch.directions = rays
        batch.t_min, batch.t_max, batch.any_hit = t_min, t_max, int(any_hit)
        batch.triangle_out, batch.t_out, batch.uv_out = outputs
        tree = self._placed.data if self._placed else self._built.data
        self.device.launch(kernel, -(-n // rays_per_thread), [tree, batch])

    def _coherent(self, origins: Any, directions: Any) -> bool:
        """Return whether most rays are close to the next one in origin and direction, from a thousand of them."""
        low, high = self._built.bounds
        extent = np.maximum(high - low, 1e-6 * float((high - low).max()) + 1e-30)
        i = np.linspace(0, len(origins) - 2, 1024).astype(np.int64)
        o, d = origins.numpy(), directions.numpy()
        with np.errstate(over="ignore", invalid="ignore"):
            a, b = (d[k] / np.maximum(np.linalg.norm(d[k], axis=1, keepdims=True), 1e-30) for k in (i, i + 1))
            near = (np.abs(o[i] - o[i + 1]) / extent).max(axis=1) < SPREAD
            near &= np.abs(a - b).max(axis=1) < SPREAD
        return bool(near.mean() > 0.8)


def _triangles(mesh: Mesh) -> Mesh:
    """Return a mesh that has triangles alone; raise InputError for exact shapes."""
    from wrt.scene.exact.analytic import Analytic

    if isinstance(mesh, Analytic):
        raise InputError(f"{mesh.name}: an intersector has triangles only; give it those of mesh.tessellated()")
    return mesh


def _meshes(source: Any) -> list[Any]:
    from wrt.scene.scene import Scene

    if isinstance(source, Mesh):
        return [_triangles(source)]
    if isinstance(source, Scene):
        if not source.shapes:
            raise InputError("the scene has no shapes to hit")
        time = source.camera.shutter_open if source.camera else 0.0
        return [_triangles(shape.mesh_at(time)) for shape in source.shapes]
    if isinstance(source, (str, os.PathLike)):
        raise InputError(
            "an intersector needs a wrt.Mesh, a wrt.Scene or a trimesh object, not a path; wrt.load_mesh reads files"
        )
    from wrt.io.load_mesh import from_trimesh

    return [_triangles(shape.mesh_at(0.0)) for shape in from_trimesh(source)]
