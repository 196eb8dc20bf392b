"""`wrt render`: renders one input after the other, each to its own picture."""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from wrt.cli.options import SAVE_EVERY_SECONDS
from wrt.cli.outputs import check_paths, default_output, default_outputs, folder_for, save, save_at_last
from wrt.cli.status import complain, give_up, outcome, warn
from wrt.cli.summary import Clock, report, samples_text
from wrt.errors import InputError, one_line
from wrt.interrupts import Interrupts
from wrt.lean import next_render, run_lean
from wrt.process import importing_renderer, no_collections
from wrt.progress import once, short_warnings

if TYPE_CHECKING:
    from wrt.renderer import Renderer
    from wrt.scene import Scene

NOTHING_YET = "nothing was rendered yet"


def render(options: argparse.Namespace) -> int:
    """Render every input, even after an error in another one; return the highest exit status."""
    jobs = _jobs(options)
    clock = Clock(own_process=options.own_process)
    worst = 0
    said: set[str] = set()

    def render_rest() -> int:
        # `run_lean` may call this again in the middle of an input; inputs that are finished are not repeated.
        nonlocal worst
        while jobs:
            job = jobs[0]
            status, interrupted = _render_job(job, said, clock)
            del jobs[0]
            if interrupted:
                if jobs:
                    complain("stopped", f"{', '.join(job.input for job in jobs)}: not rendered")
                return interrupted if jobs else max(worst, status)
            worst = max(worst, status)
            said.clear()
            next_render()
        return worst

    with short_warnings(once(warn, said)):  # until there is a progress bar
        if not options.own_process or options.device != "cpu":
            return render_rest()
        return run_lean(render_rest)


def _jobs(options: argparse.Namespace) -> list[argparse.Namespace]:
    """Return a set of options for each input.

    Each has `input`; `default`, the path of the picture if `output` is None; `taken`, the paths of earlier pictures;
    and `name`, with which error messages begin if there are several inputs.

    Raises:
        InputError: where an option is not possible with several inputs.
    """
    inputs = options.inputs
    # A shell pattern may match a single file, so an output that ends with a slash is a folder even then.
    if len(inputs) == 1 and not (options.output or "").endswith("/"):
        return [_job(options, input=inputs[0], default=default_output(inputs[0]))]
    if options.checkpoint is not None and len(inputs) > 1:
        raise InputError("--checkpoint is for one input, and several are given; render them one at a time")
    for number, each in enumerate(inputs):
        if each in inputs[:number]:
            raise InputError(f"{each}: given twice")
    outputs = default_outputs(inputs)
    folder = None if options.output is None else folder_for(options.output)
    jobs: list[argparse.Namespace] = []
    taken: set[Path] = set()
    for number, (source, output) in enumerate(zip(inputs, outputs, strict=True), 1):
        if output != default_output(source) and not options.quiet:
            complain("note", f"{source}: its picture is {output}, because another input has the same name")
        default = output if folder is None else os.path.join(folder, output)
        several = {"name": source, "label": f" ({number} of {len(inputs)})"} if len(inputs) > 1 else {}
        jobs.append(
            _job(
                options,
                input=source,
                output=None,
                default=default,
                taken=taken,
                **several,
            )
        )
    return jobs


def _job(options: argparse.Namespace, **changes: object) -> argparse.Namespace:
    force = options.force and options.output is not None  # names that wrt chooses replace no files of others
    return argparse.Namespace(**{**vars(options), "force": force, "name": "", "label": "", "taken": set(), **changes})


def _render_job(job: argparse.Namespace, said: set[str], clock: Clock) -> tuple[int, int]:
    """Render one input; return its exit status, and that of the whole command if a signal ends it here, else 0.

    Messages in `said` are not repeated.
    """
    nothing = f"{job.name}: {NOTHING_YET}" if job.name else NOTHING_YET
    with Interrupts((lambda status: give_up(status, nothing)) if job.own_process else None) as interrupts:
        try:
            status = outcome(lambda: _render_until_interrupted(job, interrupts, said, clock), name=job.name)
        except KeyboardInterrupt:
            complain("stopped", nothing)
            status = interrupts.exit_status
        # A signal during the last write did not cut this render short, but no other input may start.
        return status, interrupts.exit_status if interrupts.exit_status > 128 else 0


def _render_until_interrupted(options: argparse.Namespace, interrupts: Interrupts, said: set[str], clock: Clock) -> int:
    from wrt.pace import LONGEST_PASS
    from wrt.progress import ProgressBar

    output, checkpoint = check_paths(options)
    with (
        ProgressBar(output.stem + options.label, time_limit=options.time, wanted=not options.quiet) as bar,
        short_warnings(say := once(bar.message, said)),
    ):
        renderer, output = _start(options, checkpoint, say)
        save_every = options.save_every or (SAVE_EVERY_SECONDS if checkpoint else float("inf"))
        spp = options.spp or (None if options.time else renderer.settings.spp)
        saved_at = time.monotonic()
        stopped = False
        try:
            pass_seconds = save_every if save_every < LONGEST_PASS else None
            for progress in renderer.passes(spp=spp, time=options.time, pass_seconds=pass_seconds):
                interrupts.worth_saving = True
                interrupts.check()
                bar.update(progress)
                if time.monotonic() - saved_at >= save_every:
                    try:
                        interrupts.hold(lambda: save(renderer, options, output, checkpoint))
                    except OSError as error:
                        say(f"wrt: warning: {one_line(str(error))}; rendering continues")
                    saved_at = time.monotonic()
            interrupts.disarm()
        except KeyboardInterrupt:
            if renderer.paths == 0:
                raise
            interrupts.disarm()
            stopped = True
        except (OSError, MemoryError, RuntimeError):
            if renderer.paths > 0:  # what is rendered must not be lost by what went wrong
                interrupts.disarm()
                save_at_last(renderer, options, output, checkpoint)
            raise
        output = save_at_last(renderer, options, output, checkpoint)
        options.taken.add(output)
    if stopped:
        saved = f"{output} saved" if checkpoint is None else f"{output} and {checkpoint} saved"
        complain("stopped", f"at {samples_text(renderer)}; {saved}")
        return interrupts.exit_status
    report(options, renderer, output, clock.lap())
    return 0


def _start(options: argparse.Namespace, checkpoint: Path | None, say: Callable[[str], None]) -> tuple[Renderer, Path]:
    """Read the input and compile the kernels; return the renderer and the path of the picture."""
    import dataclasses

    with no_collections():
        from wrt.api import load
        from wrt.output import check_layers

        with importing_renderer(options.input):
            scene = load(
                options.input,
                triangles=options.triangles,
                up=options.up,
                parameters=dict(options.define or ()),
                strict=options.strict,
                confined=options.confined,
            )
        output, _ = check_paths(options)  # again: the files that the scene reads are known now
        if options.output is None and output != Path(options.default):
            say(f"wrt: {options.default} must not be replaced; the picture goes to {output}")
        if options.exposure is not None:
            scene.settings = dataclasses.replace(scene.settings, exposure=options.exposure)
        renderer = _make_renderer(options, scene, checkpoint, say)
        check_layers(output, renderer)
    return renderer, output


def _make_renderer(
    options: argparse.Namespace, scene: Scene, checkpoint: Path | None, say: Callable[[str], None]
) -> Renderer:
    from wrt.layers import layer_names
    from wrt.renderer import Renderer

    width, height = options.size or (None, None)
    renderer = Renderer(
        scene,
        width=width,
        height=height,
        device=options.device,
        seed=options.seed,
        threads=options.threads,
        max_depth=options.max_depth,
        crop=options.crop,
        sampler=options.sampler,
        integrator=options.integrator,
        clamp_indirect=options.clamp_indirect,
        regularization=options.regularization,
        layers=None if options.layers is None else layer_names(options.layers),
    )
    if options.resume and checkpoint is not None:
        if not checkpoint.exists():
            say(f"wrt: no checkpoint {checkpoint} yet; starting from the beginning")
        else:
            renderer.load_checkpoint(checkpoint)
            if not options.quiet:
                say(f"wrt: resuming from {checkpoint}, {samples_text(renderer)}")
    return renderer
