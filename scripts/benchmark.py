"""Measure wrt: `rays` beside Embree and Warp's mesh query, `threads` for the renderer's scaling, `compile`, `lights`.

    python scripts/benchmark.py rays [--triangles N ...] [--threads N ...] [--repeats N] [--json FILE]
    python scripts/benchmark.py threads [--scene NAME] [--spp N] [--repeats N] [--json FILE]
    python scripts/benchmark.py compile [--kernels TEXT ...] [--json FILE]
    python scripts/benchmark.py lights [--lights N ...] [--seconds S] [--json FILE]

Rays and threads: everything is warmed up first; what competes is measured in turn, A B A B, and reported as medians
and as the ratio of medians. Machines are noisy: ratios are worth more than times. Compile: seconds of CPU that each
kernel costs where Warp's cache is empty, each in a process and a cache of its own. Lights: the error after
equal seconds of CPU, where lights are chosen by power and where by the tree.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import pkgutil
import platform
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import wrt
from wrt.materials import MATERIALS

DEFAULT_TRIANGLES = (70_000, 330_000, 5_200_000)
KINDS = ("coherent", "incoherent", "diffuse")


def timed(action: Callable[[], Any]) -> tuple[float, Any]:
    """Return the seconds an action takes, and what it returns."""
    start = time.perf_counter()
    result = action()
    return time.perf_counter() - start, result


def in_turn(actions: dict[str, Callable[[], Any]], repeats: int) -> dict[str, float]:
    """Return the median seconds of each action, run once to warm up and then in turn."""
    for action in actions.values():
        action()
    seconds: dict[str, list[float]] = {name: [] for name in actions}
    for _ in range(repeats):
        for name, action in actions.items():
            seconds[name].append(timed(action)[0])
    return {name: statistics.median(values) for name, values in seconds.items()}


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


def benchmark_threads(options: argparse.Namespace) -> dict[str, Any]:
    """Return the renderer's paths a second on one thread and on more, in turn."""
    renderers = {n: wrt.Renderer(wrt.load(options.scene), threads=n) for n in options.threads}

    def more(renderer: wrt.Renderer) -> None:
        for _ in renderer.passes(spp=renderer.spp + options.spp):
            pass

    actions = {str(n): lambda r=renderer: more(r) for n, renderer in renderers.items()}
    medians = in_turn(actions, options.repeats)
    first = renderers[options.threads[0]]
    paths = first.width * first.height * options.spp
    rates = {name: paths / seconds for name, seconds in medians.items()}
    base = rates[str(options.threads[0])]
    for name, rate in rates.items():
        print(f"{options.scene}: {name} threads {rate / 1e6:.2f} M paths/s, x{rate / base:.2f}")
    return {"benchmark": "threads", "scene": options.scene, "paths_per_second": rates}


def largest_models() -> tuple[str, ...]:
    """Return each family of models once, in the variant that has most in it."""
    every = [cls() for cls in MATERIALS.values()]
    models = {material.model for material in every if not material.parts}
    image = wrt.ImageTexture(np.ones((1, 1, 3), np.float32))
    large = (
        wrt.RoughConductor(multiple_bounces=True),
        wrt.RoughDielectric(multiple_bounces=True),
        wrt.Principled(anisotropy=0.5, transmission=image, coat=image, sheen_color=image, multiple_bounces=True),
    )
    for material in large:
        models = {name for name in models if name.split(":")[0] != material.model.split(":")[0]} | {material.model}
    return tuple(sorted(models))


def compile_cases() -> dict[str, Any]:
    """Return what is compiled, by name: Features of render kernels, names of modules, kinds of tables."""
    import importlib

    import warp as wp

    import wrt.kernels
    from wrt.kernels.features import Features

    every = [cls() for cls in MATERIALS.values()]
    usual = tuple(sorted({material.model for material in every if not material.parts}))
    largest = largest_models()
    cases: dict[str, Any] = {
        f"model {name}": Features((name,), False, "constant") for name in (*usual, *sorted(set(largest) - set(usual)))
    }
    one = ("diffuse",)
    cases["no environment"] = Features(one, False, "none")
    cases["textured"] = Features(one, True, "constant")
    cases["image environment"] = Features(one, False, "image")
    cases["layered"] = Features(one, False, "constant", layered=True)
    cases["tangents"] = Features(one, False, "constant", tangents=True)
    cases["every model as it comes"] = Features(usual, False, "constant")
    cases["every model as it comes, every feature"] = Features(usual, True, "image", layered=True, tangents=True)
    cases["every model at its largest, every feature"] = Features(largest, True, "image", layered=True, tangents=True)
    for found in pkgutil.iter_modules(wrt.kernels.__path__, "wrt.kernels."):
        kernels = [x for x in vars(importlib.import_module(found.name)).values() if isinstance(x, wp.Kernel)]
        if any(kernel.module.name == found.name for kernel in kernels):
            cases[f"module {found.name.removeprefix('wrt.kernels.')}"] = found.name
    cases |= {f"table, {kind}": kind for kind in ("reflection", "dielectric", "coat")}
    return cases


def kernel_module(name: str) -> Any:
    """Return the Warp module of a case."""
    import warp as wp

    from wrt.kernels.albedo import make_missing_kernel
    from wrt.kernels.albedo_dielectric import make_missing_dielectric_kernel
    from wrt.kernels.coat import make_coat_kernel
    from wrt.kernels.render import make_render_kernel

    case = compile_cases()[name]
    if not isinstance(case, str):
        return make_render_kernel(case).module
    makers = {"reflection": make_missing_kernel, "dielectric": make_missing_dielectric_kernel, "coat": make_coat_kernel}
    if case in makers:
        return makers[case]("ggx", "smith").module
    return wp.get_module(case)


def compile_seconds(name: str) -> tuple[float, int]:
    """Return CPU seconds to compile a case, and bytes of object code; for a new process with an empty cache."""
    import warp as wp

    from wrt.device import Device

    device = Device("cpu")
    start = time.process_time()
    wp.load_module(kernel_module(name), device=device.name)
    seconds = time.process_time() - start
    built = [path.stat().st_size for path in Path(wp.config.kernel_cache_dir).rglob("*.o")]
    if len(built) != 1:
        raise RuntimeError(f"{name}: {len(built)} modules were built instead of one")
    return seconds, built[0]


def benchmark_compile(options: argparse.Namespace) -> dict[str, Any]:
    """Return CPU seconds to compile each case, and bytes of object code."""
    rows: list[dict[str, Any]] = []
    print("| kernel | seconds | kB |\n| --- | --- | --- |")
    for name in compile_cases():
        if options.kernels and not any(text in name for text in options.kernels):
            continue
        with tempfile.TemporaryDirectory() as folder:
            os.environ["WARP_CACHE_PATH"] = folder
            with multiprocessing.get_context("spawn").Pool(1) as pool:
                seconds, size = pool.apply(compile_seconds, (name,))
        rows.append({"kernel": name, "seconds": seconds, "bytes": size})
        print(f"| {name} | {seconds:.1f} | {size / 1e3:.0f} |", flush=True)
    return {"benchmark": "compile", "rows": rows}


def lit_picture(scene: wrt.Scene, spp: int, **options: Any) -> tuple[np.ndarray, float]:
    """Return a picture without the lights that are seen themselves, and the seconds of CPU it took.

    Two pictures of equal samples see the same lights, bit for bit; one that stops there shows nothing else.
    """
    renderer = wrt.Renderer(scene, sampler="independent", threads=1, **options)
    seconds = time.process_time()
    for _ in renderer.passes(spp=spp):
        pass
    seconds = time.process_time() - seconds
    seen = wrt.Renderer(scene, sampler="independent", max_depth=1, **options)
    for _ in seen.passes(spp=spp):
        pass
    return renderer.image().astype(np.float64) - seen.image(), seconds


def benchmark_lights(options: argparse.Namespace) -> dict[str, Any]:
    """Return the error of pictures of a city at night at equal time, by how lights are chosen."""
    from night_city import night_city

    rows = []
    print("| lights | samples/s, power | tree | RMSE, power | tree | ratio | relative error, power | tree | ratio |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    for lights in options.lights:
        scene = night_city(lights)
        size = {"width": options.width, "height": options.width * 9 // 16}
        pixels = size["width"] * size["height"]
        reference, _ = lit_picture(scene, options.reference, light_choice="tree", seed=1, **size)
        mean = float(reference.mean())
        row: dict[str, Any] = {"lights": lights}
        for choice in ("power", "tree"):
            _, seconds = lit_picture(scene, 4, light_choice=choice, **size)
            spp = max(4, round(4.0 * options.seconds / seconds))
            picture, seconds = lit_picture(scene, spp, light_choice=choice, **size)
            # Brought to equal time. The reference's own error counts against the tree more than against power.
            squares = (picture - reference) ** 2 * seconds / options.seconds
            row[choice] = {
                "samples_per_second": spp * pixels / seconds,
                "rmse": float(np.sqrt(squares.mean())) / mean,
                "relative": float(np.sqrt(np.mean(squares / (reference**2 + (0.1 * mean) ** 2)))),
            }
        power, tree = row["power"], row["tree"]
        ratios = {key: power[key] / tree[key] for key in ("rmse", "relative")}
        print(
            f"| {lights:,} | {power['samples_per_second'] / 1e6:.2f} M | {tree['samples_per_second'] / 1e6:.2f} M "
            f"| {power['rmse']:.3f} | {tree['rmse']:.3f} | {ratios['rmse']:.1f} "
            f"| {power['relative']:.3f} | {tree['relative']:.3f} | {ratios['relative']:.1f} |",
            flush=True,
        )
        rows.append(row | {"ratios": ratios})
    return {"benchmark": "lights", "seconds": options.seconds, "rows": rows}


def main() -> None:
    """Read the command line, measure, print, and save."""
    from wrt.device import available_threads

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    every = sorted({1, available_threads()})
    rays = commands.add_parser("rays")
    rays.add_argument("--triangles", type=int, nargs="+", default=list(DEFAULT_TRIANGLES))
    rays.add_argument("--rays", type=int, default=1 << 20)
    threads = commands.add_parser("threads")
    threads.add_argument("--scene", default="cornell-box")
    threads.add_argument("--spp", type=int, default=8)
    for command in (rays, threads):
        command.add_argument("--threads", type=int, nargs="+", default=every)
        command.add_argument("--repeats", type=int, default=5)
    compiling = commands.add_parser("compile")
    compiling.add_argument("--kernels", nargs="+", help="only those whose names contain one of these texts")
    lit = commands.add_parser("lights")
    lit.add_argument("--lights", type=int, nargs="+", default=[10, 1000, 10_000, 100_000])
    lit.add_argument("--seconds", type=float, default=20.0, help="of CPU for each picture (default %(default)s)")
    lit.add_argument("--width", type=int, default=160)
    lit.add_argument("--reference", type=int, default=2048, help="samples per pixel of what is compared with")
    for command in (rays, threads, compiling, lit):
        command.add_argument("--json", type=Path)
    options = parser.parse_args()
    benchmarks = {
        "rays": benchmark_rays,
        "threads": benchmark_threads,
        "compile": benchmark_compile,
        "lights": benchmark_lights,
    }
    result = benchmarks[options.command](options)
    result |= {"machine": platform.processor() or platform.machine()}
    if options.command in ("rays", "threads"):
        result["threads"] = options.threads
    result |= {"wrt": wrt.__version__, "python": sys.version.split()[0]}
    if options.json:
        options.json.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
