"""The summary of a finished render, as a line of text and a line of JSON."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from wrt.cli.exit_status import warn
from wrt.errors import one_line

if TYPE_CHECKING:
    from pathlib import Path

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
    source: str, options: RenderOptions, renderer: Renderer, output: Path, line: Sequence[str], **values: Any
) -> None:
    """Print the summary of a finished render.

    Args:
        source: the input.
        options: whether to print text and JSON.
        renderer: the renderer.
        output: the file that was written.
        line: the parts of the line of text after the file's name; empty ones are left out.
        values: the values of the line of JSON besides those that every render has.
    """
    if not options.quiet:
        warn("  ".join(part for part in (one_line(str(output)), *line) if part))
    if options.json:
        device = {"device": renderer.device.name, "threads": renderer.threads}
        print(json.dumps({"input": source, "output": str(output), **device, **values}), flush=True)


def report_picture(
    source: str, options: RenderOptions, renderer: Renderer, output: Path, developed: Developed | None, clock: Clock
) -> None:
    """Print the summary of a picture."""
    from wrt.progress.bar import noise_text, rate_text

    seconds_total = clock.lap()
    seconds, noise = renderer.seconds_render, renderer.noise()
    paths, rays = ((count / seconds if seconds > 0.0 else 0.0) for count in (renderer.paths, renderer.rays))
    line = [
        f"{renderer.film.width}x{renderer.film.height}",
        f"{renderer.spp} spp",
        f"{seconds:.1f} s",
        f"{rate_text(paths)} paths/s",
        noise_text(noise),
        f"exposure {developed.stops:+.2g}" if developed is not None and developed.stops else "",
    ]
    report(
        source,
        options,
        renderer,
        output,
        line,
        width=renderer.film.width,
        height=renderer.film.height,
        spp=renderer.spp,
        seconds_total=seconds_total,
        seconds_compile=renderer.seconds_compile,
        seconds_compile_beside=renderer.seconds_compile_beside,
        seconds_render=seconds,
        paths_per_second=paths,
        rays_per_second=rays,
        noise=noise,
        mean_radiance=renderer.image().mean(axis=(0, 1), dtype="float64").tolist(),
    )


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
