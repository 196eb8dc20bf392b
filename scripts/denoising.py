"""Measure what denoising a few samples gains on the benchmark's scenes, and how long it takes; print a table.

    python scripts/denoising.py [--scenes NAME ...] [--spp SAMPLES] [--size PIXELS] [--share SHARE]

The relative error weighs every pixel by its own radiance and a tenth of the mean, as in scripts/benchmark.py. It is
measured against two references of other seeds, each with eight times the samples, so that it is free of their noise.
Needs the extra wrt[denoise]. docs/noise.md shows the result.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from benchmarks.render import squared_errors
from benchmarks.scenes import CASES, Budget
from numpy.typing import NDArray

import wrt
from wrt.cli.arguments.types import positive, whole

TIMES = 8
"""Samples of a reference over those of the picture."""


def rendered(scene: wrt.Scene, spp: int, **options: Any) -> wrt.Renderer:
    """Return the renderer of a scene after its passes."""
    renderer = wrt.Renderer(scene, **options)
    for _ in renderer.passes(spp=spp, pass_seconds=10.0):
        pass
    return renderer


def relative_error(image: NDArray[np.float32], references: list[NDArray[np.float32]]) -> float:
    """Return the root mean square error relative to each pixel's radiance and a tenth of the mean."""
    return float(np.sqrt(max(squared_errors(image, references)["relative"], 0.0)))


def rows(options: argparse.Namespace) -> Iterator[str]:
    """Yield the lines of the table."""
    yield "| scene | error, noisy | denoised | ratio | seconds a megapixel | same bytes by one thread |"
    yield "| --- | --- | --- | --- | --- | --- |"
    ratios = []
    for name in options.scenes:
        scene = CASES[name].scene(options.size, Budget(share=options.share))
        references = [rendered(scene, TIMES * options.spp, seed=seed).image() for seed in (1, 2)]
        renderer = rendered(scene, options.spp)
        renderer.denoised()  # renders the guides, and loads the library
        begin = time.process_time()
        denoised = renderer.denoised()
        seconds = (time.process_time() - begin) / (1e-6 * options.size**2)
        alone = rendered(scene, options.spp, threads=1).denoised()
        same = "yes" if alone.tobytes() == denoised.tobytes() else "NO"
        noisy, clean = (relative_error(image, references) for image in (renderer.image(), denoised))
        ratios.append(noisy / clean)
        yield f"| `{name}` | {noisy:.3f} | {clean:.3f} | {ratios[-1]:.1f} | {seconds:.1f} | {same} |"
    yield f"| geometric mean | | | {float(np.exp(np.log(ratios).mean())):.1f} | | |"


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", nargs="+", choices=list(CASES), default=list(CASES), metavar="NAME")
    parser.add_argument("--spp", type=whole(1), default=16, help="samples per pixel (default: 16)")
    parser.add_argument("--size", type=whole(1), default=512, help="pixels a side (default: 512)")
    parser.add_argument("--share", type=positive, default=0.1, help="of the triangles and lights (default: 0.1)")
    for row in rows(parser.parse_args(arguments)):
        print(row, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
