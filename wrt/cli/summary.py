"""The summary of a finished render, as a line of text and a line of JSON."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from wrt.errors import one_line

if TYPE_CHECKING:
    from wrt.cli.options import RenderOptions
    from wrt.develop.picture import Developed
    from wrt.rendering.renderer import Renderer

_IMPORTED_AT = time.perf_counter()


def samples_text(renderer: Renderer) -> str:
    """Return the sample count as text; after an interrupted pass it is a range, since pixels differ."""
    samples = renderer.film.tally()
    least, most = samples.least, samples.most
    return f"{least if least == most else f'{least} to {most}'} samples per pixel"


def report(
    source: str,
    options: RenderOptions,
    renderer: Renderer,
    output: Path,
    developed: Developed | None,
    seconds_total: float,
) -> None:
    """Print the summary of a finished render."""
    from wrt.progress.bar import noise_text, rate_text

    seconds, noise = renderer.seconds_render, renderer.noise()
    paths_per_second = renderer.paths / seconds if seconds > 0.0 else 0.0
    if not options.quiet:
        parts = [
            one_line(str(output)),
            f"{renderer.film.width}x{renderer.film.height}",
            f"{renderer.spp} spp",
            f"{seconds:.1f} s",
            f"{rate_text(paths_per_second)} paths/s",
            noise_text(noise),
            f"exposure {developed.stops:+.2g}" if developed is not None and developed.stops else "",
        ]
        print("  ".join(part for part in parts if part), file=sys.stderr, flush=True)
    if options.json:
        import json

        mean = renderer.image().mean(axis=(0, 1), dtype="float64")
        summary = {
            "input": source,
            "output": str(output),
            "device": renderer.device.name,
            "threads": renderer.threads,
            "width": renderer.film.width,
            "height": renderer.film.height,
            "spp": renderer.spp,
            "seconds_total": seconds_total,
            "seconds_compile": renderer.seconds_compile,
            "seconds_compile_beside": renderer.seconds_compile_beside,
            "seconds_render": seconds,
            "paths_per_second": paths_per_second,
            "rays_per_second": renderer.rays / seconds if seconds > 0.0 else 0.0,
            "noise": noise,
            "mean_radiance": [float(channel) for channel in mean],
        }
        print(json.dumps(summary), flush=True)


class Clock:
    """Measures the time of each render; the first includes the start of the process."""

    def __init__(self, *, own_process: bool) -> None:
        """Start with the process if it belongs to the command line, otherwise now."""
        self._started = time.perf_counter() - (seconds_since_start() if own_process else 0.0)

    def lap(self) -> float:
        """Return the seconds since the start, or since the last call."""
        now = time.perf_counter()
        seconds, self._started = now - self._started, now
        return seconds


def seconds_since_start() -> float:
    """Return the age of this process, or the time since this module was imported if the age is unknown."""
    imported = time.perf_counter() - _IMPORTED_AT
    try:
        with open("/proc/self/stat", encoding="ascii", errors="replace") as file:
            # Skip the program's name, which may contain spaces. The 20th field after it is the start time in clock
            # ticks since boot (proc_pid_stat(5), field 22).
            ticks = int(file.read().rpartition(")")[2].split()[19])
        age = time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK")
    except (OSError, AttributeError, ValueError, IndexError):
        return imported
    return max(age, imported)
