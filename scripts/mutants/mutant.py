"""What a planted fault is."""

from __future__ import annotations

from typing import NamedTuple


class Mutant(NamedTuple):
    """One fault.

    Attributes:
        name: for the command line and the reports.
        subject: the row of docs/proofs.md that it belongs to.
        file: where the fault is, from the root of the repository.
        old: a text that occurs in the file.
        new: the text in its place.
        tests: arguments of pytest for the tests that should notice.
    """

    name: str
    subject: str
    file: str
    old: str
    new: str
    tests: str
