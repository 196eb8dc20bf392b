"""What wrt raises when it is given something it cannot use, and the hint that may end its message."""

from __future__ import annotations

from collections.abc import Iterable

LONGEST_MESSAGE = 600
"""Characters of a message; of a longer one, which repeats what was typed, the middle is left out."""


def one_line(text: str) -> str:
    """Return text that fits one line of a terminal and does nothing to it: names and values in it are anybody's."""
    words = text if text.isprintable() else "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)
    half = LONGEST_MESSAGE // 2
    return words if len(words) <= LONGEST_MESSAGE else f"{words[: half - 5]} ... {words[-half:]}"


class InputError(ValueError):
    """A file, a value or a scene cannot be used; the message is one line that says which and why."""

    def __init__(self, message: object = "") -> None:
        super().__init__(one_line(str(message)))


def did_you_mean(word: object, known: Iterable[str], *, likeness: float = 0.6) -> str:
    """Return a hint at the most similar known word, to append to a message; empty if none is similar.

    Args:
        word: what was typed.
        known: the valid words.
        likeness: smallest similarity of two words that makes a hint, 0 to 1.
    """
    import difflib

    near = difflib.get_close_matches(str(word), list(known), 1, likeness)
    return f" (did you mean {near[0]!r}?)" if near else ""
