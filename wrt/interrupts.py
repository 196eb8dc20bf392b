"""Ctrl-C and SIGTERM during a long render."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from types import FrameType
from typing import Any


class Interrupts:
    """Turns the first SIGINT or SIGTERM into KeyboardInterrupt, though never while a file is written.

    Later ones are ignored: by then the picture is being saved. Used as a context manager, it puts
    back the handlers it found; outside the main thread, which gets no signals, it does nothing.
    """

    def __init__(self) -> None:
        """Start armed; signals count from when the context is entered."""
        self._signal_number = 0
        self._armed = True
        self._previous: dict[int, Any] = {}

    def __enter__(self) -> Interrupts:
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                # A process started with a signal ignored, as by nohup, goes on ignoring it.
                if signal.getsignal(number) is not signal.SIG_IGN:
                    self._previous[number] = signal.signal(number, self._handle)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        self._signal_number = self._signal_number or number
        self._raise_if_armed()

    def _raise_if_armed(self) -> None:
        if self._signal_number and self._armed:
            self._armed = False
            raise KeyboardInterrupt

    def disarm(self) -> None:
        """From here on let nothing interrupt: what is left to do is to save."""
        self._armed = False

    def hold(self, action: Callable[[], None]) -> None:
        """Run `action` to its end; an interrupt that comes meanwhile is raised after it."""
        self._armed = False
        action()
        self._armed = True
        self._raise_if_armed()

    @property
    def exit_status(self) -> int:
        """What a shell expects of a process that a signal ended."""
        return 128 + self._signal_number
