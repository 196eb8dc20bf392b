"""Registration of custom cameras, lights and materials by their names in scene files."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from wrt.errors import InputError

_BUILT_IN = "wrt."
"""Prefix of the modules of built-in classes."""


def register_class(known: dict[str, Any], cls: Any, register_model: Callable[[str, str], None] | None) -> None:
    """Add a class to the `known` ones by its `type_name`.

    A class of the same name from the same module replaces the one registered before.

    Args:
        known: classes by name.
        cls: the class to add.
        register_model: registers its device functions, given the model's name and the class's origin; None if it has
            none of its own.

    Raises:
        InputError: if `type_name` is empty or taken by another class, or the model is invalid.
    """
    before = known.get(cls.type_name, cls)
    taken = before.__module__.startswith(_BUILT_IN) or _origin(before) != _origin(cls)
    if not cls.type_name or taken:
        raise InputError(f"{cls.__name__}: type_name {cls.type_name!r} is empty or taken")
    if register_model is not None:
        try:
            register_model(cls.type_name.replace("-", "_"), _origin(cls))
        except ValueError as error:
            raise InputError(f"{cls.__name__}: {error}") from None
    known[cls.type_name] = cls


def _origin(cls: type) -> str:
    """Return the qualified name of a class, which identifies it when it is registered again."""
    return f"{cls.__module__}.{cls.__qualname__}"
