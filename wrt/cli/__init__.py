"""The command line: ``wrt render`` and the commands around it.

Exit status: 0 on success; 1 when a file or standard output could not be written or memory ran out; 2 when an input or
an option cannot be used; 130 and 143 after Ctrl-C and SIGTERM. Every error is one line on standard error. Heavy modules
are imported only when they are needed.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

from wrt.cli.options import make_parser, parse
from wrt.cli.status import INTERRUPTED, complain, outcome
from wrt.cli.streams import settle_streams
from wrt.process import settle_in


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status.

    Args:
        argv: the arguments; by default those of the process, whose standard streams then never raise.
    """
    if argv is not None:
        return _status(list(argv), own_process=False)
    if "_ARGCOMPLETE" in os.environ:
        from wrt.cli.completion import complete

        complete(make_parser())
    streams = settle_streams()
    return streams.status(_status(sys.argv[1:], own_process=True))


def _status(arguments: list[str], *, own_process: bool) -> int:
    try:
        return outcome(lambda: _run(arguments, own_process=own_process))
    except KeyboardInterrupt:
        complain("stopped", "before it was done")
        return INTERRUPTED


def _run(arguments: list[str], *, own_process: bool) -> int:
    try:
        options = parse(arguments)
    except SystemExit as end:  # of --help and --version
        return int(end.code or 0)
    options.own_process = own_process
    if own_process:
        settle_in()
    status: int = options.run(options)
    return status
