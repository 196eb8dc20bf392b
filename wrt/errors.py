"""What wrt raises when it is given something it cannot use, and the hint that may end its message."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class InputError(ValueError):
    """A file, a value or a scene cannot be used; the message is one line that says which and why."""


def did_you_mean(word: object, known: Iterable[str]) -> str:
    """Return a hint at the known word that is nearest, to put behind a message; empty if none is near."""
    near = difflib.get_close_matches(str(word), list(known), 1)
    return f" (did you mean {near[0]!r}?)" if near else ""
