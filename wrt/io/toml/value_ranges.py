"""The ranges of parameters of a class or a function, found by calling it.

Its checks are the only place that states the ranges: it is called with invalid values, and its messages are parsed.
"""

from __future__ import annotations

import inspect
import re
import typing
from collections.abc import Callable
from typing import Any

import numpy as np

from wrt.errors import InputError
from wrt.scene.materials.measured import Measured, Measurement

Schema = dict[str, Any]

FORMS = {"number": 0, "pair": 2, "triple": 3}
"""Forms of a number: a scalar (0), or an array of this length."""

_TRIED = (0.5, 1.0, 2.0, 5.0, 90.0, 1e-3, 0.0)
"""Every numeric parameter accepts at least one of these."""

_FAR = 1e300
"""Beyond every limit."""

_UNLIMITED = 1e30
"""Larger limits are those of float32, and not reported."""

_LIMITS = {
    "at least": "minimum",
    "at most": "maximum",
    "greater than": "exclusiveMinimum",
    "less than": "exclusiveMaximum",
}


class Limits:
    """The parameters of a class or a function that raises InputError for invalid values.

    Attributes:
        make: the class or function.
        hints: types of its arguments.
        required: arguments without a default.
        words: values of parameters that take one of several words.
    """

    def __init__(self, make: Callable[..., Any]) -> None:
        """Call `make`, which must be fast, to find words and limits that depend on each other."""
        self.make = make
        parameters = inspect.signature(make).parameters
        types, hints = typing.get_type_hints(make), typing.get_type_hints(make, include_extras=True)
        hints = {name: hint if _has_schema(hint) else types[name] for name, hint in hints.items()}
        self.hints: dict[str, Any] = {name: hints.get(name, Any) for name in parameters}
        self.required = [name for name, p in parameters.items() if p.default is inspect.Parameter.empty]
        self._given = self._arguments()
        self.words = {name: words for name in self.hints if (words := self._words(name))}
        base = self._given[-1]
        self._given += [{**base, name: word} for name in self.words for word in self.words[name]]
        # The limit of one argument may depend on another argument.
        ends = [(name, end) for name, hint in self.hints.items() if hint is float for end in self._ends(name)]
        self._given += [{**base, name: end} for name, end in ends]
        self.words = {name: self._words(name) for name in self.words}

    def known_names(self, name: str) -> list[str]:
        """Return the names that an argument accepts from a table of aliases."""
        for value in ("?", ["?"]):
            for arguments in self._given:
                if found := re.search(r"; there are:? (.+)$", self._complaint({**arguments, name: value}) or ""):
                    return found[1].split(", ")
        return []

    def forms(self, name: str) -> dict[str, Schema]:
        """Return the FORMS that an argument accepts, each with its limits."""
        found: dict[str, list[Schema]] = {}
        for arguments in self._given:
            for form, length in FORMS.items():
                accepted = [x for x in _TRIED if self._complaint_about(arguments, name, x, length) is None]
                if accepted:
                    # The first one, and 0 if it is among them.
                    numbers = accepted[:1] + [0.0] * (0.0 in accepted)
                    found.setdefault(form, []).append(self._limits(arguments, name, length, numbers))
        return {form: _widest(limits) for form, limits in found.items()}

    def of_items(self, name: str, length: int) -> Schema:
        """Return the limits of the items of an array of `length` numbers."""
        return self._limits(self._given[0], name, length, [])

    def _arguments(self) -> list[dict[str, Any]]:
        """Return the required arguments, and, if these do not suffice, with one more that `make` accepts."""
        required = {name: _example(self.hints[name], i) for i, name in enumerate(self.required)}
        for name in (None, *(name for name in self.hints if name not in self.required)):
            arguments = required if name is None else {**required, name: 0.5}
            if self._complaint(arguments) is None:
                return [required, arguments]
        return [required]

    def _words(self, name: str) -> list[str]:
        words: list[str] = []
        for arguments in self._given:
            text = self._complaint({**arguments, name: "?"}) or ""
            if found := re.search(rf"\b{name} must be one of (.+?)(?:, not '\?'| for )", text):
                words += [word for word in found[1].split(", ") if word not in words]
        return words

    def _ends(self, name: str) -> list[float]:
        return [value for limits in self.forms(name).values() for value in limits.values()]

    def _complaint_about(self, arguments: dict[str, Any], name: str, value: float, length: int) -> str | None:
        """Return the message about one argument, of one number or an array of `length`."""
        number = int(value) if "int" in re.findall(r"\w+", str(self.hints[name])) else value
        return self._complaint({**arguments, name: [number] * length if length else number})

    def _complaint(self, arguments: dict[str, Any]) -> str | None:
        """Return the message of the error that arguments cause; None if they are valid."""
        try:
            with np.errstate(all="ignore"):
                self.make(**arguments)
        except InputError as error:
            return str(error)
        except (TypeError, ValueError, OverflowError, AttributeError) as error:
            return type(error).__name__
        return None

    def _limits(self, arguments: dict[str, Any], name: str, length: int, accepted: list[float]) -> Schema:
        """Return the limits that messages about an argument state, corrected by numbers that are accepted."""
        limits: Schema = {}
        for far in (-_FAR, _FAR):
            text = self._complaint_about(arguments, name, far, length) or ""
            if found := re.search(rf"\b{name}(?:\[\d\])? must be (.+)", text):
                if between := re.match(r"between ([-\d]+) and ([-\d]+)", found[1]):
                    limits |= {"minimum": int(between[1]), "maximum": int(between[2])}
                for words, key in _LIMITS.items():
                    if value := re.match(rf"{words} ([-\d.e+]+?)[,.]?(?:\s|$)", found[1]):
                        limits[key] = float(value[1])
        if "minimum" in limits and accepted:
            limits["minimum"] = min(limits["minimum"], *accepted)
        if "exclusiveMinimum" in limits and min(accepted, default=np.inf) <= limits["exclusiveMinimum"]:
            del limits["exclusiveMinimum"]
        return {key: int(x) if x == int(x) else x for key, x in limits.items() if abs(x) < _UNLIMITED}


def _has_schema(hint: Any) -> bool:
    """Return whether a type is annotated by its JSON schema, not only by checks."""
    return any(isinstance(each, dict) for each in getattr(hint, "__metadata__", ()))


def _example(hint: Any, index: int) -> Any:
    """Return an example of a type; consecutive vectors are orthogonal."""
    if hint is Measurement:
        return Measured.example().measurement
    if typing.get_origin(hint) is tuple:
        return [1.0, 1.0 - 2.0 * (index % 2), 0.0]
    if "numpy" in str(hint):
        return [1.0] if "ArrayLike" in str(hint) or "_SupportsArray" in str(hint) else np.full((1, 1, 3), 0.5)
    return 0.5


def _widest(all_limits: list[Schema]) -> Schema:
    """Return the widest of several limits."""
    result: Schema = {}
    for key in sorted(set.intersection(*(set(limits) for limits in all_limits))):
        choose = min if key.lower().endswith("minimum") else max
        result[key] = choose(limits[key] for limits in all_limits)
    return result
