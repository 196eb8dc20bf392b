"""Exit statuses, and one-line messages on standard error."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

from wrt.cli.process import end, end_soon
from wrt.errors import InputError, NotEnoughMemory, one_line

FAILED = 1
UNUSABLE = 2
INTERRUPTED = 130

NO_THREAD = "can't start new thread"
"""Beginning of Python's error where the system allows no more threads."""

NO_MORE_THREADS = "the system allows no more threads or processes (ulimit -u, or the pids.max of a control group)"

LACKS_OF_MEMORY = ("Failed to allocate", "Failed to load the shared library")
"""Beginnings of Warp's errors where memory, or address space for libraries, is lacking."""


def complain(kind: str, what: object) -> None:
    """Print one line of a kind, such as "error", to standard error."""
    print(f"wrt: {kind}: {one_line(str(what))}", file=sys.stderr, flush=True)


def warn(line: str) -> None:
    """Print a line to standard error."""
    print(line, file=sys.stderr, flush=True)


def give_up(status: int, what: str) -> NoReturn:
    """Print `what` and end the process, from another thread, when the main one is too busy to handle a signal."""
    end_soon(status)  # first, since standard error may be a pipe without a reader
    complain("stopped", what)
    end(status)


class Failed(Exception):
    """Work failed after it had begun; the message is one line with the cause and the files that were saved."""


EXPECTED = (Failed, InputError, OSError, RuntimeError, MemoryError)
"""Classes of all errors with an `_expected_cause`."""


def failure(error: Exception, *, name: str = "") -> int:
    """Report one of EXPECTED errors, and return its exit status; raise it if it is a fault in wrt.

    Args:
        error: the error.
        name: the input, for messages if there are several; otherwise empty.
    """
    message = _expected_cause(error)
    if message is None:
        raise error
    complain("error", message if one_line(name) in one_line(message) else f"{name}: {message}")
    return UNUSABLE if isinstance(error, InputError) and not isinstance(error, NotEnoughMemory) else FAILED


def _expected_cause(error: BaseException) -> str | None:
    """Return the message about an exception that a person, the machine or the system may have caused, else None."""
    text, is_runtime = str(error), isinstance(error, RuntimeError)
    if isinstance(error, (Failed, InputError)):
        return text
    if isinstance(error, OSError):
        where = f"{error.filename}: " if error.filename else ""
        is_unmapped = "failed to map segment" in text  # of a library that was to be loaded
        return f"{where}{'not enough memory: ' if is_unmapped else ''}{error.strerror or error}"
    if is_runtime and text.startswith(NO_THREAD):
        return NO_MORE_THREADS
    if isinstance(error, MemoryError) or (is_runtime and text.startswith(LACKS_OF_MEMORY)):
        return f"not enough memory{f': {text}' if text else ''}"
    return None


def cause_of(error: BaseException) -> str:
    """Return the message about an exception; for an unexpected one with its type and the line that raised it."""
    import traceback

    if (message := _expected_cause(error)) is not None:
        return message
    kind = f"{type(error).__name__}{f': {error}' if str(error) else ''}"
    frames = traceback.extract_tb(error.__traceback__)
    return f"{kind} ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else kind


@contextlib.contextmanager
def failing_in_one_line() -> Iterator[None]:
    """Within the context, turn exceptions that `failure` would raise into Failed."""
    try:
        yield
    except Exception as error:
        if _expected_cause(error) is not None:
            raise
        raise Failed(cause_of(error)) from error
