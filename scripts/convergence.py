"""Measure how fast each sampler converges; print a table and draw a plot.

    python scripts/convergence.py [--scenes NAME ...] [--seeds N] [--out FILE]

The error is the root-mean-square difference from a converged picture over all pixels, channels and several seeds,
divided by that picture's mean. Plots need matplotlib (pip install '.[plots]'). docs/sampling.md shows the result.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from canvas import STYLE, save
from numpy.typing import NDArray

import wrt
from wrt.scene.scene import SAMPLERS

DOCS_PLOT = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "plots" / "convergence.png"

SIZE = (48, 36)
COUNTS = tuple(2**k for k in range(11))
REFERENCE_SPP = 2**14
COLORS = {"independent": "#444444", "stratified": "#b8860b", "sobol": "#1f6fb4", "blue-noise": "#d1495b"}

Errors = dict[str, NDArray[np.float64]]


def soft_shadow() -> wrt.Scene:
    """A block and a ball under a square light; direct light only."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 1.6, 3.2), (0.0, 0.3, 0.0)))
    scene.settings.max_depth = 2
    scene.add(wrt.quad((-4, 0, 4), (8, 0, 0), (0, 0, -8)), material=wrt.Diffuse(0.7))
    scene.add(wrt.box((-0.9, 0.0, -0.4), (-0.3, 1.0, 0.2)), material=wrt.Diffuse((0.7, 0.3, 0.2)))
    scene.add(wrt.sphere((0.5, 0.5, 0.0), 0.5, subdivisions=4), material=wrt.Diffuse((0.2, 0.4, 0.7)))
    scene.add(wrt.quad((-0.7, 2.8, -0.3), (1.4, 0, 0), (0, 0, 1.4)), emission=8.0)
    return scene


def posts() -> wrt.Scene:
    """Coloured posts on a floor, near and far, lit by sky and sun."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 0.7, 3.0), (0.0, 0.35, 0.0)))
    scene.settings.max_depth = 2
    scene.add_light(wrt.DirectionalLight((-0.4, -1.0, -0.6), irradiance=3.0))
    scene.add(wrt.quad((-6, 0, 4), (12, 0, 0), (0, 0, -16)), material=wrt.Diffuse(0.5))
    for k in range(12):
        x, z = 0.5 * (k % 4 - 1.5) + 0.12 * (k // 4), 1.2 - 1.3 * (k // 4)
        shade = np.array([(0.8, 0.2, 0.1), (0.1, 0.5, 0.8), (0.85, 0.8, 0.7)][k % 3])
        scene.add(wrt.box((x - 0.06, 0.0, z - 0.06), (x + 0.06, 0.8, z + 0.06)), material=wrt.Diffuse(tuple(shade)))
    return scene


def depth_of_field() -> wrt.Scene:
    """The posts through a wide lens, the second row in focus."""
    scene = posts()
    scene.camera = wrt.PerspectiveCamera((0.0, 0.7, 3.0), (0.0, 0.35, 0.0), aperture_radius=0.12, focus_distance=3.1)
    return scene


def motion_blur() -> wrt.Scene:
    """The posts from a camera that moves sideways while its shutter is open."""
    scene = posts()
    motion = wrt.Motion.translation((0.35, 0.05, 0.0))
    scene.camera = wrt.PerspectiveCamera((0.0, 0.7, 3.0), (0.0, 0.35, 0.0), shutter_close=1.0, motion=motion)
    return scene


def indirect_light() -> wrt.Scene:
    """The Cornell box, all bounces."""
    scene = wrt.load("cornell-box")
    scene.settings.crop = (0, 12, *SIZE)
    return scene


SCENES: dict[str, Callable[[], wrt.Scene]] = {
    "soft shadow": soft_shadow,
    "depth of field": depth_of_field,
    "motion blur": motion_blur,
    "indirect light": indirect_light,
}


def pictures(scene: wrt.Scene, counts: Sequence[int], **options: Any) -> list[NDArray[np.float64]]:
    """Return one render's picture at each number of samples."""
    renderer = wrt.Renderer(scene, width=SIZE[0], height=SIZE[1], **options)
    result = []
    for count in counts:
        for _ in renderer.passes(spp=count):
            pass
        result.append(renderer.image().astype(np.float64))
    return result


def errors_of(scene: wrt.Scene, seeds: int, samplers: Sequence[str] = SAMPLERS) -> Errors:
    """Return each sampler's relative error at COUNTS."""
    reference = pictures(scene, [REFERENCE_SPP], sampler="sobol", seed=2**31)[0]
    result = {}
    for sampler in samplers:
        square = np.zeros(len(COUNTS))
        for seed in range(seeds):
            square += [np.mean((p - reference) ** 2) for p in pictures(scene, COUNTS, sampler=sampler, seed=seed)]
        result[sampler] = np.sqrt(square / seeds) / reference.mean()
    return result


def print_table(name: str, errors: Errors) -> None:
    """Print a scene's errors as a Markdown table, with a row for every second count."""
    print(f"\n| {name}: samples | " + " | ".join(errors) + " |")
    print("| --- |" + " --- |" * len(errors))
    for k in range(0, len(COUNTS), 2):
        print(f"| {COUNTS[k]} | " + " | ".join(f"{values[k]:.5f}" for values in errors.values()) + " |")
    at = COUNTS.index(256)
    ratios = " | ".join(f"{values[at] / errors['independent'][at]:.2f}" for values in errors.values())
    print(f"| 256, to independent | {ratios} |", flush=True)


def draw(results: dict[str, Errors], path: Path) -> None:
    """Write the plot of all scenes as PNG."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(STYLE):
        canvas = Figure(figsize=(8.4, 5.8), layout="constrained")
        axes = canvas.subplots(2, 2, sharex=True)
        for ax, (name, errors) in zip(axes.flat, results.items(), strict=False):
            for sampler, values in errors.items():
                ax.loglog(COUNTS, values, label=sampler, color=COLORS.get(sampler), linewidth=1.3)
            ax.set_title(name)
            ax.set_xscale("log", base=2)
        for ax in axes[1]:
            ax.set_xlabel("samples per pixel")
        for ax in axes[:, 0]:
            ax.set_ylabel("relative RMS error")
        axes[0, 0].legend(fontsize=7.5)
        save(canvas, path)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Measure how fast each sampler converges.")
    parser.add_argument("--scenes", nargs="+", metavar="NAME", choices=list(SCENES), default=list(SCENES))
    parser.add_argument(
        "--seeds", type=int, default=4, metavar="N", help="number of seeds for each sampler (default: 4)"
    )
    parser.add_argument("--out", type=Path, default=DOCS_PLOT, metavar="FILE", help="plot to write")
    options = parser.parse_args(arguments)
    results = {}
    for name in options.scenes:
        started = time.process_time()
        results[name] = errors_of(SCENES[name](), options.seeds)
        print_table(name, results[name])
        print(f"({time.process_time() - started:.0f} s of CPU time)", flush=True)
    try:
        draw(results, options.out)
    except ImportError:
        print("convergence: error: matplotlib is not installed; run: pip install '.[plots]'", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
