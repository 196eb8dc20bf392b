"""`wrt render`: renders each input to its own picture."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wrt.cli.exit_status import EXPECTED, Failed, cause_of, complain, failing_in_one_line, failure, warn
from wrt.cli.options import RenderOptions
from wrt.cli.output import Output, outputs_of
from wrt.cli.process import no_collections
from wrt.cli.renewal import Renewal
from wrt.cli.summary import report_picture, samples_text
from wrt.errors import one_line
from wrt.progress.bar import ProgressBar, once, short_warnings
from wrt.progress.terminal import bar_stream

if TYPE_CHECKING:
    from wrt.cli.signals import Interrupts
    from wrt.rendering.passes import Progress
    from wrt.rendering.renderer import Renderer


def render(interrupts: Interrupts, **arguments: Any) -> int:
    """Render every input, even after an error in one; return the highest exit status."""
    options = RenderOptions.from_arguments(arguments)
    if options.loading["cameras"] is not None:
        from wrt.cli.views import views_of

        source = options.inputs[0]
        return _render_all(
            interrupts, [(name, PictureRender(source, view, out, interrupts)) for name, out, view in views_of(options)]
        )
    if options.turntable is not None or options.frames is not None:
        from wrt.cli.frames import AnimationRender

        return AnimationRender(options, interrupts).run()
    if options.part is not None:
        from wrt.cli.parts import render_part

        return render_part(interrupts, options, *options.part)
    outputs = zip(options.inputs, outputs_of(options), strict=True)
    return _render_all(
        interrupts, [(source, PictureRender(source, options, output, interrupts)) for source, output in outputs]
    )


def _render_all(interrupts: Interrupts, pictures: Sequence[tuple[str, PictureRender]]) -> int:
    """Render pictures with their names, even after an error in one; return the highest exit status."""
    highest, inputs = 0, [name for name, _ in pictures]
    for number, (name, picture) in enumerate(pictures, 1):
        name = name if len(inputs) > 1 else ""
        label = f" ({number} of {len(inputs)})" if name else ""
        unfinished = "nothing was rendered yet"
        interrupts.rearm(f"{name}: {unfinished}" if name else unfinished)
        with short_warnings(once(warn)):  # when there is no progress bar
            try:
                status = picture.run(label)
            except EXPECTED as error:
                status = failure(error, name=name)
                if not picture.options.can_go_on:
                    return status
            except KeyboardInterrupt:
                status = interrupts.stopped()
        highest = max(highest, status)
        # After a signal during the last write this render is complete, but no other input may start.
        if interrupts.is_signalled and number < len(inputs):
            complain("stopped", f"{', '.join(inputs[number:])}: not rendered")
            return interrupts.exit_status
    return highest


@dataclass(frozen=True)
class PictureRender:
    """The render of one input, `source`, to its picture and its checkpoint."""

    source: str
    options: RenderOptions
    output: Output
    interrupts: Interrupts

    def run(self, label: str) -> int:
        """Load the scene, render and save it; return the exit status. The label follows the name of the picture."""
        options, output, started = self.options, self.output, time.perf_counter()
        output.check()
        title = output.picture.stem + label
        with (
            ProgressBar(title, time_limit=options.limits["time"], is_shown=not options.quiet) as bar,
            short_warnings(bar.message, quiet=options.quiet),
        ):
            renderer = self._start(bar)
            is_complete = self._trace(renderer, bar)
            developed = output.save_at_end(renderer)
            if developed is not None and developed.warning and not (developed.black and _warned_black(renderer)):
                bar.message(f"wrt: warning: {developed.warning}")
        if not is_complete:
            complain("stopped", self._saved(renderer))
            return self.interrupts.exit_status
        report_picture(self.source, options, renderer, output.picture, developed, started)
        return 0

    def _start(self, bar: ProgressBar) -> Renderer:
        """Read the input and compile the kernels."""
        options, output = self.options, self.output
        with no_collections():
            from wrt.develop.picture import require_tone
            from wrt.rendering.picture import check_contents
            from wrt.scene.developing import DEVELOPED_SUFFIXES

            scene = options.load(self.source)
            settings = scene.settings
            fits_png = len(settings.layers) <= (settings.integrator == "aov")
            if output.is_default and options.settings["layers"] is None and not fits_png:
                output.name = str(Path(output.name).with_suffix(".exr"))  # the scene's layers do not fit into a PNG
            output.check()  # again, now that the files the scene reads are known
            if output.is_default and output.picture != Path(output.name):
                bar.message(f"wrt: {output.name} must not be overwritten; the picture will be {output.picture}")
            if output.picture.suffix.lower() in DEVELOPED_SUFFIXES:
                require_tone(settings.tone)
            renderer = options.make_renderer(scene)
            self._resume(renderer, bar)
            check_contents(output.picture, renderer)
        return renderer

    def _resume(self, renderer: Renderer, bar: ProgressBar) -> None:
        checkpoint = self.output.checkpoint
        if not self.options.resume or checkpoint is None:
            return
        if not os.path.exists(checkpoint):
            bar.message(f"wrt: no checkpoint {checkpoint} yet; starting from the beginning")
            return
        renderer.load_checkpoint(checkpoint)
        if not self.options.quiet:
            bar.message(f"wrt: resuming from {checkpoint}, {samples_text(renderer)}")

    def _trace(self, renderer: Renderer, bar: ProgressBar) -> bool:
        """Render until a limit is reached; return False after an interrupt that has left samples to save.

        Raises:
            Failed: after any other exception; the samples so far are saved.
        """
        options, interrupts = self.options, self.interrupts
        is_watched = bar_stream() is not None and not options.quiet
        renewal = Renewal(options.save_every, is_watched=is_watched, longest=renderer.longest_pass)
        try:
            for progress in renderer.passes(**options.limits, pass_seconds=renewal.pass_seconds):
                interrupts.worth_saving = True
                interrupts.check()
                bar.update(progress)
                self._renew(renderer, renewal, progress, bar)
            interrupts.disarm()
        except KeyboardInterrupt:
            if renderer.paths == 0:
                raise
            interrupts.disarm()
            return False
        except Exception as error:  # whatever it is, the samples so far are saved
            if renderer.paths == 0:
                with failing_in_one_line():
                    raise
            interrupts.disarm()
            raise Failed(self._saved_after(error, renderer)) from error
        return True

    def _renew(self, renderer: Renderer, renewal: Renewal, progress: Progress, bar: ProgressBar) -> None:
        """Write the picture and the checkpoint if it is time; a failure is a warning."""
        picture, checkpoint = renewal.due(progress)
        checkpoint = checkpoint and self.output.checkpoint is not None
        if not picture and not checkpoint:
            return

        def write() -> None:
            self.output.save(renderer, picture=picture, checkpoint=checkpoint)

        try:
            self.interrupts.hold(lambda: renewal.run(write, picture=picture, checkpoint=checkpoint))
        except Exception as error:  # noqa: BLE001  # if the render cannot go on either, its next pass says so
            is_memory = isinstance(error, MemoryError)
            failure = "not enough memory for the picture" if is_memory else one_line(cause_of(error))
            bar.message(f"wrt: warning: {failure}; rendering continues")

    def _saved_after(self, error: Exception, renderer: Renderer) -> str:
        """Save the samples so far after an error; return a message about both."""
        try:
            self.output.save_at_end(renderer)
        except Exception as second:  # noqa: BLE001  # such as a lost GPU, which has the film; the first is the cause
            return f"{cause_of(error)}; saving the samples so far failed: {cause_of(second)}"
        return f"{cause_of(error)}; stopped {self._saved(renderer)}"

    def _saved(self, renderer: Renderer) -> str:
        """Return a message about the state that was saved before the end."""
        return f"at {samples_text(renderer)}; {self.output.saved_files()}"


def _warned_black(renderer: Renderer) -> bool:
    """Return whether the renderer has warned that the picture would be black."""
    from wrt.upload.lights.table import has_light

    return not has_light(renderer.scene)
