"""`scaling`: paths a second and memory over triangles, lights, size of the picture, threads and samples in a pass."""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from peers.peer import OWN, Environments, Session, prepare

import wrt
from benchmarks.measure import law_of_power, line_through
from benchmarks.render import next_seed, samples_for
from benchmarks.scenes import CASES, Budget, lanterns, mountains
from wrt.backend.slices import available_threads

Row = dict[str, Any]

SIZE = 512
DEPTH = 8


def sized(scene: wrt.Scene, size: int) -> wrt.Scene:
    """Return a scene with square pictures of `size` pixels a side."""
    scene.settings.width = scene.settings.height = size
    scene.settings.max_depth = DEPTH
    scene.settings.filter = "box"
    return scene


def over_triangles(options: argparse.Namespace) -> Iterator[tuple[float, wrt.Scene, int | None]]:
    """Return mountains of ever more triangles, from one place."""
    for count in (10**3, 10**4) if options.quick else (10**3, 10**4, 10**5, 10**6, 10**7):
        scene = sized(mountains(Budget(), count), options.size)
        yield sum(len(shape.mesh.faces) for shape in scene.shapes), scene, None


def over_lights(options: argparse.Namespace) -> Iterator[tuple[float, wrt.Scene, int | None]]:
    """Return the field of lanterns with ever more of them; the least is one lantern of two triangles."""
    for count in (2, 1000) if options.quick else (2, 10, 100, 1000, 10**4, 10**5):
        yield count, sized(lanterns(count), options.size), None


def over_pixels(options: argparse.Namespace) -> Iterator[tuple[float, wrt.Scene, int | None]]:
    """Return the Cornell box in ever larger pictures."""
    for size in (32, 64) if options.quick else (64, 128, 256, 512, 1024, 2048):
        yield size**2, sized(CASES["cornell"].make(Budget()), size), None


def over_threads(options: argparse.Namespace) -> Iterator[tuple[float, wrt.Scene, int | None]]:
    """Return the Cornell box for ever more threads, doubled up to all cores."""
    most = available_threads()
    for threads in sorted({*(2**k for k in range(most.bit_length()) if 2**k <= most), most}):
        yield threads, sized(CASES["cornell"].make(Budget()), options.size), threads


SERIES: dict[str, Callable[[argparse.Namespace], Iterator[tuple[float, wrt.Scene, int | None]]]] = {
    "triangles": over_triangles,
    "lights": over_lights,
    "pixels": over_pixels,
    "threads": over_threads,
}


def benchmark_scaling(options: argparse.Namespace) -> Row:
    """Return points and laws of each series."""
    if options.quick:
        options.size, options.seconds, options.repeats = 64, 0.1, 1
    found = {name: measure_series(name, options) for name in options.only if name in SERIES}
    if "samples" in options.only:
        found["samples"] = measure_samples(options)
    return {"benchmark": "scaling", "size": options.size, "depth": DEPTH, "series": found}


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
                built = session.about["seconds"]["build"]
        points.append({name: x, "spp": spp, "paths_per_second": rate, "peak_bytes": memory, "build_seconds": built})
        print(f"{name} {x:,.0f}: {rate / 1e6:.3f} M paths/s, {memory / 1e6:.0f} MB, built in {built:.2f} s", flush=True)
    return {"points": points, "laws": laws(name, points)}


def laws(name: str, points: Sequence[Row]) -> dict[str, str]:
    """Return what a series follows, in words: fitted, with how well."""
    x = np.array([point[name] for point in points], np.float64)
    rate = np.array([point["paths_per_second"] for point in points]) / 1e6
    memory = np.array([point["peak_bytes"] for point in points]) / 1e6
    if len(points) < 2:
        return {}
    factor, power, quality = law_of_power(x, rate)
    found = {"rate": f"{factor:.3g} M paths/s · {name}^{power:.3f}, R² {quality:.3f}"}
    if name == "threads":
        found["rate"] = f"{rate[-1] / rate[0]:.2f} times as fast on {x[-1]:.0f} as on {x[0]:.0f}, threads^{power:.3f}"
    else:
        base, slope, quality = line_through(x, memory)
        found["memory"] = f"{base:.0f} MB + {1e6 * slope:.3g} bytes · {name}, R² {quality:.3f}"
    for law in found.values():
        print(f"  {law}", flush=True)
    return found


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
            taken = time.perf_counter() - started
            if seed > 0:
                seconds.setdefault(progress.spp - before, []).append(taken)
            before = progress.spp
            started = time.perf_counter()
    counts = sorted(spp for spp in seconds if spp & (spp - 1) == 0)
    medians = [statistics.median(seconds[spp]) for spp in counts]
    pixels = renderer.film.pixels
    points = [
        {"samples": spp, "seconds": taken, "paths_per_second": pixels * spp / taken}
        for spp, taken in zip(counts, medians, strict=True)
    ]
    for point in points:
        print(f"{point['samples']} samples in a pass: {point['paths_per_second'] / 1e6:.3f} M paths/s", flush=True)
    base, slope, quality = line_through(np.array(counts, np.float64), np.array(medians))
    law = f"{1e3 * base:.2f} ms a pass + {1e9 * slope / pixels:.0f} ns a path, R² {quality:.3f}"
    print(f"  {law}", flush=True)
    return {"points": points, "laws": {"rate": law}}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Tell what the command line takes."""
    every = [*SERIES, "samples"]
    parser.add_argument(
        "--only", nargs="+", choices=every, default=every, metavar="NAME", help=f"of {', '.join(every)}"
    )
    parser.add_argument("--device", choices=["cpu", "cuda"], default="cpu")
    parser.add_argument("--size", type=int, default=SIZE, help="pixels a side, where that is not what varies")
    parser.add_argument("--seconds", type=float, default=2.0, help="of each run")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--quick", action="store_true", help="two small points of each, to see that all works")
