"""Standard output and standard error that never raise, even if they are closed, full or ASCII only."""

from __future__ import annotations

import errno
import io
import os
import sys
from typing import TextIO, cast

from wrt.cli.exit_status import FAILED, complain


class Stream(io.TextIOWrapper):
    """A text stream that escapes characters its encoding lacks, and keeps its first error instead of raising it.

    Attributes:
        error: the first error in writing, or None.
    """

    error: OSError | None = None

    def write(self, text: str) -> int:
        """Write text; do nothing after an error."""
        if self.error is None:
            try:
                super().write(text)
            except OSError as error:
                self.error = error
        return len(text)

    def flush(self) -> None:
        """Flush the buffer; do nothing after an error."""
        if self.error is None:
            try:
                super().flush()
            except OSError as error:
                self.error = error


class Streams:
    """The standard streams of a command."""

    def __init__(self, out: Stream) -> None:
        """Keep standard output, to check it at the end; errors of standard error cannot be reported."""
        self._out = out

    def status(self, status: int) -> int:
        """Return the final exit status: `FAILED` if `status` is 0 but standard output could not be written."""
        self._out.flush()
        error = self._out.error
        if error is None:
            return status
        if error.errno != errno.EPIPE:  # a reader that closes its pipe is not an error
            complain("error", f"standard output: {error.strerror or error}")
        return status or FAILED


def settle_streams() -> Streams:
    """Replace the standard streams of this process; call it only if the process belongs to the command line."""
    _open_closed()
    out = sys.stdout = _stream(sys.stdout, 1)
    sys.stderr = _stream(sys.stderr, 2)
    return Streams(out)


def _open_closed() -> None:
    """Open closed file descriptors 0 to 2, so that no picture is opened as standard error."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            # `open` returns the lowest free descriptor. Read-only, since writing to a closed stream should fail.
            os.open(os.devnull, os.O_RDONLY)


def _stream(stream: TextIO | None, number: int) -> Stream:
    """Return a Stream for a file descriptor with the settings of `stream`, which is None if it was closed."""
    if stream is None:
        return Stream(open(number, "wb", closefd=False), "utf-8", "backslashreplace")
    text = cast("io.TextIOWrapper", stream)
    terminal = text.line_buffering or number == 2
    return Stream(text.buffer, text.encoding, "backslashreplace", line_buffering=terminal)
