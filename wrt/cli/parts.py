"""`wrt render --part` renders a part of a picture, and `wrt merge` makes the picture of all its parts."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from wrt.cli.exit_status import complain, failing_in_one_line, warn
from wrt.cli.summary import report
from wrt.errors import InputError, one_line
from wrt.progress.bar import ProgressBar, short_warnings

if TYPE_CHECKING:
    from wrt.cli.options import RenderOptions
    from wrt.cli.signals import Interrupts
    from wrt.rendering.passes import Progress

_FOR_WHOLE_PICTURES = {
    "time": "--time would give parts different numbers of samples; give --spp",
    "noise": "--noise is measured over the whole picture; give --spp",
    "adaptive": "--adaptive looks at the whole picture; give --spp",
    "checkpoint": "--checkpoint is for whole pictures; a part is resumed by --resume alone",
    "dask": "--dask renders whole pictures; choose one of the two",
    "denoise": "--denoise is for whole pictures; merge the parts with --checkpoint, and denoise by wrt render --resume",
}


def render_part(interrupts: Interrupts, options: RenderOptions, number: int, of: int) -> int:
    """Render part `number` of `of` of one input's picture; return the exit status."""
    from wrt.io.images import OUTPUT_SUFFIXES
    from wrt.io.safe_write import require_writable
    from wrt.rendering.part import PART, Part, default_name
    from wrt.rendering.part import render_part as render

    interrupts.unfinished = "the part was not written"
    started = time.monotonic()
    if len(options.inputs) > 1:
        raise InputError("--part is for a single input; render the inputs one at a time")
    chosen = {**options.limits, **options.settings, "checkpoint": options.checkpoint, "dask": options.dask}
    for name, message in _FOR_WHOLE_PICTURES.items():
        if chosen[name]:
            raise InputError(message)
    source = options.inputs[0]
    output = Path(options.output or default_name(source, number, of))
    if output.suffix.lower() in OUTPUT_SUFFIXES:
        raise InputError(f"{output}: a part is not a picture yet; give it a name that ends in .wrt, and use wrt merge")
    require_writable(output, PART)
    with ProgressBar(output.stem, is_shown=not options.quiet) as bar, short_warnings(bar.message, quiet=options.quiet):
        renderer = options.make_renderer(options.load(source))
        require_writable(output, PART)  # again, now that the files the scene reads are known
        begun = Part.load(output) if options.resume and os.path.lexists(output) else None

        def watch(window: int, progress: Progress) -> None:
            interrupts.check()
            bar.relabel(f"{output.stem} (window {window + 1})")
            bar.update(progress)

        with failing_in_one_line():
            part = render(renderer, number, of, spp=options.limits["spp"], begun=begun, watch=watch)
        interrupts.hold(lambda: part.save(output))
        interrupts.disarm()
    seconds, pixels = time.monotonic() - started, len(part.arrays["count"])
    size = f"{pixels} of {renderer.film.pixels} pixels"
    report(
        source,
        options,
        renderer,
        output,
        [f"part {number} of {of}", size, f"{part.spp} spp", f"{seconds:.1f} s"],
        part=number,
        parts=of,
        pixels=pixels,
        spp=part.spp,
        seconds_total=seconds,
        seconds_render=part.header["seconds"],
    )
    return 0


def merge(
    interrupts: Interrupts,
    *,
    output: str,
    inputs: Sequence[str],
    checkpoint: str | None,
    tone: str | None,
    exposure: float | str | None,
    force: bool,
    quiet: bool,
) -> int:
    """Merge parts to a picture; return the exit status."""
    import dataclasses

    from wrt.io.images import check_output
    from wrt.io.safe_write import require_writable
    from wrt.rendering.checkpoint import CHECKPOINT
    from wrt.rendering.merge import merge as merge_parts
    from wrt.rendering.picture import check_contents

    interrupts.unfinished = f"{output} was not written"
    picture = check_output(output, force=force)
    if checkpoint is not None:
        require_writable(Path(checkpoint), CHECKPOINT)
    merged = merge_parts(inputs)
    check_contents(picture, merged)
    merged.require_own_tone(picture, tone)
    if merged.settings.denoise:
        hint = "wrt render --checkpoint FILE --resume does it"
        complain("warning", f"{picture}: not denoised, which needs the scene: {hint}")
        merged.settings = dataclasses.replace(merged.settings, denoise=False)

    def write() -> None:
        if checkpoint is not None:
            merged.save_checkpoint(checkpoint)
        developed = merged.save(picture, tone=tone, exposure=exposure, force=force)
        if developed is not None and developed.warning:
            complain("warning", developed.warning)

    interrupts.hold(write)
    interrupts.disarm()
    if not quiet:
        warn(f"{one_line(str(picture))}  {merged.width}x{merged.height}  {merged.spp} spp  {len(inputs)} parts")
    return 0
