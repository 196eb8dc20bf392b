"""Measure whether renders end at their target of noise, and what adaptive sampling saves; print a table.

    python scripts/noise.py [--scenes NAME_OR_FILE ...] [--noise SHARE] [--size PIXELS] [--share SHARE]

True noise is √(π/2) times the mean absolute difference from a reference of another seed with sixteen times the samples,
over the mean radiance; the reference's own noise, a quarter, is taken out. docs/noise.md shows the result.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from benchmarks.scenes import CASES, Budget
from numpy.typing import NDArray

import wrt
from wrt.cli.arguments.types import positive, share, whole

SCENES = (
    "cornell",
    "cornell-glossy",
    "cornell-glass",
    "bunny",
    "bunny-sky",
    "mountains",
    "lanterns",
    "textured",
    "lens",
    "motion",
)
TIMES = 16
"""Samples of the reference over those of the picture."""


def rendered(scene: wrt.Scene, **limits: Any) -> wrt.Renderer:
    """Return the renderer of a scene after its passes."""
    renderer = wrt.Renderer(scene, seed=limits.pop("seed", 0))
    renderer.compile()
    for _ in renderer.passes(**limits, pass_seconds=10.0):
        pass
    return renderer


def true_noise(image: NDArray[np.float32], reference: NDArray[np.float32]) -> float:
    """Return the noise of a picture; see above."""
    difference = np.abs(image.astype(np.float64) - reference).mean() / reference.mean(dtype=np.float64)
    return float(np.sqrt(np.pi / 2.0) * difference / np.sqrt(1.0 + 1.0 / TIMES))


def _scene(name: str, options: argparse.Namespace) -> wrt.Scene:
    """Return a scene of the benchmark, or of a file or wrt's own, at the size asked for."""
    if name in CASES:
        return CASES[name].scene(options.size, Budget(share=options.share))
    scene = wrt.load(name)
    scene.settings = dataclasses.replace(scene.settings, width=options.size, height=options.size, crop=None)
    return scene


def rows(options: argparse.Namespace) -> Iterator[str]:
    """Yield the lines of the table."""
    yield "| scene | samples | noise / target | adaptive: gain | noise | brighter by | unbiased: gain | noise |"
    yield "| --- | --- | --- | --- | --- | --- | --- | --- |"
    for name in options.scenes:
        scene = _scene(name, options)
        uniform, adaptive, unbiased = (
            rendered(scene, noise=options.noise, adaptive=adaptive) for adaptive in (False, True, "unbiased")
        )
        reference = rendered(scene, spp=TIMES * uniform.spp, seed=1).image()
        plain, biased, other = (
            true_noise(each.image(), reference) / options.noise for each in (uniform, adaptive, unbiased)
        )
        gains = [float(samples(uniform) / samples(each)) for each in (adaptive, unbiased)]
        bias = float(adaptive.image().mean(dtype=np.float64) / reference.mean(dtype=np.float64)) - 1.0
        yield (
            f"| `{name}` | {uniform.spp} | {plain:.2f} | {gains[0]:.2f} | {biased:.2f} | {100.0 * bias:+.2f} % "
            f"| {gains[1]:.2f} | {other:.2f} |"
        )


def samples(renderer: wrt.Renderer) -> float:
    """Return the samples of all pixels, those of the pilot of unbiased adaptive sampling included."""
    pilot = 0.0 if renderer._pilot is None else float(renderer._pilot.film.counts.sum(dtype=np.float64))
    return pilot + float(renderer.film.counts.sum(dtype=np.float64))


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", nargs="+", default=list(SCENES), metavar="NAME")
    parser.add_argument("--noise", type=share, default=0.01, help="target (default: 1%%)")
    parser.add_argument("--size", type=whole(1), default=96, help="pixels a side (default: 96)")
    parser.add_argument("--share", type=positive, default=0.1, help="of the triangles and lights (default: 0.1)")
    for row in rows(parser.parse_args(arguments)):
        print(row, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
