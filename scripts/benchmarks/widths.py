"""`widths`: the wide kernel beside the scalar one, each width on a processor held to the registers that it fills."""

from __future__ import annotations

import argparse
import dataclasses
import time
from typing import Any

import numpy as np

from benchmarks.measure import Row, geometric_mean, table, with_empty_cache
from benchmarks.scenes import CASES, Budget

TARGETS = {4: "x86-64-v2", 8: "x86-64-v3", 16: "x86-64-v4"}
"""Levels of x86 by width: SSE4, AVX2 and AVX-512. Both kernels are compiled for them."""

SPP = 32
"""Samples of a pixel in one pass."""


def benchmark(options: argparse.Namespace) -> Row:
    """Return how many times as fast the wide kernel renders each scene as the scalar one, by its number of lanes.

    One thread, one pass; both kernels in turn. Each ratio is that of two consecutive passes, by seconds of CPU.
    """
    rows: list[Row] = []
    for lanes in options.lanes:
        for scene in options.scenes:
            # The cache does not distinguish the processors that Warp is made to compile for.
            ratios = with_empty_cache(ratios_of, lanes, scene, options.size, options.rounds)
            low, ratio, high = np.quantile(ratios, (0.25, 0.5, 0.75)).tolist()
            print(f"{lanes} lanes, {scene}: {ratio:.2f} (quartiles {low:.2f} to {high:.2f})", flush=True)
            rows.append({"lanes": lanes, "target": TARGETS[lanes], "scene": scene, "ratio": ratio, "ratios": ratios})
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

    measured = [[seconds(kernel) for kernel in threads] for _ in range(1 + rounds)][1:]
    return [scalar / of_wide for scalar, of_wide in measured]


def text(result: Row) -> str:
    """Return the table for docs/performance.md: a line for each number of lanes."""
    ratios = {(row["lanes"], row["scene"]): row["ratio"] for row in result["rows"]}
    scenes = list(dict.fromkeys(scene for _, scene in ratios))
    lines = []
    for lanes, target in dict.fromkeys((row["lanes"], row["target"]) for row in result["rows"]):
        of_scenes = [ratios[lanes, scene] for scene in scenes]
        mean = f"**{geometric_mean(of_scenes):.2f}**"
        lines.append([str(lanes), f"`{target}`", *(f"{ratio:.2f}" for ratio in of_scenes), mean])
    head = ["lanes", "processor", *(f"`{scene}`" for scene in scenes), "mean"]
    return f"On {result['machine']}; {result['size']} x {result['size']} pixels.\n\n" + table(head, lines)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    scenes = ("cornell-box", "still-life", "teapot", "many-triangles")
    parser.add_argument("--lanes", nargs="+", type=int, choices=TARGETS, default=list(TARGETS))
    parser.add_argument("--scenes", nargs="+", metavar="NAME", default=list(scenes), help="names, or scene files")
    parser.add_argument("--size", type=int, default=128, help="pixels a side")
    parser.add_argument("--rounds", type=int, default=7, help="passes of each (default 7)")
