"""Fits text into a line of a terminal, the most important parts first."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Sequence
from typing import TextIO

USUAL_COLUMNS = 80
"""Assumed width of terminals that do not report one."""

LEAST_BAR = 10
"""Smallest useful width of a bar, in columns."""

LABEL_SHARE = 3
"""If not everything fits, a label takes at most 1/LABEL_SHARE of the line."""


def bar_stream() -> TextIO | None:
    """Return the stream that shows a bar: standard error on a terminal, standard output in a notebook; else None.

    Notebooks put a red background behind standard error, which would stay when the bar has gone.
    """
    if sys.stderr is not None and sys.stderr.isatty():
        return sys.stderr
    return sys.stdout if type(sys.stdout).__module__.startswith("ipykernel.") else None


def terminal_columns() -> int:
    """Return the usable columns of the terminal at standard error; the last one stays free for the cursor."""
    columns = 0
    with contextlib.suppress(OSError, ValueError):  # no terminal, closed, or not a file
        columns = os.get_terminal_size(sys.stderr.fileno()).columns
    if columns <= 0:
        variable = os.environ.get("COLUMNS", "")
        columns = int(variable) if variable.isdecimal() and 0 < int(variable) < 10_000 else USUAL_COLUMNS
    return max(columns - 1, 1)


def columns_of(text: str) -> int:
    """Return the width of text in columns: wide East Asian characters take two."""
    from tqdm.utils import disp_len

    return int(disp_len(text))


def shortened(text: str, columns: int) -> str:
    """Return text cut to a number of columns, with dots for its middle if it is longer."""
    from tqdm.utils import disp_trim

    if columns_of(text) <= columns:
        return text
    dots = "..."[: max(columns, 0)]
    room = columns - len(dots)
    end = str(disp_trim(text[::-1], room // 2))[::-1] if room > 1 else ""
    return f"{disp_trim(text, room - columns_of(end))}{dots}{end}"


Piece = tuple[int, str]
"""A part of a status: its rank, 1 for the most important, and its text."""


def fitted(label: str, pieces: Sequence[Piece], columns: int) -> str:
    """Return label and pieces in one line of `columns`: the label is shortened, then the highest ranks are left out."""
    label = printable(label)
    fitting = _fitting(label, pieces, columns)
    if pieces and not fitting and columns_of(first := min(pieces)[1]) <= columns:
        return first
    status = "".join(f"  {text}" for _, text in fitting)
    return shortened(label, columns - columns_of(status)) + status


def fitted_bar(label: str, share: str, pieces: Sequence[Piece], columns: int) -> str:
    """Return the tqdm format of a line with a bar, or without one if it does not fit.

    Args:
        label: start of the line.
        share: finished part of the work as text, such as " 25%".
        pieces: parts of the status; those up to rank 3 are more important than the bar.
        columns: width of the line.
    """
    room = columns - len(f" {share}||  ") - LEAST_BAR
    name = printable(label)
    fitting = _fitting(name, pieces, room)
    if [piece for piece in pieces if piece[0] <= 3 and piece not in fitting] or _width(name, room, fitting) > room:
        return literal(fitted(label, [(0, share), *pieces], columns))
    status = "  ".join(text for _, text in fitting)
    return f"{literal(f'{shortened(name, room - columns_of(status))} {share}')}|{{bar}}| {literal(status)}"


def _fitting(label: str, pieces: Sequence[Piece], columns: int) -> list[Piece]:
    """Leave out pieces, those of the highest rank first, until the others fit beside a shortened label."""
    fitting = [*pieces]
    while fitting and _width(label, columns, fitting) > columns:
        fitting.remove(max(fitting))
    return fitting


def _width(label: str, columns: int, pieces: Sequence[Piece]) -> int:
    """Return the columns that a label and pieces need if the label is shortened as far as possible."""
    return min(columns_of(label), max(columns // LABEL_SHARE, 1)) + sum(2 + columns_of(text) for _, text in pieces)


def printable(text: str) -> str:
    """Return text as standard error shows it, with characters that its encoding lacks escaped."""
    encoding = getattr(sys.stderr, "encoding", None) or "utf-8"
    return text.encode(encoding, "backslashreplace").decode(encoding)


def literal(text: str) -> str:
    """Escape text for use in a format string."""
    return text.replace("{", "{{").replace("}", "}}")
