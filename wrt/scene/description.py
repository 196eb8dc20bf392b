"""What cameras, lights, materials and the like share: fields with checks, a name in scene files, a kernel model.

The type of a field is `Annotated` by its check: `radius: Annotated[float, partial(number, above=0.0)] = 1.0`.
"""

from __future__ import annotations

import functools
import typing
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Annotated, Any, ClassVar, TypeAlias

from wrt.errors import InputError
from wrt.values import ColorLike, Vec3, boolean, color, number, one_of, vector

LONGEST_GROUP = 64
"""Characters of the longest name of a light group."""

Check: TypeAlias = Callable[[Any, str], Any]
"""Takes the value of a field and its name for messages; returns the value to keep, or raises InputError."""


def optional(check: Check) -> Check:
    """Return a check that also accepts None: a `partial`, whose keyword `check` is read by `wrt/io/toml/schema.py`."""
    return partial(_check_unless_none, check=check)


def _check_unless_none(value: Any, name: str, *, check: Check) -> Any:
    return None if value is None else check(value, name)


def word_of(words: Sequence[str]) -> Check:
    """Return a check that a value is one of `words`: a `partial`, whose keyword is read by `wrt/io/toml/schema.py`."""
    return partial(_check_word, words=words)


def _check_word(value: Any, name: str, *, words: Sequence[str]) -> str:
    return one_of(value, words, name)


def instance_of(cls: type, hint: str = "") -> Check:
    """Return a check that a value is an instance of a public class of wrt; `hint` ends the message."""

    def check(value: Any, name: str) -> Any:
        if not isinstance(value, cls):
            raise InputError(f"{name} must be a wrt.{cls.__name__}, not {type(value).__name__}{hint}")
        return value

    return check


def group_name(value: Any, name: str) -> str:
    """Return the name of a light group, or raise InputError: it becomes part of the names of a file's channels."""
    if not isinstance(value, str) or not 0 < len(value) <= LONGEST_GROUP or not value.isprintable():
        raise InputError(f"{name} must be a name of 1 to {LONGEST_GROUP} printable characters, not {value!r}")
    return value


Flag = Annotated[bool, boolean]
GroupName = Annotated[str | None, optional(group_name)]
Number = Annotated[float, number]
Positive = Annotated[float, partial(number, above=0.0)]
NotNegative = Annotated[float, partial(number, minimum=0.0)]
Vector = Annotated[Vec3, vector]
Color = Annotated[ColorLike, color]


@functools.cache
def checks_of(cls: type) -> dict[str, Check]:
    """Return the checks of the fields of a class, those of its bases first."""
    hints = typing.get_type_hints(cls, include_extras=True)
    annotated = ((name, each) for name, hint in hints.items() for each in getattr(hint, "__metadata__", ()))
    return {name: each for name, each in annotated if callable(each)}


class Description:
    """Base of dataclasses that check their fields when an object is made."""

    __slots__ = ()

    def __post_init__(self) -> None:
        for name, check in checks_of(type(self)).items():  # type: ignore[arg-type]  # classes are hashable, if not their objects
            object.__setattr__(self, name, check(getattr(self, name), self._label(name)))

    def _label(self, name: str) -> str:
        """Return the name of a field for messages."""
        return name

    def _set(self, **values: Any) -> None:
        """Replace fields during construction."""
        for name, value in values.items():
            object.__setattr__(self, name, value)


class Kind(Description):
    """Base of the descriptions that have a `type` in scene files and device functions in kernels."""

    type_name: ClassVar[str] = ""
    """The `type` in scene files."""

    @property
    def model(self) -> str:
        """Name of the model in kernels, by default the type's own."""
        return self.type_name.replace("-", "_")


def by_type_name(namespace: Mapping[str, Any], base: type[Any]) -> dict[str, type[Any]]:
    """Return the classes of a module that have a base and a `type` in scene files, by that type, in order."""
    classes: list[Any] = [cls for cls in namespace.values() if isinstance(cls, type) and issubclass(cls, base)]
    return {cls.type_name: cls for cls in classes if cls.type_name}
