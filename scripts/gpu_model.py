"""Count what a GPU would execute for each ray of the built-in scenes. No GPU is needed.

    python scripts/gpu_model.py [SCENE ...] [--write]

The emulator of the tests runs the PTX of the render kernel thread by thread, and notes the blocks of code that each
thread runs. Printed are, for each ray that is traced: instructions, loads from global memory, and accesses to local
memory, which on a GPU is device memory too; and the efficiency of warps, the share of their 32 lanes that work, on
average: for paths, whenever some of a warp trace their next segments, and for all instructions. *Issued* is what lanes
take of the time to issue instructions, whether they work or not: instructions divided by that efficiency. Each scene is
counted with both kernels for GPUs: the usual one, which regenerates paths, and that with a loop for each path. Threads
that part run one after the other until they meet (`tests/support/emulated_cuda/warps.py`). `--write` puts the table
into docs/gpu.md.

These are counts, not times: registers, caches, and how ptxas orders instructions decide about times, and are not known
here. The last two columns are a roofline: rays a second if all schedulers always issued an instruction, and if every
load came from memory, four numbers at a time, at the peaks of one GPU's data sheet.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from benchmarks.measure import write_section
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from support.emulated_cuda.backend import EmulatedBackend, emulated_cuda, entry_of  # noqa: E402
from support.emulated_cuda.translation import COUNTED, tally  # noqa: E402
from support.emulated_cuda.warps import WARP, Issued, issued  # noqa: E402

SCENES = ("cornell-box", "still-life", "teapot", "many-triangles")

SIZE, CROP, SAMPLES = 512, (224, 192, 288, 256), 16
PAGE = ROOT / "docs" / "gpu.md"


class Peaks(NamedTuple):
    """Of a GPU: instructions of single threads a second, a fused multiply-add being one, and bytes a second."""

    name: str
    instructions: float
    bandwidth: float


H100 = Peaks("H100 SXM", 67e12 / 2.0, 3.35e12)
"""NVIDIA H100 data sheet (2023): 67 TFLOPS of single precision, 3.35 TB/s."""

LOAD_BYTES = 16


class Counts(NamedTuple):
    """Of a scene, for each ray, and the efficiency of its warps: for segments of paths, and for instructions."""

    scene: str
    instructions: float
    loads: float
    local: float
    paths: float
    efficiency: float

    @property
    def issued(self) -> float:
        """Instructions that lanes take the time of."""
        return self.instructions / self.efficiency

    def rays_by_instructions(self, peaks: Peaks) -> float:
        """Return rays a second if only instructions took time."""
        return peaks.instructions / self.issued

    def rays_by_loads(self, peaks: Peaks) -> float:
        """Return rays a second if only loads took time, and no cache had what they load."""
        return peaks.bandwidth / (LOAD_BYTES * (self.loads + self.local))


class CountingBackend(EmulatedBackend):
    """Follows the threads of render kernels through their blocks.

    Attributes:
        issued: of the warps of the last pass.
        table: what is in each block, see `tally`.
        segments: the blocks in which rays to the next surface begin.
    """

    issued: Issued
    table: NDArray[np.int64]
    segments: NDArray[np.int64]

    def __init__(self) -> None:
        super().__init__(optimization=0, traces=True)

    def run_grid(self, kernel: Any, count: int, packed: list[Any]) -> None:
        """Run a grid, a render kernel thread by thread."""
        if not kernel.key.endswith("render_pass"):
            super().run_grid(kernel, count, packed)
            return
        library, entry = self.library(kernel), entry_of(kernel)
        flow = self.flow(kernel)
        self.table, self.segments = tally(flow), np.zeros(flow.end, np.int64)
        self.segments[list(flow.marks["nearest hit"])] = 1
        warps = []
        for first in range(0, count, WARP):
            warps.append(issued(flow, library.trace_warp(entry, count, packed, first)))
        self.issued = Issued(sum(w.warps for w in warps), sum(w.threads for w in warps))


def count(name: str, *, regenerates: bool) -> Counts:
    """Count what a pass executes in the middle of a scene's picture, with one of the two kernels."""
    import wrt
    from wrt.rendering.render_kernel import REGENERATE

    os.environ[REGENERATE] = str(int(regenerates))
    backend = CountingBackend()
    with emulated_cuda(counting=backend):
        renderer = wrt.Renderer(wrt.load(name), width=SIZE, height=SIZE, crop=CROP, device="cuda")
        renderer._trace(SAMPLES, 0.0)
        total = dict(zip(COUNTED, backend.issued.threads @ backend.table / renderer.rays, strict=True))
    return Counts(
        name if regenerates else f"{name}, a loop for each path",
        total["instructions"],
        total["ld global"],
        total["ld local"] + total["st local"],
        backend.issued.efficiency(backend.segments),
        backend.issued.efficiency(backend.table[:, 0]),
    )


def table(rows: Sequence[Counts]) -> str:
    """Return the counts as a table in Markdown."""
    bounds = f"Grays/s of an {H100.name}, by instructions | by loads without caches"
    lines = [
        f"| scene | instructions | issued | global loads | local accesses | lanes, paths | lanes, all | {bounds} |"
    ]
    lines.append("| --- " * 9 + "|")
    for row in rows:
        counted = f"{row.instructions:.0f} | {row.issued:.0f} | {row.loads:.0f} | {row.local:.0f}"
        numbers = f"{counted} | {row.paths:.2f} | {row.efficiency:.2f}"
        most, least = row.rays_by_instructions(H100) * 1e-9, row.rays_by_loads(H100) * 1e-9
        lines.append(f"| {row.scene} | {numbers} | {most:.1f} | {least:.1f} |")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Count what a GPU would execute for each ray.")
    parser.add_argument("scenes", nargs="*", default=SCENES, metavar="SCENE")
    parser.add_argument("--write", action="store_true", help=f"put the table into {PAGE.relative_to(ROOT)}")
    options = parser.parse_args(arguments)
    text = table([count(name, regenerates=each) for name in options.scenes for each in (True, False)])
    print(text)
    if options.write:
        write_section(PAGE, "counts", text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
