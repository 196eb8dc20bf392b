"""`widths`: the wide kernel beside the scalar one, each width on a processor held to the registers that it fills."""

from __future__ import annotations

import argparse
import dataclasses
import multiprocessing
import os
import tempfile
import time
from typing import Any

from benchmarks.checkouts import quartiles
from benchmarks.measure import geometric_mean
from benchmarks.scenes import CASES, Budget

TARGETS = {4: "x86-64-v2", 8: "x86-64-v3", 16: "x86-64-v4"}
"""Levels of x86 by width: SSE4, AVX2 and AVX-512. Both kernels are compiled for them."""

SCENES = ("cornell-box", "still-life", "teapot", "many-triangles")
"""What is rendered by default."""

SPP = 32
"""Samples of a pixel in one pass."""


def benchmark_widths(options: argparse.Namespace) -> dict[str, Any]:
    """Return how many times as fast the wide kernel renders each scene as the scalar one, by its number of lanes.

    One thread, one pass; both kernels in turn. Each ratio is that of two passes one after the other, by seconds of CPU.
    """
    print("| lanes | target | scene | ratio | quartiles |\n| --- | --- | --- | --- | --- |")
    rows: list[dict[str, Any]] = []
    for lanes in options.lanes:
        for scene in options.scenes:
            with tempfile.TemporaryDirectory() as folder:
                # Caches do not tell processors apart that are told to Warp.
                os.environ.update(XDG_CACHE_HOME=folder, WARP_CACHE_PATH=folder)
                with multiprocessing.get_context("spawn").Pool(1) as pool:
                    ratios = pool.apply(ratios_of, (lanes, scene, options.size, options.rounds))
            low, ratio, high = quartiles(ratios)
            print(f"| {lanes} | {TARGETS[lanes]} | `{scene}` | {ratio:.2f} | {low:.2f} to {high:.2f} |", flush=True)
            rows.append({"lanes": lanes, "target": TARGETS[lanes], "scene": scene, "ratio": ratio, "ratios": ratios})
    for lanes in options.lanes:
        mean = geometric_mean(row["ratio"] for row in rows if row["lanes"] == lanes)
        print(f"{lanes} lanes: {mean:.2f} in the mean")
    return {"benchmark": "widths", "size": options.size, "rows": rows}


def ratios_of(lanes: int, name: str, size: int, rounds: int) -> list[float]:
    """Return seconds of CPU of the scalar kernel over those of the wide one, pass by pass; for a new process."""
    import warp as wp

    import wrt
    from wrt.kernels.native.constants import TILE
    from wrt.rendering.wide_kernel import threads_of
    from wrt.spmd.kernel import make_wide_render_kernel

    flags = wp.config.cpu_compiler_flags or ""
    wp.config.cpu_compiler_flags = flags.replace("-march=native", f"-target-cpu {TARGETS[lanes]}")
    scene = CASES[name].scene(size, Budget()) if name in CASES else wrt.load(name)
    scene = dataclasses.replace(scene, settings=dataclasses.replace(scene.settings, width=size, height=size))
    renderer = wrt.Renderer(scene, threads=1)
    start = renderer.film.state()
    wide = make_wide_render_kernel(renderer._kernel._features, lanes)
    threads = {renderer._kernel.scalar: renderer.film.pixels, wide: threads_of(size, size, TILE)}

    def seconds(kernel: Any) -> float:
        renderer.film.restore(start)
        begun = time.process_time()
        renderer.device.launch(kernel, threads[kernel], [SPP, *renderer._inputs])
        return time.process_time() - begun

    taken = [[seconds(kernel) for kernel in threads] for _ in range(1 + rounds)][1:]
    return [scalar / of_wide for scalar, of_wide in taken]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Tell what the command line takes."""
    parser.add_argument("--lanes", nargs="+", type=int, choices=TARGETS, default=list(TARGETS))
    parser.add_argument("--scenes", nargs="+", metavar="NAME", default=list(SCENES), help="names, or scene files")
    parser.add_argument("--size", type=int, default=128, help="pixels a side")
    parser.add_argument("--rounds", type=int, default=7, help="passes of each (default 7)")
