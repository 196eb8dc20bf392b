"""The command line: ``wrt render`` and the commands around it.

Exit status: 0 on success; 1 if a file or standard output could not be written, memory ran out, or a render failed; 2 if
an input or an option cannot be used; 130 and 143 after Ctrl-C and SIGTERM. Every error is one line on standard error.
Heavy modules are imported only when needed.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from wrt.cli.arguments.options import make_parser, parse
from wrt.cli.exit_status import EXPECTED, INTERRUPTED, complain, failure
from wrt.cli.process import settle_in
from wrt.cli.streams import final_status, settle_streams

if TYPE_CHECKING:
    from wrt.cli.signals import Interrupts


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status.

    Args:
        argv: the arguments; by default those of the process, whose standard streams are then made never to raise.
    """
    if argv is not None:
        return _status(list(argv), own_process=False)
    if "_ARGCOMPLETE" in os.environ:
        from wrt.cli.arguments.completion import complete

        complete(make_parser())
    out = settle_streams()
    return final_status(out, _status(sys.argv[1:], own_process=True))


def _status(arguments: list[str], *, own_process: bool) -> int:
    try:
        return _run(arguments, own_process=own_process)
    except KeyboardInterrupt:
        complain("stopped", "before it was done")
        return INTERRUPTED
    except EXPECTED as error:
        return failure(error)


def _run(arguments: list[str], *, own_process: bool) -> int:
    try:
        options = vars(parse(arguments))
    except SystemExit as end:  # of --help and --version
        return int(end.code or 0)
    if own_process:
        settle_in()
    from wrt.cli.signals import Interrupts  # not at the top: --help must import little

    interrupts = Interrupts("before it was done", own_process=own_process)
    with interrupts:
        try:
            status = _run_command(interrupts, **options)
        except KeyboardInterrupt:
            status = interrupts.stopped()
        except Exception:
            if not interrupts.is_signalled:
                raise
            status = interrupts.stopped()  # a library made another error of it, as NumPy does while it is imported
    if "wrt.backend" in sys.modules:
        from wrt.backend import current_backend

        current_backend().finish()
    return status


def _run_command(interrupts: Interrupts, *, command: str, **options: Any) -> int:
    """Run a command, or report its error; return the exit status."""
    function: Any
    try:
        _load_models(options.pop("models", None) or (), options)
        if command == "render":
            from wrt.cli.render import render as function
        elif command == "merge":
            from wrt.cli.parts import merge as function
        elif command == "view":
            from wrt.cli.view import view as function
        else:
            from wrt.cli import commands

            function = getattr(commands, command)
        status: int = function(interrupts, **options)
    except EXPECTED as error:
        return failure(error)
    return status


def _load_models(files: Sequence[str], options: dict[str, Any]) -> None:
    """Run the files of --with.

    Raises:
        InputError: if one cannot be used, or if other options forbid it.
    """
    if not files:
        return
    from wrt.cli.process import allow_imports
    from wrt.errors import InputError
    from wrt.model_files import load_models

    if options.get("confined"):
        raise InputError("--with runs a program, which --confined forbids; leave out one of them")
    if options.get("dask") is not None or options.get("device", "").startswith(("cuda:all", "cuda:0,")):
        raise InputError("--with: other processes do not have the models; render on one device, without --dask")
    allow_imports()
    for file in files:
        load_models(file)
