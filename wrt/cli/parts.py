"""`wrt render --part` renders a part of a picture, and `wrt merge` makes the picture of all its parts."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from wrt.cli.exit_status import complain, failing_in_one_line, give_up, outcome, warn
from wrt.cli.signals import Interrupts
from wrt.errors import InputError, one_line
from wrt.progress.bar import ProgressBar, once, short_warnings

if TYPE_CHECKING:
    from wrt.parts.part import Part
    from wrt.rendering.passes import Progress
    from wrt.rendering.renderer import Renderer

_FOR_WHOLE_PICTURES = {
    "time": "--time would give parts different numbers of samples; give --spp",
    "noise": "--noise is measured over the whole picture; give --spp",
    "adaptive": "--adaptive looks at the whole picture; give --spp",
    "checkpoint": "--checkpoint is for whole pictures; a part goes on by --resume alone",
    "dask": "--dask renders whole pictures; give one of the two",
    "denoise": "--denoise is for whole pictures; merge the parts with --checkpoint, and denoise by wrt render --resume",
}


def render_part(options: argparse.Namespace) -> int:
    """Render a part of one input's picture; return the exit status."""
    return _interruptible(_render, options, "the part was not written")


def _interruptible(
    work: Callable[[argparse.Namespace, Interrupts], int], options: argparse.Namespace, nothing: str
) -> int:
    """Do what a command does; say that `nothing` came of it if it is interrupted; return the exit status."""
    with Interrupts((lambda status: give_up(status, nothing)) if options.own_process else None) as interrupts:
        try:
            return outcome(lambda: work(options, interrupts))
        except KeyboardInterrupt:
            complain("stopped", nothing)
            return interrupts.exit_status


def _render(options: argparse.Namespace, interrupts: Interrupts) -> int:
    from wrt.backend import current_backend
    from wrt.cli.load import load_input, make_renderer
    from wrt.io.images import OUTPUT_SUFFIXES
    from wrt.io.safe_write import require_writable
    from wrt.parts.part import PART, Part, default_name
    from wrt.parts.render import render_part as render

    started = time.monotonic()
    number, of = options.part
    if len(options.inputs) > 1:
        raise InputError("--part is for a single input; render the inputs one at a time")
    for name, why in _FOR_WHOLE_PICTURES.items():
        if getattr(options, name):
            raise InputError(why)
    options.input = options.inputs[0]
    output = Path(options.output or default_name(options.input, number, of))
    if output.suffix.lower() in OUTPUT_SUFFIXES:
        raise InputError(
            f"{output}: a part is no picture yet; give it a name that ends in .wrt, and then use wrt merge"
        )
    require_writable(output, PART)
    with (
        ProgressBar(output.stem, wanted=not options.quiet) as bar,
        short_warnings(once(bar.message, set())),
    ):
        scene = load_input(options)
        renderer: Renderer = make_renderer(options, scene)
        require_writable(output, PART)  # again, now that the files the scene reads are known
        begun = Part.load(output) if options.resume and os.path.lexists(output) else None

        def watch(window: int, progress: Progress) -> None:
            interrupts.check()
            bar.relabel(f"{output.stem} (window {window + 1})")
            bar.update(progress)

        with failing_in_one_line():
            part = render(renderer, number, of, spp=options.spp, begun=begun, watch=watch)
        interrupts.hold(lambda: part.save(output))
        interrupts.disarm()
    current_backend().finish()
    _report(options, renderer, part, output, time.monotonic() - started)
    return 0


def _report(options: argparse.Namespace, renderer: Renderer, part: Part, output: Path, seconds: float) -> None:
    pixels = len(part.arrays["count"])
    if not options.quiet:
        size = f"{pixels} of {renderer.film.pixels} pixels"
        warn(f"{one_line(str(output))}  part {part.number} of {part.of}  {size}  {part.spp} spp  {seconds:.1f} s")
    if options.json:
        summary = {
            "input": options.input,
            "output": str(output),
            "part": part.number,
            "parts": part.of,
            "device": renderer.device.name,
            "threads": renderer.threads,
            "pixels": pixels,
            "spp": part.spp,
            "seconds_total": seconds,
            "seconds_render": part.header["seconds"],
        }
        print(json.dumps(summary), file=sys.stdout, flush=True)


def merge(options: argparse.Namespace) -> int:
    """Merge parts to a picture; return the exit status."""
    return _interruptible(_merge, options, f"{options.output} was not written")


def _merge(options: argparse.Namespace, interrupts: Interrupts) -> int:
    import dataclasses

    from wrt.io.images import check_output
    from wrt.io.safe_write import require_writable
    from wrt.parts.merge import merge as merge_parts
    from wrt.rendering.checkpoint import CHECKPOINT
    from wrt.rendering.picture import check_contents

    output = check_output(options.output, force=options.force)
    checkpoint = None if options.checkpoint is None else Path(options.checkpoint)
    if checkpoint is not None:
        require_writable(checkpoint, CHECKPOINT)
    merged = merge_parts(options.inputs)
    check_contents(output, merged)
    merged.require_own_tone(output, options.tone)
    if merged.settings.denoise:
        complain(
            "warning", f"{output}: not denoised, which needs the scene: wrt render --checkpoint FILE --resume does it"
        )
        merged.settings = dataclasses.replace(merged.settings, denoise=False)

    def write() -> None:
        if checkpoint is not None:
            merged.save_checkpoint(checkpoint)
        developed = merged.save(output, tone=options.tone, exposure=options.exposure, force=options.force)
        if developed is not None and developed.warning:
            complain("warning", developed.warning)

    interrupts.hold(write)
    interrupts.disarm()
    if not options.quiet:
        warn(f"{one_line(str(output))}  {merged.width}x{merged.height}  {merged.spp} spp  {len(options.inputs)} parts")
    return 0
