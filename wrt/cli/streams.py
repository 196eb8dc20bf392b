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


def settle_streams() -> Stream:
    """Replace the standard streams of this process, which must belong to the command line; return standard output."""
    _open_closed()
    out = sys.stdout = _stream(sys.stdout, 1)
    sys.stderr = _stream(sys.stderr, 2)
    return out


def final_status(out: Stream, status: int) -> int:
    """Return the exit status of the process: `FAILED` if `status` is 0 but standard output could not be written.

    Errors of standard error cannot be reported.
    """
    out.flush()
    if out.error is None:
        return status
    if out.error.errno != errno.EPIPE:  # a reader that closes its pipe is not an error
        complain("error", f"standard output: {out.error.strerror or out.error}")
    return status or FAILED


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
