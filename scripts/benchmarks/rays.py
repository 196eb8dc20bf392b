"""`rays`: `wrt.Intersector` beside Embree."""

from __future__ import annotations

import argparse
import itertools
import statistics
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

import wrt
from benchmarks.measure import Row, table
from wrt.slices import available_threads

KINDS = ("coherent", "incoherent", "diffuse")


def bumpy_ball(triangles: int) -> wrt.Mesh:
    """Return a ball with hills of two sizes, of about that number of triangles (a latitude-longitude grid)."""
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


def benchmark(options: argparse.Namespace) -> Row:
    """Return rays a second, build seconds, memory and agreement, mesh by mesh."""
    rows = []
    for triangles in options.triangles:
        mesh = bumpy_ball(triangles)
        embree = embree_scene(mesh)
        builders: dict[str, Callable[[], Any]] = {"wrt": partial(wrt.Intersector, mesh)}
        if embree is not None:
            builders["embree"] = partial(embree_scene, mesh)
        builds = seconds_in_turn(builders, 3)
        tracers = {threads: wrt.Intersector(mesh, threads=threads) for threads in options.threads}
        bytes_per_triangle = next(iter(tracers.values())).bytes_per_triangle
        print(f"{len(mesh.faces)} triangles of {bytes_per_triangle:.0f} bytes; seconds to build: {builds}", flush=True)
        for kind, query in itertools.product(KINDS, ("closest", "any")):
            rays = make_rays(kind, mesh, options.rays)
            actions: dict[str, Callable[[], Any]] = {}
            for threads, tracer in tracers.items():
                actions[f"wrt {threads}"] = partial(tracer.closest_hit if query == "closest" else tracer.any_hit, *rays)
            if embree is not None:
                actions["embree"] = partial(embree.run, *rays, query="INTERSECT" if query == "closest" else "OCCLUDED")
            medians = seconds_in_turn(actions, options.repeats)
            rates = {name: len(rays[0]) / seconds / 1e6 for name, seconds in medians.items()}
            row = {"triangles": len(mesh.faces), "rays": kind, "query": query, "mrays_per_second": rates}
            row |= {"build_seconds": builds, "bytes_per_triangle": bytes_per_triangle}
            if embree is not None:
                ours, theirs = actions[f"wrt {options.threads[0]}"](), actions["embree"]()
                same = ours.triangle == theirs if query == "closest" else ours == (theirs >= 0)
                row["ratio_to_embree"] = medians["embree"] / medians[f"wrt {options.threads[0]}"]
                row["agreement"] = float(np.mean(same))
            rows.append(row)
    return {"benchmark": "rays", "rows": rows}


def seconds_in_turn(actions: dict[str, Callable[[], Any]], repeats: int) -> dict[str, float]:
    """Return the median seconds of each action, run once to warm up and then in turn."""
    seconds: dict[str, list[float]] = {name: [] for name in actions}
    for _ in range(1 + repeats):
        for name, action in actions.items():
            start = time.perf_counter()
            action()
            seconds[name].append(time.perf_counter() - start)
    return {name: statistics.median(values[1:]) for name, values in seconds.items()}


def text(result: Row) -> str:
    """Return millions of rays a second as a table."""
    names = list(dict.fromkeys(name for row in result["rows"] for name in row["mrays_per_second"]))
    lines = []
    for row in result["rows"]:
        rates = [f"{row['mrays_per_second'][name]:.2f}" if name in row["mrays_per_second"] else "" for name in names]
        peer = [f"{row['ratio_to_embree']:.2f}", f"{row['agreement']:.4%}"] if "agreement" in row else ["", ""]
        lines.append([f"{row['triangles']:,}", row["rays"], row["query"], *rates, *peer])
    return table(["triangles", "rays", "query", *names, "wrt / Embree", "hits that agree"], lines)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("--triangles", type=int, nargs="+", default=[70_000, 330_000, 5_200_000])
    parser.add_argument("--rays", type=int, default=1 << 20)
    parser.add_argument("--threads", type=int, nargs="+", default=sorted({1, available_threads()}))
    parser.add_argument("--repeats", type=int, default=5)
