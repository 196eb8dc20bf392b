"""Progress for log files and pipes: plain lines, at growing intervals."""

from __future__ import annotations

import sys
import threading
import time

from wrt.threads import start_if_possible

GETTING_READY = "getting ready; kernels are compiled the first time"

FIRST_SECONDS = 2.0
"""Time before the first line; shorter renders print no line."""

MOST_SECONDS = 15.0
"""Longest interval between lines, which come after 2, 4, 8, 16, 31, 46 ... seconds if the status has changed."""


class ProgressLines:
    """A thread that prints the status of a render from time to time, if it has changed.

    Attributes:
        text: the status to print next.
    """

    def __init__(self, label: str) -> None:
        """Prepare lines that begin with `label`, the name of the picture."""
        self.text = GETTING_READY
        self._label = label
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="wrt-progress", daemon=True)

    def start(self) -> None:
        """Start the thread and its clock."""
        start_if_possible(self._thread)

    def stop(self) -> None:
        """Stop the thread; nothing is printed after this."""
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join(timeout=1.0)  # it may be blocked on a pipe without a reader

    def _run(self) -> None:
        started, due, printed = time.monotonic(), FIRST_SECONDS, ""
        while not self._ended.wait(max(0.0, started + due - time.monotonic())):
            if self.text != printed:
                printed = self.text
                print(f"wrt: {self._label}: {printed}", file=sys.stderr, flush=True)
            due += min(due, MOST_SECONDS)
