"""How a command ends: its exit status, and one line about what went wrong."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import NoReturn

from wrt.errors import InputError, one_line
from wrt.process import end_now

FAILED = 1
UNUSABLE = 2
INTERRUPTED = 130


def complain(kind: str, what: object) -> None:
    """Say in one line on standard error what went wrong, or why it ended early."""
    print(f"wrt: {kind}: {one_line(str(what))}", file=sys.stderr, flush=True)


def warn(line: str) -> None:
    """Show a line on standard error."""
    print(line, file=sys.stderr, flush=True)


def give_up(status: int, what: str) -> NoReturn:
    """End the process from another thread than the main one, which does not come to a signal; say what of it."""
    complain("stopped", what)
    end_now(status)


def outcome(run: Callable[[], int], *, name: str = "") -> int:
    """Return the exit status that `run` returns, or that of what it raises, which is said.

    Args:
        run: what to do.
        name: what it is about, where a line may have to tell one thing from others.
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
