"""A page that shows a session, in a browser's tab or in a notebook: the messages between both.

Messages from a page are JSON: `ack` (the number of a frame it has drawn), `camera` (fields of the camera, and a serial
number that frames repeat), `set` (settings), `pick` (a place in the picture), `toml` and `save` (a suffix). Messages to
it are JSON (`state`, `picked`, `toml`, `error`), or JSON and bytes: `frame`, with a JPEG file and the header of a
`Frame`, and `file`, with a picture to save and its name.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from typing import Any

from wrt.errors import InputError
from wrt.values import one_of
from wrt.view.controls import camera_toml
from wrt.view.frames import Frame
from wrt.view.session import Session

UNACKNOWLEDGED = 2
"""Frames that are sent to a page before it has acknowledged the first."""

SAVED = (".png", ".exr")
"""Suffixes of pictures that a page may save."""


class Viewer:
    """Passes messages between a session and a page. The newest frame waits for the page; older ones are skipped.

    Subclasses define `send`, which runs in the thread of the event loop.

    Attributes:
        session: the session.
    """

    def __init__(self, session: Session) -> None:
        """Use the running event loop, if there is one."""
        self.session = session
        self._frame: Frame | None = None
        self._unacknowledged: list[int] = []
        self._end_listening: Callable[[], None] | None = None
        try:
            self._loop: asyncio.AbstractEventLoop | None = asyncio.get_running_loop()
        except RuntimeError:  # Python without a notebook
            self._loop = None

    def send(self, message: dict[str, Any], content: bytes | None = None) -> None:
        """Send a message, perhaps with the content of a file."""
        raise NotImplementedError

    def begin(self) -> None:
        """Show the session on the page, from the beginning."""
        self.end()
        self._unacknowledged.clear()
        self._end_listening = self.session.listen(lambda message: self._call(self._show, message))

    def end(self) -> None:
        """Show nothing more."""
        if self._end_listening is not None:
            self._end_listening()
            self._end_listening = None

    def send_frame(self, frame: Frame) -> None:
        """Send a frame."""
        self.send({"type": "frame", "frame": frame.number, **frame.header}, frame.picture)

    def _send_newest(self) -> None:
        """Send the newest frame once, when the page can take it."""
        if self._frame is not None and len(self._unacknowledged) < UNACKNOWLEDGED:
            frame, self._frame = self._frame, None
            self._unacknowledged.append(frame.number)
            self.send_frame(frame)

    def receive(self, message: Any) -> None:
        """Handle a message from the page, and send it the error of an unusable one."""
        try:
            self._handle(message)
        except (InputError, OSError, MemoryError) as error:
            self.send({"type": "error", "text": str(error) or "not enough memory"})
        except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError) as error:
            self.send({"type": "error", "text": f"a message that is not understood: {error}"})

    def _handle(self, message: Any) -> None:
        kind = message.get("type")
        if kind == "ack":
            self._unacknowledged = [number for number in self._unacknowledged if number > message["frame"]]
            self._send_newest()
        elif kind == "camera":
            self.session.move(message.get("camera"), message.get("serial"))
        elif kind == "set":
            self.session.change(message)
        elif kind == "toml" and self.session.camera is not None:
            self.send({"type": "toml", "text": camera_toml(self.session.camera)})
        elif kind == "save":
            suffix = one_of(message["suffix"], SAVED, "suffix")
            name = f"{self.session.name}{suffix}"
            self.reply(self.session.save(suffix), lambda content: self.send({"type": "file", "name": name}, content))
        elif kind == "pick":
            action = message.get("action")
            self.reply(
                self.session.pick(message["x"], message["y"]),
                lambda picked: self.send({"type": "picked", "action": action, "picked": picked}),
            )

    def reply(self, future: Future[Any], send: Callable[[Any], None]) -> None:
        """Call `send` with the result of a request to the session once it is done; send its error instead."""

        def finish() -> None:
            try:
                send(future.result())
            except CancelledError:
                pass
            except (InputError, OSError, MemoryError) as error:
                self.send({"type": "error", "text": str(error) or "not enough memory"})

        future.add_done_callback(lambda _: self._call(finish))

    def _call(self, function: Callable[..., None], *arguments: Any) -> None:
        """Call a function in the thread of the event loop."""
        if self._loop is None:
            function(*arguments)
            return
        with contextlib.suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(function, *arguments)

    def _show(self, message: Frame | dict[str, Any]) -> None:
        if isinstance(message, Frame):
            self._frame = message
            self._send_newest()
        else:
            self.send(message)
