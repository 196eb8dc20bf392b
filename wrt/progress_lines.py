"""Progress where nobody watches a terminal: plain lines, soon at first, then ever more seldom."""

from __future__ import annotations

import sys
import threading
import time

GETTING_READY = "getting ready; kernels are compiled the first time"

FIRST_SECONDS = 2.0
"""After so long there is a line; what takes less needs none."""

MOST_SECONDS = 15.0
"""Between two lines at most; they come after 2, 4, 8, 16, 31, 46 ... seconds."""


class ProgressLines:
    """A thread that says now and then where a render stands, while others are busy.

    Attributes:
        text: where it stands.
    """

    def __init__(self, label: str) -> None:
        """Take what is being rendered."""
        self.text = GETTING_READY
        self._label = label
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="wrt-progress", daemon=True)

    def start(self) -> None:
        """Begin to count the time."""
        self._thread.start()

    def stop(self) -> None:
        """Say nothing from here on."""
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        started, due = time.monotonic(), FIRST_SECONDS
        while not self._ended.wait(max(0.0, started + due - time.monotonic())):
            print(f"wrt: {self._label}: {self.text}", file=sys.stderr, flush=True)
            due += min(due, MOST_SECONDS)
