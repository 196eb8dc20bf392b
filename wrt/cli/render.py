"""`wrt render`: renders each input to its own picture."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from wrt.backend import current_backend
from wrt.cli.exit_status import Failed, cause_of, complain, failing_in_one_line, give_up, outcome, warn
from wrt.cli.load import load_input, make_renderer
from wrt.cli.output_paths import check_paths, default_output, default_outputs, folder_for
from wrt.cli.process import importing_renderer, no_collections
from wrt.cli.renewal import Renewal
from wrt.cli.save import save, save_at_last
from wrt.cli.signals import Interrupts
from wrt.cli.summary import Clock, report, samples_text
from wrt.errors import InputError, one_line
from wrt.progress.bar import once, short_warnings
from wrt.progress.terminal import bar_stream

if TYPE_CHECKING:
    from wrt.rendering.passes import Progress
    from wrt.rendering.renderer import Renderer
    from wrt.scene.scene import Scene

NOTHING_YET = "nothing was rendered yet"


def render(options: argparse.Namespace) -> int:
    """Render every input, even after an error in one; return the highest exit status."""
    if options.turntable is not None or options.frames is not None:
        from wrt.cli.frames import render_frames

        return render_frames(options)
    if options.part is not None:
        from wrt.cli.parts import render_part

        return render_part(options)
    jobs = _jobs(options)
    clock = Clock(own_process=options.own_process)
    worst = 0
    said: set[str] = set()

    with short_warnings(once(warn, said)):  # until there is a progress bar
        while jobs:
            status, interrupted = _render_job(jobs.pop(0), said, clock)
            if interrupted:
                if jobs:
                    complain("stopped", f"{', '.join(job.input for job in jobs)}: not rendered")
                worst = interrupted if jobs else max(worst, status)
                break
            worst = max(worst, status)
            said.clear()
        current_backend().finish()
    return worst


def _jobs(options: argparse.Namespace) -> list[argparse.Namespace]:
    """Return the options for each input.

    They have `input`; `default`, the path of the picture if `output` is None; `taken`, the paths of earlier pictures;
    and `name`, the prefix of error messages if there are several inputs.

    Raises:
        InputError: if an option is not possible with several inputs.
    """
    inputs = options.inputs
    # An output that ends with a slash is a folder even for one input, since a shell pattern may match a single file.
    if len(inputs) == 1 and not (options.output or "").endswith("/"):
        return [_job(options, input=inputs[0], default=default_output(inputs[0]))]
    if options.checkpoint is not None and len(inputs) > 1:
        raise InputError("--checkpoint is for a single input; render the inputs one at a time")
    for number, each in enumerate(inputs):
        if each in inputs[:number]:
            raise InputError(f"{each}: given twice")
    outputs = default_outputs(inputs)
    folder = None if options.output is None else folder_for(options.output)
    jobs: list[argparse.Namespace] = []
    taken: set[Path] = set()
    for number, (source, output) in enumerate(zip(inputs, outputs, strict=True), 1):
        if output != default_output(source) and not options.quiet:
            complain("note", f"{source}: the picture is {output}, because another input has the same name")
        default = output if folder is None else os.path.join(folder, output)
        several = {"name": source, "label": f" ({number} of {len(inputs)})"} if len(inputs) > 1 else {}
        jobs.append(_job(options, input=source, output=None, default=default, taken=taken, **several))
    return jobs


def _job(options: argparse.Namespace, **changes: object) -> argparse.Namespace:
    force = options.force and options.output is not None  # a default name never replaces a file that wrt did not write
    return argparse.Namespace(**{**vars(options), "force": force, "name": "", "label": "", "taken": set(), **changes})


def _render_job(job: argparse.Namespace, said: set[str], clock: Clock) -> tuple[int, int]:
    """Render one input; return its exit status, and the command's if a signal ended it, else 0.

    Messages in `said` are not repeated.
    """
    nothing = f"{job.name}: {NOTHING_YET}" if job.name else NOTHING_YET
    with Interrupts((lambda status: give_up(status, nothing)) if job.own_process else None) as interrupts:
        try:
            status = outcome(lambda: _render_until_interrupted(job, interrupts, said, clock), name=job.name)
        except KeyboardInterrupt:
            complain("stopped", nothing)
            status = interrupts.exit_status
        # After a signal during the last write this render is complete, but no other input may start.
        return status, interrupts.exit_status if interrupts.exit_status > 128 else 0


def _told_black(renderer: Renderer) -> bool:
    """Return whether the renderer has warned that the picture would be black."""
    from wrt.upload.lights.table import has_light

    return not has_light(renderer.scene)


def _render_until_interrupted(options: argparse.Namespace, interrupts: Interrupts, said: set[str], clock: Clock) -> int:
    from wrt.progress.bar import ProgressBar

    output, checkpoint = check_paths(options)
    with (
        ProgressBar(output.stem + options.label, time_limit=options.time, wanted=not options.quiet) as bar,
        short_warnings(say := once(bar.message, said)),
    ):
        renderer, output = _start(options, checkpoint, say)
        watched = bar_stream() is not None and not options.quiet
        renewal = Renewal(options.save_every, watched=watched, longest=renderer.longest_pass)
        stopped = False
        try:
            limits = {
                "spp": options.spp,
                "time": options.time,
                "noise": options.noise,
                "adaptive": options.adaptive or None,
            }
            for progress in renderer.passes(**limits, pass_seconds=renewal.pass_seconds):
                interrupts.worth_saving = True
                interrupts.check()
                bar.update(progress)
                _renew(renderer, options, output, checkpoint, renewal, progress, interrupts, say)
            interrupts.disarm()
        except KeyboardInterrupt:
            if renderer.paths == 0:
                raise
            interrupts.disarm()
            stopped = True
        except Exception as error:  # whatever it is, the samples so far are saved
            if renderer.paths == 0:
                with failing_in_one_line():
                    raise
            interrupts.disarm()
            raise Failed(_saved_after(error, renderer, options, output, checkpoint)) from error
        output, developed = save_at_last(renderer, options, output, checkpoint)
        options.taken.add(output)
        if developed is not None and developed.warning and not (developed.black and _told_black(renderer)):
            say(f"wrt: warning: {developed.warning}")
    if stopped:
        complain("stopped", _state_saved(renderer, output, checkpoint))
        return interrupts.exit_status
    report(options, renderer, output, developed, clock.lap())
    return 0


def _renew(
    renderer: Renderer,
    options: argparse.Namespace,
    output: Path,
    checkpoint: Path | None,
    renewal: Renewal,
    progress: Progress,
    interrupts: Interrupts,
    say: Callable[[str], None],
) -> None:
    """Write the picture and the checkpoint if it is time; a failure is a warning."""
    picture, state = renewal.due(progress)
    state = state and checkpoint is not None
    if not picture and not state:
        return

    def write() -> None:
        save(renderer, options, output if picture else None, checkpoint if state else None)

    try:
        interrupts.hold(lambda: renewal.run(write, picture=picture, checkpoint=state))
    except Exception as error:  # noqa: BLE001  # if the render cannot go on either, its next pass says so
        failed = "not enough memory for the picture" if isinstance(error, MemoryError) else one_line(cause_of(error))
        say(f"wrt: warning: {failed}; rendering continues")


def _saved_after(
    error: Exception, renderer: Renderer, options: argparse.Namespace, output: Path, checkpoint: Path | None
) -> str:
    """Save the samples that there are after an error; return a message about both."""
    try:
        output, _ = save_at_last(renderer, options, output, checkpoint)
    except Exception as second:  # noqa: BLE001  # as of a lost GPU, which has the film; the first is the cause
        return f"{cause_of(error)}; saving what there is failed: {cause_of(second)}"
    options.taken.add(output)
    return f"{cause_of(error)}; stopped {_state_saved(renderer, output, checkpoint)}"


def _state_saved(renderer: Renderer, output: Path, checkpoint: Path | None) -> str:
    """Return what a message says of a render that stopped before its end."""
    saved = f"{output} saved" if checkpoint is None else f"{output} and {checkpoint} saved"
    return f"at {samples_text(renderer)}; {saved}"


def _start(options: argparse.Namespace, checkpoint: Path | None, say: Callable[[str], None]) -> tuple[Renderer, Path]:
    """Read the input and compile the kernels; return the renderer and the path of the picture."""
    with no_collections():
        from wrt.develop.picture import require_tone
        from wrt.develop.settings import DEVELOPED_SUFFIXES
        from wrt.rendering.picture import check_contents

        with importing_renderer(options.input):
            scene = load_input(options)
        asked, integrator = scene.settings.layers, options.integrator or scene.settings.integrator
        if options.layers is None and len(asked) > (integrator == "aov"):  # the scene's layers do not fit into a PNG
            options.default = str(Path(options.default).with_suffix(".exr"))
        output, _ = check_paths(options)  # again, now that the files the scene reads are known
        if options.output is None and output != Path(options.default):
            say(f"wrt: {options.default} must not be overwritten; the picture will be {output}")
        if output.suffix.lower() in DEVELOPED_SUFFIXES:
            require_tone(scene.settings.tone)
        renderer = _make_renderer(options, scene, checkpoint, say)
        check_contents(output, renderer)
    return renderer, output


def _make_renderer(
    options: argparse.Namespace, scene: Scene, checkpoint: Path | None, say: Callable[[str], None]
) -> Renderer:
    renderer = make_renderer(options, scene)
    if options.resume and checkpoint is not None:
        if not os.path.exists(checkpoint):
            say(f"wrt: no checkpoint {checkpoint} yet; starting from the beginning")
        else:
            renderer.load_checkpoint(checkpoint)
            if not options.quiet:
                say(f"wrt: resuming from {checkpoint}, {samples_text(renderer)}")
    return renderer
