"""`rays`: `wrt.Intersector` beside Embree and Warp's own mesh query."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

import numpy as np

import wrt
from benchmarks.measure import in_turn
from wrt.backend.slices import available_threads

KINDS = ("coherent", "incoherent", "diffuse")


def bumpy_ball(triangles: int) -> wrt.Mesh:
    """Return a ball with hills of two sizes, of about so many triangles (a latitude-longitude grid)."""
    rows = max(2, round((triangles / 4.0) ** 0.5))
    columns = 2 * rows
    polar = np.linspace(0.0, np.pi, rows + 1)[:, None]
    azimuth = np.linspace(0.0, 2.0 * np.pi, columns, endpoint=False)[None, :]
    x, y, z = np.sin(polar) * np.cos(azimuth), np.cos(polar) + 0.0 * azimuth, np.sin(polar) * np.sin(azimuth)
    radius = 1.0 + 0.15 * np.sin(9.0 * x) * np.sin(11.0 * y) * np.sin(7.0 * z)
    radius += 0.01 * np.sin(80.0 * x) * np.sin(90.0 * y)
    vertices = np.stack([x * radius, y * radius, z * radius], axis=2).reshape(-1, 3).astype(np.float32)
    i, j = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    a, b = i * columns + j, i * columns + (j + 1) % columns
    c, d = a + columns, b + columns
    faces = np.concatenate([np.stack([a, b, d], 2).reshape(-1, 3), np.stack([a, d, c], 2).reshape(-1, 3)])
    corners = vertices[faces].astype(np.float64)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return wrt.Mesh(vertices, faces[area > 0.0].astype(np.int32), name="bumpy ball")


def unit(v: np.ndarray) -> np.ndarray:
    """Return the vectors at length one."""
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def make_rays(kind: str, mesh: wrt.Mesh, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return origins and unit directions: from a camera, from around the mesh into it, or off its surface."""
    rng = np.random.default_rng(0)
    if kind == "coherent":
        side = int(count**0.5)
        y, x = np.mgrid[0:side, 0:side]
        directions = np.stack([(x + 0.5) / side - 0.5, (y + 0.5) / side - 0.5, np.full(x.shape, -1.0)], axis=2)
        directions = directions.reshape(-1, 3)
        origins = np.broadcast_to([0.0, 0.0, 3.0], directions.shape)
    elif kind == "incoherent":
        origins = 2.5 * unit(rng.normal(size=(count, 3)))
        directions = 1.1 * unit(rng.normal(size=(count, 3))) * rng.random((count, 1)) ** (1.0 / 3.0) - origins
    else:
        corners = mesh.vertices[mesh.faces[rng.integers(0, len(mesh.faces), count)]].astype(np.float64)
        u = rng.random((count, 2))
        u = np.where(u.sum(axis=1, keepdims=True) > 1.0, 1.0 - u, u)
        e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        normal = unit(np.cross(e1, e2))
        normal *= np.sign(np.einsum("ij,ij->i", normal, corners[:, 0]))[:, None]
        origins = corners[:, 0] + u[:, :1] * e1 + u[:, 1:] * e2 + 1e-5 * normal
        directions = normal + unit(rng.normal(size=(count, 3)))
    return np.ascontiguousarray(origins, np.float32), unit(directions).astype(np.float32)


class WarpMesh:
    """Warp's own mesh query, one thread."""

    def __init__(self, mesh: wrt.Mesh) -> None:
        """Build Warp's tree."""
        import warp as wp

        points = wp.array(mesh.vertices, dtype=wp.vec3, device="cpu")
        self.mesh = wp.Mesh(points=points, indices=wp.array(mesh.faces.ravel(), dtype=int, device="cpu"))

        @wp.kernel(enable_backward=False)
        def query(
            mesh: wp.uint64, o: wp.array(dtype=wp.vec3), d: wp.array(dtype=wp.vec3), face_out: wp.array(dtype=int)
        ) -> None:
            i = wp.tid()
            hit = wp.mesh_query_ray(mesh, o[i], d[i], 1.0e30)
            face_out[i] = wp.where(hit.result, hit.face, -1)

        self.query = query

    def closest(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Return the triangle that each ray hits first, −1 for none."""
        import warp as wp

        face = wp.empty(len(origins), dtype=int, device="cpu")
        rays = [wp.array(a, dtype=wp.vec3, device="cpu", copy=False) for a in (origins, directions)]
        wp.launch(self.query, len(origins), [self.mesh.id, *rays], [face], device="cpu")
        return face.numpy()


def embree_scene(mesh: wrt.Mesh) -> Any:
    """Return embreex's scene, its tree built, or None where embreex is not installed."""
    try:
        import embreex.rtcore_scene as rtcs
        from embreex.mesh_construction import TriangleMesh
    except ImportError:
        return None
    scene = rtcs.EmbreeScene()
    TriangleMesh(scene, mesh.vertices, mesh.faces)
    # The tree is built at the first ray.
    scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))
    return scene


def benchmark_rays(options: argparse.Namespace) -> dict[str, Any]:
    """Return rays a second, build seconds, memory and agreement, mesh by mesh."""
    rows = []
    for triangles in options.triangles:
        mesh = bumpy_ball(triangles)
        embree = embree_scene(mesh)
        warp_mesh = None if len(mesh.faces) > 1_000_000 else WarpMesh(mesh)
        wrt.Intersector(mesh)  # compiles the kernels
        builds = in_turn(
            {"wrt": lambda m=mesh: wrt.Intersector(m)} | ({"embree": lambda m=mesh: embree_scene(m)} if embree else {}),
            3,
        )
        tracers = {n: wrt.Intersector(mesh, threads=n) for n in options.threads}
        tree = next(iter(tracers.values()))
        print(f"\n{len(mesh.faces)} triangles, {tree.bytes_per_triangle:.0f} bytes a triangle")
        print("  build " + ", ".join(f"{name} {seconds:.2f} s" for name, seconds in builds.items()))
        for kind in KINDS:
            rays = make_rays(kind, mesh, options.rays)
            n = len(rays[0])
            for query in ("closest", "any"):
                row = {"triangles": len(mesh.faces), "rays": kind, "query": query, "build_seconds": builds}
                row["bytes_per_triangle"] = tree.bytes_per_triangle
                actions: dict[str, Callable[[], Any]] = {}
                for threads, tracer in tracers.items():
                    call = tracer.closest_hit if query == "closest" else tracer.any_hit
                    actions[f"wrt {threads}"] = lambda call=call, rays=rays: call(*rays)
                if embree is not None:
                    name = "INTERSECT" if query == "closest" else "OCCLUDED"
                    actions["embree"] = lambda s=embree, rays=rays, name=name: s.run(*rays, query=name)
                if warp_mesh is not None and query == "closest":
                    actions["wp.Mesh"] = lambda m=warp_mesh, rays=rays: m.closest(*rays)
                medians = in_turn(actions, options.repeats)
                row["mrays_per_second"] = {name: n / seconds / 1e6 for name, seconds in medians.items()}
                text = "  ".join(f"{name} {rate:.2f}" for name, rate in row["mrays_per_second"].items())
                if embree is not None:
                    row["ratio_to_embree"] = medians["embree"] / medians[f"wrt {options.threads[0]}"]
                    theirs = actions["embree"]()
                    ours = actions[f"wrt {options.threads[0]}"]()
                    same = ours.triangle == theirs if query == "closest" else ours == (theirs >= 0)
                    row["agreement"] = float(np.mean(same))
                    text += f"  x{row['ratio_to_embree']:.2f} of embree, {100.0 * row['agreement']:.4f} % agree"
                print(f"  {kind:<10} {query:<7} Mray/s: {text}", flush=True)
                rows.append(row)
    return {"benchmark": "rays", "rows": rows}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Tell what the command line takes."""
    parser.add_argument("--triangles", type=int, nargs="+", default=[70_000, 330_000, 5_200_000])
    parser.add_argument("--rays", type=int, default=1 << 20)
    parser.add_argument("--threads", type=int, nargs="+", default=sorted({1, available_threads()}))
    parser.add_argument("--repeats", type=int, default=5)
