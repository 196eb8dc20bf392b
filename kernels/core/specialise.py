"""Specialised device functions and kernels: one for each combination of the features that a factory reads.

A factory is a Python function that declares device functions or a kernel for some features of a scene, or for the parts
of a model's name. The decorator `specialised` alone determines which calls share a result, and how it is named:

    @specialised("textured", "instances")
    def make_something(features: Features) -> wp.Function:

All features that agree in `textured` and `instances` get the same function. The factory may read no other field, nor
call factories that do. Without fields, the arguments themselves are the key.

Functions inside a factory need no unique names: Warp numbers functions of the same name.
"""

import dataclasses
import functools
import re
from collections.abc import Callable
from typing import Any, Generic, ParamSpec, TypeVar, cast

from wrt.kernels.core.features import Features, identifier

P = ParamSpec("P")
R = TypeVar("R")

_FIELDS = frozenset(field.name for field in dataclasses.fields(Features))


class _Used:
    """Features that let a factory read its declared fields only."""

    def __init__(self, features: Features, fields: tuple[str, ...], reader: str) -> None:
        """Take the features, and the fields that the factory `reader` declares."""
        self._reader = reader
        self._values = {field: getattr(features, field) for field in fields}

    def __getattr__(self, name: str) -> Any:
        if not name.startswith("_"):
            if name in self._values:
                return self._values[name]
            derived = vars(Features).get(name)
            if isinstance(derived, property) and derived.fget is not None:
                return derived.fget(self)
        raise AttributeError(f"{self._reader} does not declare that it reads the feature {name!r}")


class Specialised(Generic[P, R]):
    """A factory that makes one result for each combination of features or arguments.

    Attributes:
        fields: the fields of Features that it reads; factories that call it must declare them too.
    """

    def __init__(self, factory: Callable[P, R], fields: tuple[str, ...]) -> None:
        """Take a factory, and the fields that it reads of its first argument, Features.

        Raises:
            ValueError: if Features lacks one of the fields.
        """
        if unknown := set(fields) - _FIELDS:
            raise ValueError(f"{factory.__name__}: no features {', '.join(sorted(unknown))}")
        functools.update_wrapper(self, factory)
        self._name = factory.__name__
        self._factory = factory
        self.fields = tuple(dict.fromkeys(fields))
        self._made: dict[tuple[Any, ...], R] = {}

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        """Return the cached result for these arguments, or make it."""
        key = (*self._read(args), *sorted(kwargs.items()))
        if key not in self._made:
            arguments = cast(Any, args)
            if self.fields:
                arguments = (_Used(arguments[0], self.fields, self._name), *arguments[1:])
            self._made[key] = self._factory(*arguments, **kwargs)
        return self._made[key]

    def module_name(self, *args: P.args, **kwargs: P.kwargs) -> str:
        """Return a unique name for the module of the kernel that the factory makes.

        Warp's own "unique" modules do not suffice: their hash leaves out some things that a kernel depends on.
        """
        kind = re.sub("^make_|_kernel$", "", self._name)
        return f"wrt.{kind}.{identifier((*self._read(args), *kwargs.values()))}"

    def _read(self, args: Any) -> tuple[Any, ...]:
        if not self.fields:
            return tuple(args)
        return (*(getattr(args[0], field) for field in self.fields), *args[1:])


def specialised(*fields: str) -> Callable[[Callable[P, R]], Specialised[P, R]]:
    """Decorate a factory of device functions or kernels, which reads these fields of Features."""
    return lambda factory: Specialised(factory, fields)
