"""Descriptions of classes, functions and their parameters, from their docstrings."""

from __future__ import annotations

import inspect
import re
import textwrap
from collections.abc import Callable
from typing import Any


def summary_of(thing: Callable[..., Any] | None) -> str:
    """Return the first paragraph of the docstring of a class or function, in one line."""
    return "" if thing is None else plain((inspect.getdoc(thing) or "").partition("\n\n")[0])


def meanings_of(thing: Callable[..., Any]) -> dict[str, str]:
    """Return the descriptions of a class's attributes, with those of its bases, or of a function's arguments."""
    if not inspect.isclass(thing):
        return _entries(thing.__doc__, "Args")
    meanings: dict[str, str] = {}
    for base in reversed(thing.__mro__):
        meanings |= _entries(base.__doc__, "Attributes")
    return meanings


def plain(text: str) -> str:
    """Return text in one line, without backquotes."""
    return " ".join(text.replace("`", "").split())


def _entries(docstring: str | None, section: str) -> dict[str, str]:
    """Return the entries of a docstring's section by name."""
    text = inspect.cleandoc(docstring or "").partition(f"\n{section}:\n")[2]
    text = re.split(r"\n\n(?=\S)", text)[0]  # the next section
    found: dict[str, str] = {}
    # An entry is "name: text" or "name, name: text" at the section's indent; deeper lines continue it.
    for entry in re.split(r"\n(?=\S)", textwrap.dedent(text)):
        names, colon, meaning = entry.partition(":")
        if colon:
            found |= {name.strip(): plain(meaning) for name in names.split(",")}
    return found
