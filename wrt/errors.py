"""Errors and warnings about input, and spelling hints."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_PART = 4
"""A name that contains a word of at least this many characters is similar to it."""

LONGEST_MESSAGE = 600
"""Maximum characters of a message; longer ones lose their middle, which repeats input."""

OF_TRIMESH = "trimesh"
"""Name in messages of sources without a path, which are objects of that library."""


_SHOWN: ContextVar[tuple[tuple[str, str], ...]] = ContextVar("shown", default=())
_IS_MUTED: ContextVar[bool] = ContextVar("is_muted", default=False)


@contextmanager
def shown_as(path: object, name: object) -> Iterator[None]:
    """Within the context, have messages call a path, such as a temporary folder, by another name."""
    token = _SHOWN.set((*_SHOWN.get(), (str(path), str(name))))
    try:
        yield
    finally:
        _SHOWN.reset(token)


def one_line(text: str) -> str:
    """Return text as one line, shortened, with control characters escaped: it may quote untrusted input."""
    for path, name in _SHOWN.get():
        text = text.replace(path, name)
    words = text if text.isprintable() else "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)
    half = LONGEST_MESSAGE // 2
    return words if len(words) <= LONGEST_MESSAGE else f"{words[: half - 5]} ... {words[-half:]}"


def is_utf8(path: object) -> bool:
    """Return whether a path is UTF-8, which libraries need; Python stands in surrogates for other bytes."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return False
    return True


class InputError(ValueError):
    """A file, value or scene cannot be used; the message is one line with its name and the reason."""

    def __init__(self, message: object = "") -> None:
        super().__init__(one_line(str(message)))


class NotEnoughMemory(InputError):
    """A device lacks the memory for a scene or a picture; the message gives both figures in one line."""


class InputWarning(UserWarning):
    """Part of the input was left out or will look wrong; the message is one line that names it.

    `warnings.simplefilter("error", wrt.InputWarning)` makes these errors, and "ignore" hides them.
    """


class Hint(InputWarning):
    """A setting would show more of the scene; the message is one line that names it."""


@contextmanager
def muted() -> Iterator[None]:
    """Within the context, have `warn` do nothing in this thread; the filters of `warnings` are those of all threads."""
    token = _IS_MUTED.set(True)
    try:
        yield
    finally:
        _IS_MUTED.reset(token)


def warn(message: str, category: type[Warning] = InputWarning) -> None:
    """Warn, in one line, as if the line of the caller's program that called wrt did so."""
    if _IS_MUTED.get():
        return
    frame, level = sys._getframe(1), 2
    within = ("wrt", "contextlib")  # the second calls functions of wrt for a decorator that is a context
    while frame.f_back is not None and str(frame.f_globals.get("__name__")).partition(".")[0] in within:
        frame, level = frame.f_back, level + 1
    warnings.warn(one_line(message), category, stacklevel=level)


def name_of(source: object) -> str:
    """Return the name of a source in messages: its path if it has one."""
    return str(source) if isinstance(source, (str, os.PathLike)) else OF_TRIMESH


def did_you_mean(word: object, words: Iterable[str], *, likeness: float = 0.6) -> str:
    """Return a hint at the most similar valid word, for the end of a message, or "" if there is no similar word.

    Args:
        word: what was typed.
        words: the valid words.
        likeness: smallest similarity of two words for a hint, 0 to 1.
    """
    import difflib

    word, names = str(word), list(words)
    near = [name for name in names if name.casefold() == word.casefold()]
    near += difflib.get_close_matches(word, names, 1, likeness)
    if len(word) >= _PART:
        near += sorted((name for name in names if word in name), key=len)
    return f" (did you mean {near[0]!r}?)" if near else ""
