"""`wrt render --turntable` and `--frames`: renders the frames of an animation, and makes a video of them."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wrt.cli.exit_status import complain, failing_in_one_line, give_up, outcome
from wrt.cli.output_paths import default_output
from wrt.cli.signals import Interrupts
from wrt.errors import InputError, one_line
from wrt.progress.bar import ProgressBar, once, short_warnings

if TYPE_CHECKING:
    from wrt.animation.frame_files import FrameFiles
    from wrt.rendering.renderer import Renderer
    from wrt.scene.scene import Scene

_NOT_OF_THE_PICTURE = frozenset(
    ("run", "own_process", "inputs", "input", "output", "resume", "force", "quiet", "json", "threads", "device")
    + ("checkpoint", "save_every", "fps", "part", "dask")
)
"""Options that do not change a frame; all others belong to an animation's identity."""


SAMPLES_FOR_EXPOSURE = 4


@dataclass
class Animation:
    """What is being rendered.

    Attributes:
        output: the video, or the name of the frames.
        files: the frames.
        video: whether the frames become a video.
        current: the renderer of the latest frame.
        scene: the scene of the latest frame.
        exposure: stops, the same for all frames.
    """

    output: Path
    files: FrameFiles
    video: bool
    current: Renderer | None = None
    scene: Scene | None = None
    exposure: float = 0.0


def render_frames(options: argparse.Namespace) -> int:
    """Render the frames of one input; return the exit status."""
    said: set[str] = set()
    nothing = "no frame was rendered yet"
    with Interrupts((lambda status: give_up(status, nothing)) if options.own_process else None) as interrupts:
        try:
            return outcome(lambda: _render(options, interrupts, said))
        except KeyboardInterrupt:
            complain("stopped", nothing)
            return interrupts.exit_status


def _render(options: argparse.Namespace, interrupts: Interrupts, said: set[str]) -> int:
    started = time.monotonic()
    animation = _prepare(options)
    files = animation.files
    label = animation.output.name if animation.video else files.location.stem
    with (
        ProgressBar(label, time_limit=options.time, wanted=not options.quiet) as bar,
        short_warnings(say := once(bar.message, said)),
    ):
        try:
            with failing_in_one_line():
                _render_missing(options, animation, interrupts, bar)
            if animation.video:
                bar.relabel(f"{label} (writing)")
                _assemble(options, animation, interrupts)
        except KeyboardInterrupt:
            interrupts.disarm()
            if not files.complete:
                files.remove()
                raise
            done = f"{files.count_complete} of {len(files.numbers)} frames complete, in {files.location}"
            say(f"wrt: stopped: {done}; the same command with --resume continues")
            return interrupts.exit_status
        interrupts.disarm()
    _report(options, animation, time.monotonic() - started)
    return 0


def _prepare(options: argparse.Namespace) -> Animation:
    """Check the options and paths, before the long work."""
    from wrt.animation.frame_files import FrameFiles, has_place
    from wrt.animation.video import VIDEO_SUFFIXES, check_video, is_video

    if len(options.inputs) > 1:
        raise InputError("--turntable and --frames are for a single input; render the inputs one at a time")
    if options.part is not None:
        raise InputError("--part is for a single picture; spread frames by --frames A-B")
    if options.checkpoint is not None:
        raise InputError("--checkpoint is for a single picture; frames are resumed by --resume alone")
    if options.turntable is not None and options.frames is not None:
        raise InputError("--turntable and --frames cannot be combined yet; choose one")
    options.input = options.inputs[0]
    output = Path(options.output or Path(default_output(options.input)).with_suffix(".mp4"))
    video = is_video(output)
    if not video and not has_place(str(output)):
        kinds = ", ".join(VIDEO_SUFFIXES)
        raise InputError(f"{output}: name a video ({kinds}), or frames with a place for their numbers: cow_%04d.png")
    if video:
        check_video(output, fps=options.fps, force=options.force)
    first, last = options.frames or (0, options.turntable - 1)
    files = FrameFiles(output, range(first, last + 1), force=options.force)
    return Animation(output, files, video)


def _render_missing(
    options: argparse.Namespace, animation: Animation, interrupts: Interrupts, bar: ProgressBar
) -> None:
    files = animation.files
    limits = {"spp": options.spp, "time": options.time, "noise": options.noise, "adaptive": options.adaptive or None}
    begun = False
    for index, (number, scene) in enumerate(zip(files.numbers, _scenes(options, animation), strict=True)):
        if begun and number in files.complete:
            continue
        bar.relabel(
            f"{animation.output.name if animation.video else files.location.stem} {index + 1}/{len(files.numbers)}"
        )
        if not begun:
            renderer = _renderer_of(options, animation, scene)
            interrupts.hold(lambda: _begin(options, animation, bar))
            animation.exposure = _exposure(options, renderer)
            begun = True
            if number in files.complete:
                continue
        else:
            renderer = _renderer_of(options, animation, scene)
        for progress in renderer.passes(**limits, pass_seconds=renderer.longest_pass):
            interrupts.worth_saving = True
            interrupts.check()
            bar.update(progress)
        interrupts.hold(partial(_keep, animation, number, renderer))


def _keep(animation: Animation, number: int, renderer: Renderer) -> None:
    exposure = animation.exposure
    animation.files.add(number, lambda path, force: renderer.save(path, exposure=exposure, force=force))


def _exposure(options: argparse.Namespace, renderer: Renderer) -> float:
    """Return the exposure that the first frame has with a few samples: frames of their own exposures would flicker."""
    from wrt.develop.exposure import stops

    if not renderer.renders_light:
        return 0.0
    for _ in renderer.passes(spp=min(options.spp or renderer.settings.spp, SAMPLES_FOR_EXPOSURE)):
        pass
    return stops(renderer.image(), renderer.settings.exposure)


def _scenes(options: argparse.Namespace, animation: Animation) -> Iterator[Scene]:
    """Yield the scene of each frame."""
    from wrt.animation.timeline import at_frame, is_animated, moves
    from wrt.animation.turntable import turntable

    if options.frames is not None and is_animated(options.input):
        for number in animation.files.numbers:
            yield _loaded(options, time=number / options.fps)
        return
    scene = _loaded(options)
    if options.turntable is not None:
        yield from turntable(scene, options.turntable)
        return
    if not moves(scene):
        raise InputError(f"{options.input}: nothing in it moves: neither a shape nor the camera has keyframes")
    for number in animation.files.numbers:
        yield at_frame(scene, number, options.fps)


def _loaded(options: argparse.Namespace, *, time: float | None = None) -> Scene:
    """Return the scene of the input, with the size of the pictures in its settings."""
    import dataclasses

    from wrt.cli.load import load_input

    scene = load_input(options, time=time)
    if options.size is not None:
        width, height = options.size
        scene.settings = dataclasses.replace(scene.settings, width=width, height=height)
    return scene


def _renderer_of(options: argparse.Namespace, animation: Animation, scene: Scene) -> Renderer:
    """Return a renderer for a frame: the one before, if only the camera is another."""
    from wrt.cli.load import make_renderer
    from wrt.rendering.picture import check_contents

    before, renderer = animation.scene, animation.current
    assert scene.camera is not None
    if renderer is not None and before is not None and _same_but_for_place(before, scene):
        renderer.set_camera(scene.camera)
    else:
        animation.current = renderer = None  # free its memory first
        renderer = make_renderer(options, scene)
        check_contents(animation.files.path(0), renderer)
    animation.scene, animation.current = scene, renderer
    return renderer


def _same_but_for_place(a: Scene, b: Scene) -> bool:
    """Return whether two scenes differ only by where their cameras stand."""
    assert a.camera is not None
    assert b.camera is not None
    times = [(camera.shutter_open, camera.shutter_close) for camera in (a.camera, b.camera)]
    return a.shapes is b.shapes and a.lights is b.lights and times[0] == times[1]


def _begin(options: argparse.Namespace, animation: Animation, bar: ProgressBar) -> None:
    """Begin anew or take up an earlier run's frames, once the first frame's scene is known."""
    assert animation.current is not None
    files = animation.files
    found = files.begin(_identity(options, animation.current), resume=options.resume)
    if options.resume and not options.quiet:
        if found:
            bar.message(f"wrt: resuming: {files.count_complete} of {len(files.numbers)} frames are complete")
        else:
            bar.message(f"wrt: no frames of {animation.output} yet; starting from the beginning")


def _identity(options: argparse.Namespace, renderer: Renderer) -> dict[str, Any]:
    """Return by name what the frames depend on."""
    import hashlib

    from wrt.animation.timeline import is_animated
    from wrt.rendering.checkpoint import identity_of
    from wrt.rendering.fingerprint import scene_fingerprint

    own = identity_of(renderer)
    scene = own.pop("scene")
    if options.frames is not None and is_animated(options.input):  # the first frame's scene is not that of all
        scene = scene_fingerprint(_loaded(options, time=0.0))
    chosen = {f"--{key.replace('_', '-')}": value for key, value in vars(options).items()}
    chosen = {key: value for key, value in chosen.items() if key[2:].replace("-", "_") not in _NOT_OF_THE_PICTURE}
    if options.frames is not None:
        chosen["--fps"] = options.fps
        chosen.pop("--frames")  # other frames of the same animation can be added
    whole = {**own, **{f"the scene's {part}": digest for part, digest in scene.items()}, **chosen}
    source = Path(options.input)
    if os.path.isfile(source):
        with source.open("rb") as file:
            digest = hashlib.blake2b(digest_size=16)
            while block := file.read(1 << 20):
                digest.update(block)
        whole["the input's content"] = digest.hexdigest()
    return dict(json.loads(json.dumps(whole, default=str)))


def _assemble(options: argparse.Namespace, animation: Animation, interrupts: Interrupts) -> None:
    """Make the video of the frames, and remove them."""
    import numpy as np
    from PIL import Image

    from wrt.animation.video import save_video

    files = animation.files

    def frames() -> Iterator[Any]:
        for number in files.numbers:
            interrupts.check()
            with Image.open(files.path(number)) as picture:
                yield np.asarray(picture.convert("RGB"))

    save_video(animation.output, frames(), options.fps, force=options.force)
    interrupts.hold(files.remove)


def _report(options: argparse.Namespace, animation: Animation, seconds: float) -> None:
    renderer = animation.current
    assert renderer is not None
    count = len(animation.files.numbers)
    size = f"{renderer.film.width}x{renderer.film.height}"
    if not options.quiet:
        spp = f"  {renderer.spp} spp" if renderer.spp else ""
        print(f"{one_line(str(animation.output))}  {count} frames  {size}{spp}  {seconds:.1f} s", file=sys.stderr)
    if options.json:
        summary = {
            "input": options.input,
            "output": str(animation.output),
            "frames": count,
            "fps": options.fps,
            "device": renderer.device.name,
            "threads": renderer.threads,
            "width": renderer.film.width,
            "height": renderer.film.height,
            "spp": renderer.spp,
            "seconds_total": seconds,
        }
        print(json.dumps(summary), flush=True)
