"""Ctrl-C, and the signals by which systems and clusters end a process, during a command."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from collections.abc import Callable
from types import FrameType
from typing import Any

from wrt.cli.exit_status import complain, give_up

SIGNALS = (
    *(signal.SIGINT, signal.SIGTERM, signal.SIGHUP),
    # Schedulers of clusters send these some time before they kill a job.
    *(signal.SIGUSR1, signal.SIGUSR2, signal.SIGXCPU),
)

GRACE_SECONDS = 3.0
"""Time from a signal to the end of the process, unless the main thread has reacted or has samples to save."""

_POLL_SECONDS = 0.1


class Interrupts:
    """Turns the first of `SIGNALS` into KeyboardInterrupt, but never while a file is written.

    Later signals are ignored, because the picture is being saved. As a context manager it restores the previous
    handlers; outside the main thread, which gets no signals, it does nothing.

    Python runs handlers between two instructions of the main thread, so a signal could wait for seconds while a library
    reads a large file or a kernel is compiled. In that case a thread, woken by the C-level handler, ends the process.

    Attributes:
        own_process: whether the process belongs to the command line and may be ended.
        unfinished: the message after a signal, while there is nothing to save.
        worth_saving: whether there are samples to save after a signal.
    """

    def __init__(self, unfinished: str, *, own_process: bool) -> None:
        """Prepare to handle signals from when the context is entered; see the attributes."""
        self.own_process = own_process
        self._signal_number = 0
        self._writing = False
        self.rearm(unfinished)
        self._previous: dict[int, Any] = {}
        self._previous_wakeup = -1
        self._pipe: tuple[int, int] | None = None

    def rearm(self, unfinished: str) -> None:
        """Begin another piece of work, which has nothing to save yet."""
        self.unfinished, self.worth_saving = unfinished, False
        self._armed, self._done = True, False

    def stopped(self) -> int:
        """Report an interrupt after which there is nothing to save, and return the exit status."""
        complain("stopped", self.unfinished)
        return self.exit_status

    def __enter__(self) -> Interrupts:
        if threading.current_thread() is threading.main_thread():
            for number in SIGNALS:
                # A signal ignored from the start, as by nohup, stays ignored.
                if signal.getsignal(number) is not signal.SIG_IGN:
                    self._previous[number] = signal.signal(number, self._handle)
            if self.own_process:
                self._pipe = os.pipe()
                os.set_blocking(self._pipe[1], False)
                self._previous_wakeup = signal.set_wakeup_fd(self._pipe[1], warn_on_full_buffer=False)
                watcher = threading.Thread(target=self._watch, args=(self._pipe[0],), name="wrt-signals", daemon=True)
                watcher.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done = True
        if self._pipe is not None:
            signal.set_wakeup_fd(self._previous_wakeup)
            os.close(self._pipe[1])  # ends the thread
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
        """Wait for signals; after one, end the process GRACE_SECONDS later if the main thread does not react.

        A main thread that has something to save is left alone.
        """
        with contextlib.closing(os.fdopen(pipe, "rb", buffering=0)) as file:
            while numbers := file.read(1):
                waited_since = time.monotonic()
                while numbers[0] in self._previous and not self._done and not self.worth_saving:
                    if self._writing:
                        waited_since = time.monotonic()
                    if time.monotonic() - waited_since > GRACE_SECONDS:
                        give_up(128 + numbers[0], self.unfinished)
                    time.sleep(_POLL_SECONDS)

    def check(self) -> None:
        """Raise KeyboardInterrupt again after a signal, since some libraries swallow it."""
        if self._signal_number and not self._done:
            raise KeyboardInterrupt

    def disarm(self) -> None:
        """Ignore signals from now on, while the picture is saved."""
        self._armed = False
        self._done = True

    def hold(self, action: Callable[[], object]) -> None:
        """Run `action` without interruption; raise a pending interrupt afterwards."""
        self._armed, self._writing = False, True
        try:
            action()
        finally:
            self._armed, self._writing = True, False
        self._raise_if_armed()

    @property
    def is_signalled(self) -> bool:
        """Whether a signal has arrived."""
        return self._signal_number > 0

    @property
    def exit_status(self) -> int:
        """The exit status that shells expect from a process ended by a signal."""
        return 128 + (self._signal_number or signal.SIGINT)
