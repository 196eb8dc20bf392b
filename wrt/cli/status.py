"""Exit statuses, and one-line messages on standard error."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import NoReturn

from wrt.errors import InputError, one_line
from wrt.process import end, end_soon

FAILED = 1
UNUSABLE = 2
INTERRUPTED = 130


def complain(kind: str, what: object) -> None:
    """Print one line to standard error: an error, a note, or why a command ended early."""
    print(f"wrt: {kind}: {one_line(str(what))}", file=sys.stderr, flush=True)


def warn(line: str) -> None:
    """Print a line to standard error."""
    print(line, file=sys.stderr, flush=True)


def give_up(status: int, what: str) -> NoReturn:
    """Print `what` and end the process, from another thread while the main one is too busy to handle a signal."""
    end_soon(status)  # first: standard error may be a pipe that nobody reads
    complain("stopped", what)
    end(status)


def outcome(run: Callable[[], int], *, name: str = "") -> int:
    """Return the exit status of `run`; report an exception that it raises and return the status for that.

    Args:
        run: the work to do.
        name: the input it is about, for the message if there are several; otherwise empty.
    """
    try:
        return run()
    except InputError as error:
        _complain_of(name, str(error))
        return UNUSABLE
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        _complain_of(name, f"{where}{error.strerror or error}")
        return FAILED
    except MemoryError as error:
        _complain_of(name, f"not enough memory{f': {error}' if str(error) else ''}")
        return FAILED
    except RuntimeError as error:
        if not str(error).startswith("Failed to allocate"):  # Warp's words for a MemoryError
            raise
        _complain_of(name, f"not enough memory: {error}")
        return FAILED


def _complain_of(name: str, what: str) -> None:
    complain("error", what if one_line(name) in one_line(what) else f"{name}: {what}")
