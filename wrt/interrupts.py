"""Ctrl-C, SIGTERM and SIGHUP during a long render."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from collections.abc import Callable
from types import FrameType
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

GRACE_SECONDS = 3.0
"""Grace period after a signal: then the process is ended, unless the main thread has reacted or must save."""

_LOOK_SECONDS = 0.1


class Interrupts:
    """Turns the first of `SIGNALS` into KeyboardInterrupt, though never while a file is written.

    Later ones are ignored: by then the picture is being saved. Used as a context manager, it puts
    back the handlers it found; outside the main thread, which gets no signals, it does nothing.

    Python runs handlers between two instructions of the main thread. So while a library reads a large file, or a kernel
    is compiled, a signal could wait for many seconds. A thread that the C-level handler wakes up ends the process then.

    Attributes:
        worth_saving: whether there are samples that a signal must not lose.
    """

    def __init__(self, give_up: Callable[[int], object] | None = None) -> None:
        """Start armed; signals count from when the context is entered.

        Args:
            give_up: ends the process with an exit status if the main thread does not react; None where the process does
                not belong to the command line.
        """
        self.worth_saving = False
        self._give_up = give_up
        self._signal_number = 0
        self._armed = True
        self._writing = False
        self._done = False
        self._previous: dict[int, Any] = {}
        self._previous_wakeup = -1
        self._pipe: tuple[int, int] | None = None

    def __enter__(self) -> Interrupts:
        if threading.current_thread() is threading.main_thread():
            for number in SIGNALS:
                # A process started with a signal ignored, as by nohup, goes on ignoring it.
                if signal.getsignal(number) is not signal.SIG_IGN:
                    self._previous[number] = signal.signal(number, self._handle)
            if self._give_up is not None:
                self._pipe = os.pipe()
                os.set_blocking(self._pipe[1], False)
                self._previous_wakeup = signal.set_wakeup_fd(self._pipe[1], warn_on_full_buffer=False)
                threading.Thread(target=self._watch, args=(self._pipe[0],), name="wrt-signals", daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done = True
        if self._pipe is not None:
            signal.set_wakeup_fd(self._previous_wakeup)
            os.close(self._pipe[1])  # the thread then ends
        for number, handler in self._previous.items():
            signal.signal(number, handler)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        self._signal_number = self._signal_number or number
        self._raise_if_armed()

    def _raise_if_armed(self) -> None:
        if self._signal_number and self._armed:
            self._armed = False
            raise KeyboardInterrupt

    def _watch(self, pipe: int) -> None:
        """Wait for a signal; end the process if the main thread does not react in time and nothing is worth saving."""
        with contextlib.closing(os.fdopen(pipe, "rb", buffering=0)) as file:
            while numbers := file.read(1):
                if numbers[0] in self._previous:
                    self._wait(numbers[0])

    def _wait(self, number: int) -> None:
        """End the process GRACE_SECONDS after a signal, unless it is obeyed or there is something to save."""
        waited_since = time.monotonic()
        while not self._done and not self.worth_saving:
            if self._writing:
                waited_since = time.monotonic()
            if time.monotonic() - waited_since > GRACE_SECONDS and self._give_up is not None:
                self._give_up(128 + number)
            time.sleep(_LOOK_SECONDS)

    def check(self) -> None:
        """Raise KeyboardInterrupt if there was a signal, since some libraries swallow the exception."""
        if self._signal_number and not self._done:
            raise KeyboardInterrupt

    def disarm(self) -> None:
        """From here on let nothing interrupt: what is left to do is to save."""
        self._armed = False
        self._done = True

    def hold(self, action: Callable[[], object]) -> None:
        """Run `action` to its end; an interrupt that comes meanwhile is raised after it."""
        self._armed, self._writing = False, True
        try:
            action()
        finally:
            self._armed, self._writing = True, False
        self._raise_if_armed()

    @property
    def exit_status(self) -> int:
        """What a shell expects of a process that a signal ended."""
        return 128 + self._signal_number
