"""Count what a GPU would execute to build and refit ray trees, and estimate its time. No GPU is needed.

    python scripts/gpu_builder_model.py [--subdivisions 4 5 6] [--write]

The emulator of the tests runs the builder over bumpy balls of several sizes. Counted for each kernel are its launches,
instructions, bytes of global loads and stores, and the longest thread of each launch: its instructions, and the blocks
of code in which it loads, for each of which it waits. Arrays read back by the host are counted, too, and prefix sums
and sorts by the bytes that they move. `--write` puts the table into docs/notes/cuda.md.

From the counts follows an *estimate* for the triangles of TARGET, not a measurement. Counts grow as a power of the
triangles as they did between the two largest balls; those that hardly grow, with the logarithm. A launch takes as long
as the slowest of four: instructions at a share LANES of the peak, bytes at the peak, atomic operations, and its
longest thread; and LAUNCH_SECONDS on top. Caches, contention and what ptxas makes of it are not known here.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from benchmarks.measure import write_section
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "tests"), str(ROOT / "scripts")]

from gpu_model import H100  # noqa: E402
from support.emulated_cuda.backend import GPU, EmulatedBackend, emulated_cuda, entry_of  # noqa: E402
from support.emulated_cuda.flow import Flow  # noqa: E402
from support.emulated_cuda.libraries import BLOCK  # noqa: E402
from support.emulated_cuda.ptx import Instruction, bits_of  # noqa: E402

TARGET = 10_000_000
"""Triangles to estimate for."""

LANES = 0.25
"""Share of lanes assumed to work; threads of a warp take other ways through the tree."""

LAUNCH_SECONDS = 15e-6
"""Of a launch: a device takes some 5 us, but the host 8 to 14 us to queue one, measured for these kernels on a CPU."""

LOAD_SECONDS = 0.6e-6
"""Latency of a load that misses all caches."""

INSTRUCTION_SECONDS = 3e-9
"""Between two instructions of a thread that depend on one another: five clocks."""

ATOMICS_A_SECOND = 1e11
"""Atomic operations of different addresses, assumed: one for each of some 60 slices of the second cache a clock."""

READ_SECONDS, READ_BANDWIDTH = 20e-6, 10e9
"""A copy to the host that waits for the device, and bytes a second into pageable memory."""

PAGE = ROOT / "docs" / "notes" / "cuda.md"

_TRACED = 1 << 24
_BATCH = 1024


class Launches(NamedTuple):
    """Of a kernel, or of all host reads: its launches, most threads, and sums over launches."""

    launches: float
    threads: float
    instructions: float = 0.0
    bytes: float = 0.0
    atomics: float = 0.0
    longest: float = 0.0
    waits: float = 0.0

    def seconds(self) -> float:
        """Return an estimate of the time of all launches."""
        bound = max(
            self.instructions / (LANES * H100.instructions),
            self.bytes / H100.bandwidth,
            self.atomics / ATOMICS_A_SECOND,
            self.longest * INSTRUCTION_SECONDS + self.waits * LOAD_SECONDS,
        )
        return bound + self.launches * LAUNCH_SECONDS


class Count(NamedTuple):
    """Of a build or a refit over some triangles: its kernels by name, and what the host reads back."""

    triangles: int
    kernels: dict[str, Launches]
    reads: int
    read_bytes: int


def _weights(flow: Flow) -> NDArray[np.int64]:
    """Return what is in each block: instructions, bytes, atomic operations, and whether a thread waits for a load."""
    table = np.zeros((flow.end, 4), np.int64)
    for i, block in enumerate(flow.blocks):
        for instruction in block:
            table[i, 0] += 1
            if instruction.opcode[0] in ("atom", "red"):
                table[i, [2, 3]] += 1
            elif "global" in instruction.opcode:
                table[i, 1] += _bytes(instruction)
                table[i, 3] += instruction.opcode[0] == "ld"
    table[:, 3] = table[:, 3] > 0
    return table


def _bytes(instruction: Instruction) -> int:
    vector = next((int(part[1:]) for part in instruction.opcode if part in ("v2", "v4", "v8")), 1)
    return vector * bits_of(instruction.opcode[-1]) // 8


class BuilderBackend(EmulatedBackend):
    """Counts what kernels execute.

    Attributes:
        found: of each kernel.
    """

    def __init__(self) -> None:
        super().__init__(optimization=0, traces=True)
        self.found: dict[str, Launches] = {}
        self._tables: dict[str, NDArray[np.int64]] = {}
        self._blocks = np.empty(_TRACED, np.uint32)

    def add(self, name: str, *numbers: float) -> None:
        """Add a launch."""
        before = self.found.get(name, Launches(0, 0))
        both = [a + b for a, b in zip(before, Launches(1, *numbers), strict=True)]
        self.found[name] = Launches(both[0], max(before.threads, numbers[0]), *both[2:])

    def run_grid(self, kernel: Any, count: int, packed: list[Any]) -> None:
        """Run a grid and count it."""
        library, entry = self.library(kernel), entry_of(kernel)
        if entry not in self._tables:
            self._tables[entry] = _weights(self.flow(kernel))
        table, total, longest = self._tables[entry], np.zeros(4), np.zeros(2)
        whole = -(-count // BLOCK) * BLOCK
        for first in range(0, whole, _BATCH):
            threads = range(first, min(first + _BATCH, whole))
            ran = library.trace_all(entry, count, packed, threads, self._blocks)
            blocks = self._blocks[: min(ran, _TRACED)]
            scale = ran / len(blocks)
            total += scale * (np.bincount(blocks, minlength=len(table)) @ table)
            begins = np.flatnonzero(blocks == 0)
            for k, column in enumerate((0, 3)):
                of_threads = np.add.reduceat(table[:, column][blocks], begins)
                longest[k] = max(longest[k], scale * of_threads.max() if len(begins) == 1 else of_threads.max())
        self.add(kernel.key, count, *total[:3], *longest)


@contextlib.contextmanager
def counting(backend: BuilderBackend) -> Iterator[list[int]]:
    """Count prefix sums, sums and sorts of Warp as launches, by their bytes; yield the bytes of each read-back."""
    import warp as wp

    reads: list[int] = []
    utils, numpy = wp.utils, wp.array.numpy
    real = utils.array_scan, utils.radix_sort_pairs, utils.array_sum

    def counted(function: Callable[..., Any], name: str, size: int) -> Callable[..., Any]:
        def call(values: Any, *rest: Any, **options: Any) -> Any:
            count = rest[1] if name == "sort" else values.size
            backend.add(name, count, 0.0, size * count, 0.0, 0.0, 4.0)
            return function(values, *rest, **options)

        return call

    def read(array: Any) -> Any:
        reads.append(array.capacity)
        return numpy(array)

    # A scan reads twice and writes once; a sort of pairs reads and writes both in each of four passes.
    utils.array_scan = counted(real[0], "prefix sum", 12)
    utils.radix_sort_pairs = counted(real[1], "sort", 68)
    utils.array_sum = counted(real[2], "sum", 4)
    wp.array.numpy = read
    try:
        yield reads
    finally:
        utils.array_scan, utils.radix_sort_pairs, utils.array_sum = real
        wp.array.numpy = numpy


def bumpy_ball(subdivisions: int) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Return the vertices and faces of a ball with bumps of several sizes."""
    import wrt

    mesh = wrt.sphere(subdivisions=subdivisions)
    points = mesh.vertices.astype(np.float64)
    waves = np.random.default_rng(0).normal(size=(12, 3)) * (2.0 ** np.arange(12) / 8.0)[:, None]
    heights = sum(np.sin(points @ wave * 4.0) / (1.0 + np.linalg.norm(wave)) for wave in waves)
    return (points * (1.0 + 0.05 * np.asarray(heights)[:, None])).astype(np.float32), mesh.faces


def count(subdivisions: int) -> tuple[Count, Count]:
    """Count a build and a refit over a bumpy ball."""
    import warp as wp

    from wrt.backend.device import Device
    from wrt.upload.accel.bvh import build_bvh, refit_bvh

    vertices, faces = bumpy_ball(subdivisions)
    found = []
    backend = BuilderBackend()
    with emulated_cuda(counting=backend):
        device = Device(GPU)
        points = wp.array(vertices, dtype=wp.vec3, device=GPU)
        indices = wp.array(faces.ravel(), dtype=int, device=GPU)
        with counting(backend) as reads:
            built = build_bvh(points, indices, device)
            found.append(Count(len(faces), dict(backend.found), len(reads), sum(reads)))
            backend.found.clear()
            reads.clear()
            refit_bvh(built, points, indices, device)
            found.append(Count(len(faces), dict(backend.found), len(reads), sum(reads)))
    return found[0], found[1]


def grown(counts: Sequence[float], sizes: Sequence[int], target: int) -> float:
    """Return a count for more triangles, from the two largest sizes."""
    (a, b), (n, m) = counts[-2:], sizes[-2:]
    if a <= 0.0 or b <= 0.0:
        return b
    power = math.log(b / a) / math.log(m / n)
    if power < 0.3:
        return b + max(0.0, b - a) * math.log(target / m) / math.log(m / n)
    return float(b * (target / m) ** min(power, 1.1))


def estimated(counts: Sequence[Count], target: int) -> Count:
    """Return what would be counted for more triangles."""
    sizes, last, none = [c.triangles for c in counts], counts[-1], Launches(0, 0)
    kernels = {}
    for name in last.kernels:
        columns = zip(*(c.kernels.get(name, none) for c in counts), strict=True)
        kernels[name] = Launches(*(grown(column, sizes, target) for column in columns))
    reads, read_bytes = ([float(c[k]) for c in counts] for k in (2, 3))
    return Count(target, kernels, round(grown(reads, sizes, target)), round(grown(read_bytes, sizes, target)))


def seconds(counted: Count) -> float:
    """Return an estimate of the time of a build or a refit."""
    reads = counted.reads * READ_SECONDS + counted.read_bytes / READ_BANDWIDTH
    return reads + sum(launches.seconds() for launches in counted.kernels.values())


def table(counts: Sequence[Count]) -> str:
    """Return what was counted for the largest size, and the estimate for TARGET, as a table in Markdown."""
    last, goal = counts[-1], estimated(counts, TARGET)
    millions = f"{TARGET / 1e6:.0f} M"
    lines = [
        f"| kernel, of {last.triangles} triangles | launches | threads | instructions a triangle | bytes a triangle "
        f"| longest thread | its loads | {millions}: longest thread | ms, estimated |",
        "| --- " * 9 + "|",
    ]
    for name, k in sorted(last.kernels.items(), key=lambda item: -goal.kernels[item[0]].seconds()):
        n, most = last.triangles, goal.kernels[name]
        lines.append(
            f"| `{name}` | {k.launches:.0f} | {k.threads:.0f} | {k.instructions / n:.0f} | {k.bytes / n:.0f} "
            f"| {k.longest / k.launches:.0f} | {k.waits / k.launches:.0f} | {most.longest / most.launches:.0f} "
            f"| {1e3 * most.seconds():.2f} |"
        )
    read = goal.reads * READ_SECONDS + goal.read_bytes / READ_BANDWIDTH
    lines.append(
        f"| read by the host | {last.reads} | | | {last.read_bytes / last.triangles:.1f} | | | | {1e3 * read:.2f} |"
    )
    lines.append(f"| **all** | | | | | | | | **{1e3 * seconds(goal):.1f}** |")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Count what a GPU would execute to build and refit ray trees.")
    parser.add_argument("--subdivisions", nargs="+", type=int, default=[4, 5, 6], help="of the balls, ascending")
    parser.add_argument("--write", action="store_true", help=f"put the tables into {PAGE.relative_to(ROOT)}")
    options = parser.parse_args(arguments)
    builds, refits = zip(*map(count, options.subdivisions), strict=True)
    text = f"Build:\n\n{table(builds)}\n\nRefit:\n\n{table(refits)}"
    print(text)
    if options.write:
        write_section(PAGE, "builder", text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
