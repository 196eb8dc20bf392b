"""Exit statuses, and one-line messages on standard error."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import NoReturn

from wrt.cli.process import end, end_soon
from wrt.errors import InputError, NotEnoughMemory, one_line

FAILED = 1
UNUSABLE = 2
INTERRUPTED = 130


def complain(kind: str, what: object) -> None:
    """Print one line of a kind, such as "error", to standard error."""
    print(f"wrt: {kind}: {one_line(str(what))}", file=sys.stderr, flush=True)


def warn(line: str) -> None:
    """Print a line to standard error."""
    print(line, file=sys.stderr, flush=True)


def give_up(status: int, what: str) -> NoReturn:
    """Print `what` and end the process, from another thread, when the main one is too busy to handle a signal."""
    end_soon(status)  # first, since standard error may be a pipe that nobody reads
    complain("stopped", what)
    end(status)


def outcome(run: Callable[[], int], *, name: str = "") -> int:
    """Return the exit status of `run`; if it raises, report the error and return its status.

    Args:
        run: the work to do.
        name: the input, for messages if there are several; otherwise empty.
    """
    try:
        return run()
    except InputError as error:
        _complain_of(name, str(error))
        return FAILED if isinstance(error, NotEnoughMemory) else UNUSABLE
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        _complain_of(name, f"{where}{error.strerror or error}")
        return FAILED
    except MemoryError as error:
        _complain_of(name, f"not enough memory{f': {error}' if str(error) else ''}")
        return FAILED
    except RuntimeError as error:
        # Warp's messages when memory, or address space for its libraries, runs out
        if not str(error).startswith(("Failed to allocate", "Failed to load the shared library")):
            raise
        _complain_of(name, f"not enough memory: {error}")
        return FAILED


def _complain_of(name: str, what: str) -> None:
    complain("error", what if one_line(name) in one_line(what) else f"{name}: {what}")
