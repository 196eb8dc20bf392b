"""Rays against triangles by the million, for those who want the hits and not a picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wrt.build.bvh import build_bvh, refit_bvh
from wrt.build.geometry import device_vectors, first_not_finite, upload_meshes
from wrt.build.instances import PlacedTrees
from wrt.device import Device
from wrt.errors import InputError
from wrt.mesh import Mesh
from wrt.values import integer, number

SMALL_BATCH = 4096
"""Rays below which it does not matter how they are traced, and the kernel that compiles fastest will do."""

LARGE_TREE = 128 * 2**20
"""Bytes of a tree above which packets wait for memory longer than single rays in turn, measured."""

SPREAD = 0.05
"""How much neighbours' unit directions may differ to be traced as a packet."""


class Hits(NamedTuple):
    """What rays hit, one entry a ray, as NumPy or Warp arrays like the rays were.

    Attributes:
        t: float32 distance in units of the direction; infinite where nothing is hit.
        triangle: int32 number of the triangle; −1 where nothing is hit.
        u: float32 weight of the triangle's second corner.
        v: float32 weight of its third corner; the first has 1 − u − v.
    """

    t: Any
    triangle: Any
    u: Any
    v: Any


class Intersector:
    """A ray tree over a mesh or a scene.

    Closed meshes are closed to rays as well: none slips through between two triangles. Of triangles
    hit at one distance the lowest number is reported, whatever the tree. Hits nearer than the
    rounding error of their own distance are left out, so a ray may start on a surface.

    Sizes from 10^-11 to 10^12 give the same hits bit for bit. Beyond, products of three coordinates
    vanish or overflow in float32 and triangles are missed.
    """

    def __init__(self, source: Any, *, device: str = "cpu", threads: int | None = None) -> None:
        """Build the tree.

        Args:
            source: a `wrt.Mesh`, a `wrt.Scene` (its shapes' triangles numbered through, where they are when the shutter
                opens), or a trimesh object.
            device: "cpu", "cuda" or "cuda:N".
            threads: CPU threads; by default all cores.

        Raises:
            InputError: where there is nothing to hit, or the device is not there.
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
        """Return an intersector over meshes that stand in many places; each mesh takes memory once.

        Triangles are numbered through all instances, in their order.

        Args:
            meshes: the distinct meshes.
            numbers: (N,) which mesh each instance is.
            transforms: (N, 4, 4) affine matrices from the mesh's space to the world.
            device: "cpu", "cuda" or "cuda:N".
            threads: CPU threads; by default all cores.

        Raises:
            InputError: on arrays of other shapes, mesh numbers out of range, or matrices that are not
                finite, not affine or not invertible.
        """
        made = cls.__new__(cls)
        made.device = Device(device, threads=threads)
        made._placed = PlacedTrees(meshes, numbers, transforms, made.device)
        return made

    @property
    def triangles(self) -> int:
        """How many triangles there are, in all instances."""
        return self._placed.triangles if self._placed else len(self._indices) // 3

    @property
    def bytes_per_triangle(self) -> float:
        """Memory of the tree, of points and of indices, over the number of triangles."""
        if self._placed:
            return self._placed.bytes / self.triangles
        return (self._built.bytes + 12 * len(self._points) + 4 * len(self._indices)) / self.triangles

    def move(self, transforms: ArrayLike) -> None:
        """Put the instances elsewhere; the meshes' own trees stay.

        Args:
            transforms: (N, 4, 4) as given to `of_instances`.

        Raises:
            InputError: where there are no instances, or on what `of_instances` refuses.
        """
        if self._placed is None:
            raise InputError("only instances can be moved; make the intersector by Intersector.of_instances")
        self._placed.move(transforms)

    def refit(self, vertices: Any, mesh: int = 0) -> None:
        """Follow vertices that have moved, without building the tree anew: many times faster than that.

        Rays find all hits however far they moved, but the tree suits the places that it was built for.

        Args:
            vertices: (V, 3) NumPy array, or Warp array of vec3 on the device (not copied), as many as before;
                of several meshes one after the other.
            mesh: which mesh of instances.

        Raises:
            InputError: on another number of vertices, or values that are not finite.
        """
        if self._placed is None:
            self._points = self._moved(vertices, self._points)
            refit_bvh(self._built, self._points, self._indices, self.device)
        else:
            mesh = integer(mesh, "mesh", minimum=0, maximum=self._placed.meshes - 1)
            self._placed.refit(mesh, self._moved(vertices, self._placed.points(mesh)))

    def _moved(self, vertices: Any, before: Any) -> Any:
        """Return new vertices on the device, checked."""
        import warp as wp

        points = device_vectors("vertices", vertices, self.device.name)
        if len(points) != len(before):
            raise InputError(f"there are {len(points)} vertices, but the tree was built over {len(before)}")
        bad = first_not_finite(points, self.device)
        if bad >= 0:
            raise InputError(f"vertex {bad} is not finite: {points[bad : bad + 1].numpy()[0]}")
        return points if isinstance(vertices, wp.array) else wp.clone(points)

    def closest_hit(self, origins: Any, directions: Any, t_min: float = 0.0, t_max: Any = math.inf) -> Hits:
        """Return the nearest hit of each ray with t in [t_min, t_max].

        Args:
            origins: (N, 3) NumPy array, or Warp array of vec3, which is not copied if on the device.
            directions: likewise, from 10^-15 to 10^30 long; t is in units of it. A ray that is not finite, or whose
                direction is zero, hits nothing.
            t_min: least distance, not negative.
            t_max: greatest distance, one for all or (N,) one for each.

        Raises:
            InputError: on arrays of other shapes or kinds.
        """
        import warp as wp

        rays, as_numpy = self._rays(origins, directions)
        n, name = len(rays[0]), self.device.name
        triangle = wp.empty(n, dtype=int, device=name)
        t = wp.empty(n, dtype=float, device=name)
        uv = wp.empty(n, dtype=wp.vec2, device=name)
        self._trace(rays, t_min, t_max, [triangle, t, uv], any_hit=False)
        if as_numpy:
            weights = uv.numpy()
            return Hits(t.numpy(), triangle.numpy(), weights[:, 0], weights[:, 1])
        weights = wp.array(ptr=uv.ptr, shape=(n, 2), dtype=float, device=name)
        weights._ref = uv  # the view does not own its memory
        return Hits(t, triangle, weights[:, 0], weights[:, 1])

    def any_hit(self, origins: Any, directions: Any, t_min: float = 0.0, t_max: Any = math.inf) -> Any:
        """Return for each ray whether anything lies at t in [t_min, t_max]: (N,) bool; arguments as above."""
        import warp as wp

        rays, as_numpy = self._rays(origins, directions)
        triangle = wp.empty(len(rays[0]), dtype=int, device=self.device.name)
        unused = [
            wp.empty(0, dtype=float, device=self.device.name),
            wp.empty(0, dtype=wp.vec2, device=self.device.name),
        ]
        self._trace(rays, t_min, t_max, [triangle, *unused], any_hit=True)
        if as_numpy:
            return triangle.numpy() >= 0
        from wrt.kernels.ray_batch import is_hit

        hit = wp.empty(len(triangle), dtype=wp.bool, device=self.device.name)
        self.device.launch(is_hit, len(triangle), [triangle, hit])
        return hit

    def _rays(self, origins: Any, directions: Any) -> tuple[list[Any], bool]:
        """Return both arrays on the device, and whether they were NumPy's."""
        import warp as wp

        arrays = [
            device_vectors(name, value, self.device.name)
            for name, value in (("origins", origins), ("directions", directions))
        ]
        if len(arrays[0]) != len(arrays[1]):
            raise InputError(f"there are {len(arrays[0])} origins but {len(arrays[1])} directions")
        return arrays, not (isinstance(origins, wp.array) or isinstance(directions, wp.array))

    def _trace(self, rays: list[Any], t_min: float, t_max: Any, outputs: list[Any], *, any_hit: bool) -> None:
        import warp as wp

        from wrt.kernels.instances import trace_rays_instances
        from wrt.kernels.interleaved import RAYS_PER_THREAD, trace_interleaved
        from wrt.kernels.packets import PACKET, trace_packets
        from wrt.kernels.ray_batch import RayBatch, trace_rays

        n, name = len(rays[0]), self.device.name
        if n == 0:
            return
        t_min = number(t_min, "t_min", minimum=0.0)
        if isinstance(t_max, wp.array):
            if t_max.dtype is not wp.float32 or t_max.shape not in ((1,), (n,)) or str(t_max.device) != name:
                raise InputError(f"t_max must be a Warp array of 1 or {n} floats on {name}")
            t_max = t_max.contiguous()
        else:
            limits = np.atleast_1d(np.asarray(t_max, dtype=np.float32))
            if limits.shape not in ((1,), (n,)) or np.isnan(limits).any():
                raise InputError(f"t_max must be a number or ({n},), and not NaN")
            t_max = wp.array(limits, dtype=float, device=name)
        kernel, rays_per_thread = trace_rays, 1
        if self._placed:
            kernel = trace_rays_instances
        elif self.device.is_cpu and n >= SMALL_BATCH:
            together = self._built.bytes <= LARGE_TREE and self._coherent(*rays)
            kernel = trace_packets if together else trace_interleaved
            rays_per_thread = PACKET if together else RAYS_PER_THREAD
        batch = RayBatch()
        batch.origins, batch.directions = rays
        batch.t_min, batch.t_max, batch.any_hit = t_min, t_max, int(any_hit)
        batch.triangle_out, batch.t_out, batch.uv_out = outputs
        tree = self._placed.data if self._placed else self._built.data
        self.device.launch(kernel, -(-n // rays_per_thread), [tree, batch])

    def _coherent(self, origins: Any, directions: Any) -> bool:
        """Return whether most rays run and begin close to the next one, judged by a thousand of them."""
        low, high = self._built.bounds
        extent = np.maximum(high - low, 1e-6 * float((high - low).max()) + 1e-30)
        i = np.linspace(0, len(origins) - 2, 1024).astype(np.int64)
        o, d = origins.numpy(), directions.numpy()
        with np.errstate(over="ignore", invalid="ignore"):
            a, b = (d[k] / np.maximum(np.linalg.norm(d[k], axis=1, keepdims=True), 1e-30) for k in (i, i + 1))
            near = (np.abs(o[i] - o[i + 1]) / extent).max(axis=1) < SPREAD
            near &= np.abs(a - b).max(axis=1) < SPREAD
        return bool(near.mean() > 0.8)


def _meshes(source: Any) -> list[Any]:
    from wrt.scene import Scene

    if isinstance(source, Mesh):
        return [source]
    if isinstance(source, Scene):
        if not source.shapes:
            raise InputError("the scene has no shapes to hit")
        time = source.camera.shutter_open if source.camera else 0.0
        return [shape.mesh_at(time) for shape in source.shapes]
    from wrt.formats.meshes import from_trimesh

    return [shape.mesh_at(0.0) for shape in from_trimesh(source)]
