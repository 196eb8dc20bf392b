"""The live view as a widget of notebooks, by anywidget (the extra `wrt[notebook]`)."""

from __future__ import annotations

import asyncio
import base64
import contextlib
from collections.abc import Callable
from importlib import resources
from typing import TYPE_CHECKING, Any

from wrt.errors import InputError
from wrt.scene.scene import MAX_SPP
from wrt.values import integer
from wrt.view.controls import camera_toml
from wrt.view.frames import Frame
from wrt.view.picture import png
from wrt.view.session import Session

if TYPE_CHECKING:
    from wrt.rendering.renderer import Renderer

UNSEEN = 2
"""Frames that may be on their way to a notebook that has not acknowledged them."""


def view_widget(open: Callable[[], Renderer], *, name: str = "picture", spp: int | None = None) -> Any:
    """Return a widget that shows a renderer's picture while it converges.

    Args:
        open: makes the renderer, in another thread.
        name: the name of saved pictures.
        spp: samples per pixel at which to rest.

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
            return with_picture(super()._repr_mimebundle_(**options), self.link.picture())

        def close(self) -> None:
            """End the rendering; the picture stays."""
            self.link.close()
            super().close()

    widget = View()
    widget.link = Link(widget, Session(open, name=name, spp=spp))
    return widget


def with_picture(bundle: Any, picture: bytes | None) -> Any:
    """Return a notebook's output with a PNG beside the widget, for viewers in which widgets do not run."""
    if bundle is None or picture is None:
        return bundle
    data, metadata = bundle if isinstance(bundle, tuple) else (bundle, {})
    return {**data, "image/png": base64.b64encode(picture).decode()}, metadata


class Link:
    """Between a session and the widget of a notebook, whose messages must be sent from the kernel's own thread."""

    def __init__(self, widget: Any, session: Session) -> None:
        """Answer the widget's messages."""
        self.session = session
        self._widget = widget
        self._frame: Frame | None = None
        self._unseen: list[int] = []
        self._end: Callable[[], None] | None = None
        try:
            self._loop: asyncio.AbstractEventLoop | None = asyncio.get_running_loop()
        except RuntimeError:  # not in a notebook
            self._loop = None
        widget.on_msg(self._take)

    def picture(self) -> bytes | None:
        """Return the newest picture as a PNG file, or None before the first."""
        codes = self.session.codes()
        return None if codes is None else png(codes)

    def close(self) -> None:
        """End the session."""
        if self._end is not None:
            self._end()
        self.session.close()

    def _later(self, call: Callable[..., None], *arguments: Any) -> None:
        """Call something in the kernel's thread."""
        if self._loop is None:
            call(*arguments)
            return
        with contextlib.suppress(RuntimeError):  # the kernel has ended
            self._loop.call_soon_threadsafe(call, *arguments)

    def _listen(self, what: Frame | dict[str, Any]) -> None:
        self._later(self._put, what)

    def _put(self, what: Frame | dict[str, Any]) -> None:
        if isinstance(what, Frame):
            self._frame = what
            self._send_frame()
        else:
            self._widget.send(what)

    def _send_frame(self) -> None:
        if self._frame is None or len(self._unseen) >= UNSEEN:
            return
        frame, self._frame = self._frame, None
        self._unseen.append(frame.number)
        self._widget.send({"type": "frame"}, [frame.message()])
        if frame.header["spp"] >= frame.header["target"]:  # what a saved notebook shows
            picture = self.picture()
            self._widget.snapshot = "" if picture is None else base64.b64encode(picture).decode()

    def _take(self, _: Any, message: Any, buffers: Any) -> None:
        try:
            self._answer(message)
        except InputError as error:
            self._widget.send({"type": "error", "text": str(error)})

    def _answer(self, message: dict[str, Any]) -> None:
        kind = message.get("type")
        if kind == "open":  # the notebook shows the widget, perhaps once more
            if self._end is not None:
                self._end()
            self._unseen.clear()
            self._end = self.session.listen(self._listen)
        elif kind == "ack":
            self._unseen = [number for number in self._unseen if number > message["frame"]]
            self._send_frame()
        elif kind == "camera":
            self.session.move(message.get("camera"), message.get("serial"))
        elif kind == "set":
            self.session.change(message)
        elif kind == "toml" and self.session.camera is not None:
            self._widget.send({"type": "toml", "text": camera_toml(self.session.camera)})
        elif kind == "pick":
            action = message.get("action")
            picked = self.session.pick(message["x"], message["y"])
            picked.add_done_callback(
                lambda done: self._later(
                    self._finished, done, lambda what: ({"type": "picked", "action": action, "picked": what}, None)
                )
            )
        elif kind == "save" and message.get("suffix") in (".png", ".exr"):
            name = f"{self.session.name}{message['suffix']}"
            saved = self.session.save(message["suffix"])
            saved.add_done_callback(
                lambda done: self._later(self._finished, done, lambda what: ({"type": "file", "name": name}, [what]))
            )

    def _finished(self, done: Any, message: Callable[[Any], tuple[dict[str, Any], Any]]) -> None:
        error = done.exception()
        if error is not None:
            self._widget.send({"type": "error", "text": str(error)})
        else:
            self._widget.send(*message(done.result()))
