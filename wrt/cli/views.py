"""`wrt render --cameras`: the pictures of one input through the cameras of a file, from one build of the scene."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wrt.cli.options import RenderOptions
from wrt.cli.output import Output, default_output, folder_for
from wrt.errors import InputError
from wrt.io.camera_files import FileCamera, load_cameras
from wrt.io.cameras import note_several, number_of

if TYPE_CHECKING:
    from wrt.rendering.renderer import Renderer
    from wrt.scene.scene import Scene


@dataclass
class Shared:
    """What the views of a command share: the scene once it is loaded, and the last renderer."""

    scene: Scene | None = None
    renderer: Renderer | None = None


@dataclass(frozen=True)
class ViewOptions(RenderOptions):
    """The options of one view.

    Attributes:
        seen: its camera and the size of its picture, unless --size gives another.
        shared: what it shares with the other views.
    """

    seen: FileCamera | None = None
    shared: Shared = field(default_factory=Shared)

    @property
    def can_go_on(self) -> bool:
        """Whether the scene, which all views share, is loaded."""
        return self.shared.scene is not None

    def load(self, source: str, *, time: float | None = None) -> Scene:
        """Return the scene with the camera of the view, and load it for the first view."""
        assert self.seen is not None
        if self.shared.scene is None:
            self.shared.scene = super().load(source, time=time)
        scene, settings = self.shared.scene, self.shared.scene.settings
        if self.settings["width"] is None:
            settings = settings.changed(width=self.seen.width, height=self.seen.height)
        return dataclasses.replace(scene, camera=self.seen.camera, settings=settings)

    def make_renderer(self, scene: Scene) -> Renderer:
        """Return a renderer that shares the scene with the one before, where their cameras have the same kernel."""
        from wrt.rendering.renderer import Renderer

        before, camera = self.shared.renderer, scene.camera
        assert camera is not None
        if type(before) is not Renderer or before.camera.model != camera.model:  # one of a cluster shares nothing
            self.shared.renderer = None  # free its memory first
            self.shared.renderer = super().make_renderer(scene)
            return self.shared.renderer
        before.set_camera(camera)
        return before.sharing(width=scene.settings.width, height=scene.settings.height)


def chosen_cameras(loading: Mapping[str, Any]) -> dict[str, FileCamera]:
    """Return the cameras of the file of --cameras: all, or the one of --camera."""
    path, choice = loading["cameras"], loading["camera"]
    cameras = load_cameras(path, confined=loading["confined"])
    if choice is None:
        return cameras
    name = list(cameras)[number_of(path, list(cameras), choice)]
    return {name: cameras[name]}


def load_seen(source: str, loading: Mapping[str, Any], size: tuple[int, int] | None = None) -> Scene:
    """Return a scene for commands that show one view of it.

    With --cameras it is the one of --camera or the first, with a warning if there are several, in its picture's size.

    Args:
        source: the input.
        loading: options of `wrt.load`, among them `cameras`.
        size: width and height of the picture; by default the camera's, and otherwise the scene's.
    """
    from wrt.api import load_with_settings

    width, height = size or (None, None)
    if loading["cameras"] is not None:
        cameras = chosen_cameras(loading)
        note_several(loading["cameras"], list(cameras))
        name, seen = next(iter(cameras.items()))
        width, height = size or (seen.width, seen.height)
        loading = {**loading, "camera": name}
    return load_with_settings(source, {"width": width, "height": height}, **loading)


def each_model(options: RenderOptions) -> list[RenderOptions]:
    """Return the options of one view for each model of camera; without --cameras the options themselves."""
    if options.loading["cameras"] is None:
        return [options]
    views = [view for _, _, view in views_of(options) if isinstance(view, ViewOptions) and view.seen is not None]
    return list({view.seen.camera.model: view for view in reversed(views) if view.seen is not None}.values())


def views_of(options: RenderOptions) -> list[tuple[str, Output, RenderOptions]]:
    """Return the name, the output and the options of each view of an input.

    Raises:
        InputError: if an option is not possible with --cameras, or the file has no camera of a name.
    """
    if len(options.inputs) > 1:
        raise InputError("--cameras is for a single input; render the inputs one at a time")
    for name in ("turntable", "frames", "part"):
        if getattr(options, name) is not None:
            raise InputError(f"--cameras and --{name} cannot be combined")
    cameras = chosen_cameras(options.loading)
    names = list(cameras)
    if options.checkpoint is not None and len(names) > 1:
        raise InputError("--checkpoint is for a single picture; choose a view by --camera")
    shared, pictures = Shared(), set[Path]()
    # The first view's camera stands for all while the scene is loaded.
    loading: dict[str, Any] = {**options.loading, "camera": names[0]}
    values = {each.name: getattr(options, each.name) for each in dataclasses.fields(options)} | {"loading": loading}
    is_file = options.output is not None and len(names) == 1 and not options.output.endswith("/")
    folder = "" if options.output is None or is_file else folder_for(options.output)
    prefix = "" if folder else f"{Path(default_output(options.inputs[0])).stem}-"
    suffix = ".exr" if options.settings["layers"] else ".png"
    checkpoint = None if options.checkpoint is None else Path(options.checkpoint)
    views: list[tuple[str, Output, RenderOptions]] = []
    for name in names:
        file = str(options.output) if is_file else os.path.join(folder, f"{prefix}{name}{suffix}")
        force = options.force and options.output is not None
        output = Output(file, not is_file, force, checkpoint, pictures)
        views.append((name, output, ViewOptions(**values, seen=cameras[name], shared=shared)))
    return views
