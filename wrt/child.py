"""Python processes that wrt starts."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator
from pathlib import Path


def command(code: str, *arguments: str) -> list[str]:
    """Return the command that runs Python code in another process, which imports nothing from the current folder.

    `python -c` and `-m` put the current folder first on the path of modules, where an uploaded file may lie.

    Args:
        code: what to run, on one line; its arguments are in `sys.argv[1:]`.
        arguments: its arguments.

    Raises:
        OSError: if the path of the interpreter is not known.
    """
    if not sys.executable:
        raise OSError("the path of the Python interpreter is not known")
    package = str(Path(__file__).resolve().parents[1])
    isolated = f"import sys; sys.path[:] = [{package!r}, *filter(None, sys.path[1:])]; {code}"
    return [sys.executable, "-c", isolated, *arguments]


@contextlib.contextmanager
def safe_path() -> Iterator[None]:
    """Within the context, have processes that `multiprocessing` starts import nothing from the current folder.

    Python 3.10 has no such setting.
    """
    before = os.environ.get("PYTHONSAFEPATH")
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ["PYTHONSAFEPATH"]
        else:
            os.environ["PYTHONSAFEPATH"] = before
