"""Scenes, meshes and renderers in notebooks: small pictures, and live views by anywidget (`wrt[notebook]`)."""

from __future__ import annotations

import base64
import dataclasses
import sys
from collections.abc import Callable
from importlib import resources
from typing import Any

from wrt.develop.picture import develop
from wrt.errors import InputError
from wrt.rendering.passes import LONGEST_PASS
from wrt.rendering.renderer import Renderer
from wrt.scene.mesh import Mesh
from wrt.scene.scene import MAX_SPP, Scene
from wrt.values import integer
from wrt.view.frames import Frame
from wrt.view.picture import png
from wrt.view.session import Session
from wrt.view.viewer import Viewer

LARGEST_SIDE = 320
"""Pixels of the longer side of the picture of a scene or mesh."""

SAMPLES, SECONDS = 16, 2.0
"""Limits of that picture's rendering."""


def picture_of_renderer(renderer: Renderer) -> bytes | None:
    """Return the picture of a renderer so far as a PNG file; None before the first sample."""
    if renderer.spp == 0 or not renderer.has_picture:
        return None
    image, parts, exposure = renderer._undeveloped()
    return png(develop(image, **parts, tone=renderer.settings.tone, exposure=exposure).codes)


def picture_of_scene(scene: Scene) -> bytes | None:
    """Return a small picture of a scene as a PNG file; None if it cannot be rendered."""
    settings = scene.settings
    scale = min(1.0, LARGEST_SIDE / max(settings.width, settings.height))
    width, height = (max(1, round(scale * side)) for side in (settings.width, settings.height))
    small = dataclasses.replace(settings, width=width, height=height, crop=None, layers=())
    if small.integrator == "aov":
        small = dataclasses.replace(small, integrator=None)
    try:
        renderer = Renderer(dataclasses.replace(scene, settings=small))
    except InputError:  # the scene is not complete yet
        return None
    for _ in renderer.passes(spp=SAMPLES, time=SECONDS, pass_seconds=min(SECONDS, LONGEST_PASS)):
        pass
    return picture_of_renderer(renderer)


def picture_of_mesh(mesh: Mesh) -> bytes | None:
    """Return a small picture of a mesh in the studio as a PNG file."""
    from wrt.api import load

    try:
        return picture_of_scene(load(mesh))
    except InputError:  # its colours are not those of a material
        return None


def display(picture: Any) -> bool:
    """Show a Pillow image in the cell of a notebook or of a console of IPython; return whether there is one."""
    ipython = sys.modules.get("IPython")
    if ipython is None or ipython.get_ipython() is None:
        return False
    ipython.display.display(picture)
    return True


def view_scene(scene: Scene, *, spp: int | None = None, **options: Any) -> Any:
    """Return the widget of a scene; `options` are those of `wrt.Renderer`."""
    return view_renderer(Renderer(scene, **options), spp=spp)


def view_renderer(renderer: Renderer, *, spp: int | None = None) -> Any:
    """Return a widget that shows a renderer's samples, and continues until it has `spp` in each pixel.

    Raises:
        InputError: when anywidget is not installed, or on an unusable spp.
    """
    try:
        import anywidget
        import traitlets
    except ImportError:
        raise InputError("a view in a notebook needs anywidget: pip install 'wrt[notebook]'") from None

    if spp is not None:
        spp = integer(spp, "spp", minimum=1, maximum=MAX_SPP)
    page = resources.files("wrt.view") / "page"

    class View(anywidget.AnyWidget):
        """A live view; `snapshot` is its last picture, a PNG file, which a saved notebook keeps."""

        _esm = (page / "view.js").read_text()
        _css = (page / "view.css").read_text()
        snapshot = traitlets.Unicode("").tag(sync=True)

        def _repr_mimebundle_(self, **options: Any) -> Any:
            """Return the output with a PNG beside the widget, for viewers in which widgets do not run."""
            bundle, picture = super()._repr_mimebundle_(**options), self.viewer.picture()
            if bundle is None or picture is None:
                return bundle
            data, metadata = bundle if isinstance(bundle, tuple) else (bundle, {})
            return {**data, "image/png": base64.b64encode(picture).decode()}, metadata

        def close(self) -> None:
            """End the rendering; the picture stays."""
            self.viewer.end()
            self.viewer.session.close()
            super().close()

    widget = View()
    widget.viewer = WidgetViewer(widget, lambda: renderer, spp)
    return widget


class WidgetViewer(Viewer):
    """The widget of a notebook, whose messages must be sent from the kernel's own thread."""

    def __init__(self, widget: Any, open: Callable[[], Renderer], spp: int | None) -> None:
        """Answer the widget's messages."""
        super().__init__(Session(open, name="picture", spp=spp))
        self._widget = widget
        widget.on_msg(lambda _, message, buffers: self.receive(message))

    def picture(self) -> bytes | None:
        """Return the newest picture as a PNG file, or None before the first."""
        codes = self.session.codes()
        return None if codes is None else png(codes)

    def send(self, message: dict[str, Any], content: bytes | None = None) -> None:
        """Send a message, and the content of a file."""
        self._widget.send(message, None if content is None else [content])

    def send_frame(self, frame: Frame) -> None:
        """Send a frame; the last one is the picture that a saved notebook keeps."""
        super().send_frame(frame)
        if frame.header["spp"] >= frame.header["target"]:
            picture = self.picture()
            self._widget.snapshot = "" if picture is None else base64.b64encode(picture).decode()

    def _handle(self, message: Any) -> None:
        if message.get("type") == "open":  # the notebook shows the widget, perhaps once more
            self.begin()
        else:
            super()._handle(message)
