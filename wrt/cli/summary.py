"""The summary of a finished render, as a line of text and a line of JSON."""

from __future__ import annotations

import json
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
        values: further values of the line of JSON.
    """
    if not options.quiet:
        warn("  ".join(part for part in (one_line(str(output)), *line) if part))
    if options.json:
        device = {"device": renderer.device.name, "threads": renderer.threads}
        print(json.dumps({"input": source, "output": str(output), **device, **values}), flush=True)


def report_picture(
    source: str, options: RenderOptions, renderer: Renderer, output: Path, developed: Developed | None, started: float
) -> None:
    """Print the summary of a picture, for which work began at `started` (`time.perf_counter`)."""
    from wrt.progress.bar import noise_text, rate_text

    seconds_total = time.perf_counter() - started
    seconds, noise = renderer.seconds_render, renderer.noise()
    width, height = renderer.film.picture_size
    paths, rays = ((count / seconds if seconds > 0.0 else 0.0) for count in (renderer.paths, renderer.rays))
    line = [
        f"{width}x{height}",
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
        width=width,
        height=height,
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
