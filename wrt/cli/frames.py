"""`wrt render --turntable` and `--frames`: renders the frames of an animation, and makes a video of them."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wrt.cli.exit_status import failing_in_one_line
from wrt.cli.output import default_output
from wrt.cli.summary import report
from wrt.errors import InputError
from wrt.io.archives import unpacked
from wrt.progress.bar import ProgressBar, short_warnings

if TYPE_CHECKING:
    from wrt.cli.options import RenderOptions
    from wrt.cli.signals import Interrupts
    from wrt.rendering.renderer import Renderer
    from wrt.scene.scene import Scene

SAMPLES_FOR_EXPOSURE = 4


class AnimationRender:
    """The render of one input to frames or to a video of them."""

    def __init__(self, options: RenderOptions, interrupts: Interrupts) -> None:
        """Check options and paths before the long work.

        Raises:
            InputError: if they cannot be used.
        """
        from wrt.animation.frame_files import FrameFiles, has_place
        from wrt.animation.timeline import is_animated
        from wrt.animation.video import VIDEO_SUFFIXES, check_video, is_video

        if len(options.inputs) > 1:
            raise InputError("--turntable and --frames are for a single input; render the inputs one at a time")
        if options.part is not None:
            raise InputError("--part is for a single picture; spread frames by --frames A-B")
        if options.checkpoint is not None:
            raise InputError("--checkpoint is for a single picture; frames are resumed by --resume alone")
        if options.turntable is not None and options.frames is not None:
            raise InputError("--turntable and --frames cannot be combined yet; choose one")
        interrupts.unfinished = "no frame was rendered yet"
        self._options, self._interrupts = options, interrupts
        self._source = options.inputs[0]
        self._output = Path(options.output or Path(default_output(self._source)).with_suffix(".mp4"))
        self._is_video = is_video(self._output)
        if self._is_video:
            check_video(self._output, fps=options.fps, force=options.force)
        elif not has_place(str(self._output)):
            kinds = ", ".join(VIDEO_SUFFIXES)
            hint = f"name a video ({kinds}), or frames with a place for their numbers: cow_%04d.png"
            raise InputError(f"{self._output}: {hint}")
        first, last = options.frames or (0, (options.turntable or 1) - 1)
        self._files = FrameFiles(self._output, range(first, last + 1), force=options.force)
        self._is_file_animated = options.frames is not None and is_animated(self._source)
        self._title = self._output.name if self._is_video else self._files.location.stem
        self._renderer: Renderer | None = None
        self._scene: Scene | None = None
        self._exposure = 0.0

    def run(self) -> int:
        """Render the missing frames and make the video; return the exit status."""
        options, files, interrupts = self._options, self._files, self._interrupts
        started = time.monotonic()
        with (
            ProgressBar(self._title, time_limit=options.limits["time"], is_shown=not options.quiet) as bar,
            short_warnings(bar.message, quiet=options.quiet),
            unpacked(self._source) as self._file,  # once for all frames
        ):
            try:
                with failing_in_one_line():
                    self._render_missing(bar)
                if self._is_video:
                    bar.relabel(f"{self._title} (writing)")
                    self._write_video()
            except KeyboardInterrupt:
                interrupts.disarm()
                if not files.complete:
                    files.remove()
                    raise
                state = f"{files.count_complete} of {len(files.numbers)} frames complete, in {files.location}"
                bar.message(f"wrt: stopped: {state}; the same command with --resume continues")
                return interrupts.exit_status
            interrupts.disarm()
        seconds, renderer, count = time.monotonic() - started, self._renderer, len(files.numbers)
        assert renderer is not None
        (width, height), spp = renderer.film.picture_size, renderer.spp
        report(
            self._source,
            options,
            renderer,
            self._output,
            [f"{count} frames", f"{width}x{height}", f"{spp} spp" if spp else "", f"{seconds:.1f} s"],
            frames=count,
            fps=options.fps,
            width=width,
            height=height,
            spp=spp,
            seconds_total=seconds,
        )
        return 0

    def _render_missing(self, bar: ProgressBar) -> None:
        """Render the frames that an earlier run has not completed."""
        for index, (number, scene) in enumerate(zip(self._files.numbers, self._scenes(), strict=True), 1):
            if self._renderer is None or number not in self._files.complete:
                bar.relabel(f"{self._title} {index}/{len(self._files.numbers)}")
                self._render_frame(number, scene, bar)

    def _render_frame(self, number: int, scene: Scene, bar: ProgressBar) -> None:
        files, interrupts = self._files, self._interrupts
        is_first = self._renderer is None
        renderer = self._renderer_of(scene)
        if is_first:  # whether frames of an earlier run can be kept depends on the first scene
            interrupts.hold(lambda: self._begin(renderer, bar))
            self._exposure = self._exposure_of(renderer)
            if number in files.complete:
                return
        for progress in renderer.passes(**self._options.limits, pass_seconds=renderer.longest_pass):
            interrupts.worth_saving = True
            interrupts.check()
            bar.update(progress)

        def save(path: Path, force: bool) -> None:
            renderer.save(path, exposure=self._exposure, force=force)

        interrupts.hold(lambda: files.add(number, save))

    def _exposure_of(self, renderer: Renderer) -> float:
        """Return the exposure of a frame with a few samples.

        All frames have the exposure of the first: with one of its own for each they would flicker.
        """
        if not renderer.renders_light:
            return 0.0
        spp = self._options.limits["spp"] or renderer.settings.spp
        for _ in renderer.passes(spp=min(spp, SAMPLES_FOR_EXPOSURE)):
            pass
        return renderer._undeveloped()[2]

    def _scenes(self) -> Iterator[Scene]:
        """Yield the scene of each frame."""
        from wrt.animation.timeline import at_frame, moves
        from wrt.animation.turntable import turntable

        options = self._options
        if self._is_file_animated:
            for number in self._files.numbers:
                yield options.load(self._file, time=number / options.fps)
            return
        scene = options.load(self._file)
        if options.turntable is not None:
            yield from turntable(scene, options.turntable)
            return
        if not moves(scene):
            raise InputError(f"{self._source}: nothing in it moves: neither a shape nor the camera has keyframes")
        for number in self._files.numbers:
            yield at_frame(scene, number, options.fps)

    def _renderer_of(self, scene: Scene) -> Renderer:
        """Return a renderer for a frame: the previous one if only the camera has moved."""
        from wrt.rendering.picture import check_contents

        if self._renderer is not None and self._scene is not None and _same_but_for_place(self._scene, scene):
            assert scene.camera is not None
            self._renderer.set_camera(scene.camera)
        else:
            self._renderer = None  # free its memory first
            self._renderer = self._options.make_renderer(scene)
            check_contents(self._files.path(0), self._renderer)
        self._scene = scene
        return self._renderer

    def _begin(self, renderer: Renderer, bar: ProgressBar) -> None:
        """Start over or continue an earlier run, once the first frame's scene is known."""
        options, files = self._options, self._files
        was_begun = files.begin(self._identity(renderer), resume=options.resume)
        if options.resume and not options.quiet:
            if was_begun:
                bar.message(f"wrt: resuming: {files.count_complete} of {len(files.numbers)} frames are complete")
            else:
                bar.message(f"wrt: no frames of {self._output} yet; starting from the beginning")

    def _identity(self, renderer: Renderer) -> dict[str, Any]:
        """Return everything that the frames depend on, by name."""
        import hashlib

        from wrt.rendering.checkpoint import identity_of, scene_fingerprint

        options = self._options
        identity = identity_of(renderer)
        scene = identity.pop("scene")
        if self._is_file_animated:  # the scene differs from frame to frame
            scene = scene_fingerprint(options.load(self._file, time=0.0))
        identity |= {f"the scene's {part}": digest for part, digest in scene.items()}
        # With --frames other frames of the same animation can be added, so their numbers do not count.
        animation = {"turntable": options.turntable} if options.frames is None else {"fps": options.fps}
        chosen = {**options.loading, **options.settings, **options.limits, **animation}
        identity |= {f"--{name.replace('_', '-')}": value for name, value in chosen.items()}
        if os.path.isfile(self._source):
            with open(self._source, "rb") as file:
                digest = hashlib.blake2b(digest_size=16)
                while block := file.read(1 << 20):
                    digest.update(block)
            identity["the input's content"] = digest.hexdigest()
        return dict(json.loads(json.dumps(identity, default=str)))

    def _write_video(self) -> None:
        """Make the video of the frames, and remove them."""
        import numpy as np
        from PIL import Image

        from wrt.animation.video import save_video

        files, interrupts = self._files, self._interrupts

        def frames() -> Iterator[Any]:
            for number in files.numbers:
                interrupts.check()
                with Image.open(files.path(number)) as picture:
                    yield np.asarray(picture.convert("RGB"))

        save_video(self._output, frames(), self._options.fps, force=self._options.force)
        interrupts.hold(files.remove)


def _same_but_for_place(a: Scene, b: Scene) -> bool:
    """Return whether two scenes differ only by where their cameras stand."""
    assert a.camera is not None
    assert b.camera is not None
    shutters = [(camera.shutter_open, camera.shutter_close) for camera in (a.camera, b.camera)]
    return a.shapes is b.shapes and a.lights is b.lights and shutters[0] == shutters[1]
