"""`scaling`: paths a second and memory over triangles, lights, size of the picture, threads and samples in a pass."""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from peers.peer import OWN, Environments, Session, prepare

import wrt
from benchmarks.measure import Row, table
from benchmarks.render import next_seed, samples_for
from benchmarks.scenes import CASES, Budget, lanterns, mountains
from wrt.backend.slices import available_threads

SIZE = 512
DEPTH = 8

Point = tuple[float, wrt.Scene, int | None]
"""What varies, the scene, and the number of threads if not all."""


def sized(scene: wrt.Scene, size: int) -> wrt.Scene:
    """Return a scene with square pictures of `size` pixels a side."""
    scene.settings.width = scene.settings.height = size
    scene.settings.max_depth = DEPTH
    scene.settings.filter = "box"
    return scene


def over_triangles(options: argparse.Namespace) -> Iterator[Point]:
    """Return mountains of ever more triangles, from one place."""
    for count in (10**3, 10**4) if options.quick else (10**3, 10**4, 10**5, 10**6, 10**7):
        scene = sized(mountains(Budget(), count), options.size)
        yield sum(len(shape.mesh.faces) for shape in scene.shapes), scene, None


def over_lights(options: argparse.Namespace) -> Iterator[Point]:
    """Return the field of lanterns with ever more of them, from one lantern of two triangles on."""
    for count in (2, 1000) if options.quick else (2, 10, 100, 1000, 10**4, 10**5):
        yield count, sized(lanterns(count), options.size), None


def over_pixels(options: argparse.Namespace) -> Iterator[Point]:
    """Return the Cornell box in ever larger pictures."""
    for size in (32, 64) if options.quick else (64, 128, 256, 512, 1024, 2048):
        yield size**2, sized(CASES["cornell"].make(Budget()), size), None


def over_threads(options: argparse.Namespace) -> Iterator[Point]:
    """Return the Cornell box for ever more threads, doubled up to all cores."""
    cores = available_threads()
    for threads in sorted({*(2**k for k in range(cores.bit_length()) if 2**k <= cores), cores}):
        yield threads, sized(CASES["cornell"].make(Budget()), options.size), threads


SERIES: dict[str, Callable[[argparse.Namespace], Iterator[Point]]] = {
    "triangles": over_triangles,
    "lights": over_lights,
    "pixels": over_pixels,
    "threads": over_threads,
}


def benchmark(options: argparse.Namespace) -> Row:
    """Return points and laws of each series."""
    if options.quick:
        options.size, options.seconds, options.repeats = 64, 0.1, 1
    series = {name: measure_series(name, options) for name in options.only if name in SERIES}
    if "samples" in options.only:
        series["samples"] = measure_samples(options)
    return {"benchmark": "scaling", "size": options.size, "depth": DEPTH, "series": series}


def measure_series(name: str, options: argparse.Namespace) -> Row:
    """Return rates and memory at each point of a series, each in a process of its own, and the laws they follow."""
    points: list[Row] = []
    for x, scene, threads in SERIES[name](options):
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary)
            prepare(OWN, scene, folder)
            pixels = scene.settings.width * scene.settings.height
            del scene
            with Session(OWN, folder, Environments(), options.device, threads) as session:
                session.render(1, next_seed())
                spp = samples_for(session, options.seconds)
                seconds = [session.render(spp, next_seed()) for _ in range(1 + options.repeats)][1:]
                rate = pixels * spp / statistics.median(seconds)
                memory = session.peak_memory()
                build = session.about["seconds"]["build"]
        points.append({name: x, "spp": spp, "paths_per_second": rate, "peak_bytes": memory, "build_seconds": build})
        print(f"{name} {x:,.0f}: {rate / 1e6:.3f} M paths/s, {memory / 1e6:.0f} MB", flush=True)
    return {"points": points, "laws": laws(name, points)}


def laws(name: str, points: Sequence[Row]) -> dict[str, str]:
    """Return the laws that a series follows, in words, and how well they fit."""
    if len(points) < 2:
        return {}
    x = np.array([point[name] for point in points], np.float64)
    rate = np.array([point["paths_per_second"] for point in points]) / 1e6
    memory = np.array([point["peak_bytes"] for point in points]) / 1e6
    power, log_factor = np.polyfit(np.log(x), np.log(rate), 1)
    if name == "threads":
        return {"rate": f"{rate[-1] / rate[0]:.2f} times as fast on {x[-1]:.0f} as on {x[0]:.0f}, threads^{power:.3f}"}
    quality = determination(np.log(rate), log_factor + power * np.log(x))
    base, slope, memory_quality = line_through(x, memory)
    return {
        "rate": f"{np.exp(log_factor):.3g} M paths/s · {name}^{power:.3f}, R² {quality:.3f}",
        "memory": f"{base:.0f} MB + {1e6 * slope:.3g} bytes · {name}, R² {memory_quality:.3f}",
    }


def line_through(x: ArrayLike, y: ArrayLike) -> tuple[float, float, float]:
    """Return offset, slope and R² of y = offset + slope · x, least squares of relative differences."""
    x, y = np.asarray(x, np.float64), np.asarray(y, np.float64)
    slope, offset = np.polyfit(x, y, 1, w=1.0 / y)
    return float(offset), float(slope), determination(y, offset + slope * x)


def determination(y: np.ndarray, fitted: np.ndarray) -> float:
    """Return R²: the share of the variance that a fit explains."""
    spread = float(np.sum((y - y.mean()) ** 2))
    return 1.0 - float(np.sum((y - fitted) ** 2)) / spread if spread > 0.0 else 1.0


def measure_samples(options: argparse.Namespace) -> Row:
    """Return the seconds of passes over their number of samples, with what is done between passes.

    A small picture of the Cornell box, whose passes double their samples many times.
    """
    scene = sized(CASES["cornell"].make(Budget()), 32)
    seconds: dict[int, list[float]] = {}
    for seed in range(2 * options.repeats):
        renderer = wrt.Renderer(scene, device=options.device, seed=seed)
        renderer.compile()
        before = 0
        started = time.perf_counter()
        for progress in renderer.passes(spp=2**6 - 1 if options.quick else 2**11 - 1):
            if seed > 0:  # the first render warms up
                seconds.setdefault(progress.spp - before, []).append(time.perf_counter() - started)
            before = progress.spp
            started = time.perf_counter()
    medians = {spp: statistics.median(seconds[spp]) for spp in sorted(seconds) if spp & (spp - 1) == 0}
    pixels = renderer.film.pixels
    points = [{"samples": n, "seconds": s, "paths_per_second": pixels * n / s} for n, s in medians.items()]
    base, slope, quality = line_through(list(medians), list(medians.values()))
    law = f"{1e3 * base:.2f} ms a pass + {1e9 * slope / pixels:.0f} ns a path, R² {quality:.3f}"
    return {"points": points, "laws": {"rate": law}}


def text(result: Row) -> str:
    """Return the tables for docs/notes/scaling.md."""
    texts = [f"On {result['machine']}, {result['cores']} cores.\n"]
    for name, found in result["series"].items():
        if name == "samples":
            head = ["samples in a pass", "ms", "M paths/s"]
            lines = [
                [f"{p['samples']}", f"{1e3 * p['seconds']:.2f}", f"{p['paths_per_second'] / 1e6:.2f}"]
                for p in found["points"]
            ]
        else:
            head = [name, "M paths/s", "MB at most", "s to build"]
            lines = [
                [f"{p[name]:,.0f}", f"{p['paths_per_second'] / 1e6:.2f}"]
                + [f"{p['peak_bytes'] / 1e6:.0f}", f"{p['build_seconds']:.2f}"]
                for p in found["points"]
            ]
        texts.append(f"{table(head, lines)}\n{'; '.join(found['laws'].values())}.\n")
    return "\n".join(texts)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    every = [*SERIES, "samples"]
    parser.add_argument(
        "--only", nargs="+", choices=every, default=every, metavar="NAME", help=f"of {', '.join(every)}"
    )
    parser.add_argument("--device", choices=["cpu", "cuda"], default="cpu")
    parser.add_argument("--size", type=int, default=SIZE, help="pixels a side, where that is not what varies")
    parser.add_argument("--seconds", type=float, default=2.0, help="of each run")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--quick", action="store_true", help="two small points of each, to see that all works")
