"""Standard output and standard error that may be closed, full, or of few characters: set up once, for all commands."""

from __future__ import annotations

import errno
import io
import os
import sys
from typing import TextIO, cast

from wrt.cli.status import FAILED, complain


class Stream(io.TextIOWrapper):
    """A stream that shows any text, by escapes where it must, and keeps its first error instead of raising it.

    Attributes:
        error: what kept it from writing, if anything did.
    """

    error: OSError | None = None

    def write(self, text: str) -> int:
        """Write text, or nothing once that has failed."""
        if self.error is None:
            try:
                super().write(text)
            except OSError as error:
                self.error = error
        return len(text)

    def flush(self) -> None:
        """Hand on what was written, unless that has failed."""
        if self.error is None:
            try:
                super().flush()
            except OSError as error:
                self.error = error


class Streams:
    """The two that a command writes to."""

    def __init__(self, out: Stream) -> None:
        """Take standard output; what standard error loses, nobody can be told."""
        self._out = out

    def status(self, status: int) -> int:
        """Return a command's exit status at its end, `FAILED` if all else went well but standard output is lost."""
        self._out.flush()
        error = self._out.error
        if error is None:
            return status
        if error.errno != errno.EPIPE:  # else whoever reads it has seen enough
            complain("error", f"standard output: {error.strerror or error}")
        return status or FAILED


def settle_streams() -> Streams:
    """Take the place of the standard streams of this process, which must be its own."""
    _open_closed()
    out = sys.stdout = _stream(sys.stdout, 1)
    sys.stderr = _stream(sys.stderr, 2)
    return Streams(out)


def _open_closed() -> None:
    """Open those of the first three files that are closed: else a picture could become standard error."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            # It gets the lowest number that is free; for reading alone, since writing to what was closed should fail.
            os.open(os.devnull, os.O_RDONLY)


def _stream(given: TextIO | None, number: int) -> Stream:
    """Return the stream that writes to a file as `given` does, which is None where the file was closed."""
    if given is None:
        return Stream(open(number, "wb", closefd=False), "utf-8", "backslashreplace")
    text = cast("io.TextIOWrapper", given)
    terminal = text.line_buffering or number == 2
    return Stream(text.buffer, text.encoding, "backslashreplace", line_buffering=terminal)
