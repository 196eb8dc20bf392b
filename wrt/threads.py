"""Threads where the system may allow no more of them (`ulimit -u`, or the pids.max of a control group)."""

from __future__ import annotations

import threading

NO_THREAD = "can't start new thread"
"""What Python says when the system allows no more threads."""


def is_lack_of_threads(error: BaseException) -> bool:
    """Return whether an exception says that the system allows no more threads."""
    return isinstance(error, RuntimeError) and str(error).startswith(NO_THREAD)


def start_if_possible(thread: threading.Thread) -> bool:
    """Start a thread that can be done without; return False if the system allows no more."""
    try:
        thread.start()
    except RuntimeError as error:
        if not is_lack_of_threads(error):
            raise
        return False
    return True
