"""Integrators by name, and the description of user-defined ones; docs/integrators.md describes the built-in ones."""

from __future__ import annotations

import dataclasses
import typing
from collections.abc import Mapping
from functools import partial
from typing import Any

from wrt.errors import InputError
from wrt.scene.description import Check, Kind
from wrt.values import FLOAT32_MAX, boolean, color, integer, number, one_of

_MOST = 2**31 - 1
_CHECKS: dict[str, Check] = {
    "bool": boolean,
    "int": partial(integer, minimum=-_MOST, maximum=_MOST),
    "float": partial(number, minimum=-FLOAT32_MAX, maximum=FLOAT32_MAX),
    "color": color,
}
"""The kinds of numbers that kernels read, and the checks that each passes besides its own."""


@dataclasses.dataclass(frozen=True)
class Integrator(Kind):
    """Base of integrators of your own, whose numbers are the fields: bools, ints, floats and colours with defaults."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, kind in kinds_of(type(self)).items():
            self._set(**{name: _CHECKS[kind](getattr(self, name), name)})

    @staticmethod
    def make_trace(tools: Any) -> Any:
        """Return the function (scene, ray, footprint, sampler, settings, Numbers) -> PathResult of a camera ray."""
        raise NotImplementedError


INTEGRATORS: dict[str, type[Integrator] | None] = dict.fromkeys(("path", "volpath", "direct", "whitted", "ao", "aov"))
"""Integrators by name; the built-in ones have no class."""


def kinds_of(cls: type[Integrator]) -> dict[str, str]:
    """Return the fields of a user-defined integrator, and the kind of each: "bool", "int", "float" or "color".

    Raises:
        InputError: if a field has no default, or is of another kind.
    """
    hints, kinds = typing.get_type_hints(cls), {}
    for field in dataclasses.fields(cls):
        hint = hints[field.name]
        kinds[field.name] = hint.__name__ if hint in (bool, int, float) else "color"
        try:
            _CHECKS[kinds[field.name]](field.default, field.name)
        except InputError:
            what = "a bool, an int, a float or a colour, with a default of that kind"
            raise InputError(f"{cls.__name__}: field {field.name!r} must be {what}") from None
    return kinds


def integrator_of(value: Any, name: str, *, words: Mapping[str, Any]) -> str | Integrator:
    """Return an integrator, or the name of a built-in one, for any of these.

    Args:
        value: the name or the integrator.
        name: for messages.
        words: all integrators by name.

    Raises:
        InputError: if there is none, or it is not registered.
    """
    if isinstance(value, Integrator):
        if words.get(value.type_name) is not type(value):
            raise InputError(f"{name}: {type(value).__name__} must be registered by wrt.register_integrator first")
        return value
    if isinstance(value, str) and value not in words:
        try:
            one_of(value, tuple(words), name)
        except InputError as error:
            raise InputError(f"{error}; --with FILE or wrt.load_models adds those of a file") from None
    cls = words[one_of(value, tuple(words), name)]
    return str(value) if cls is None else cls()


def integrator_name(value: str | Integrator | None) -> str | None:
    """Return the name of an integrator as settings have it."""
    return value.type_name if isinstance(value, Integrator) else value
