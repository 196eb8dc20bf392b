"""Registries of models by name: built-in ones, and those registered from outside the package.

A model is a NamedTuple of device functions. Kernels dispatch by number among the models that a scene uses, through a
chain of functions, one for each model, in which each calls the next. A static loop over the models would not do: Warp's
hash of a function leaves out a `wp.static` that depends on a loop variable, so kernels of different scenes would be
confused.
"""

import functools
import importlib
import zlib
from collections.abc import Callable, Mapping
from typing import Any, Generic, NamedTuple, TypeVar

M = TypeVar("M")

USER_MODELS: set[str] = set()
"""Names of all models that were registered from outside; other processes may register others under the same names."""


class _Registered(NamedTuple):
    """A model from outside: its owner, and all its versions, the current one last."""

    owner: str
    revisions: list[Any]


class Registry(Generic[M]):
    """The models of one kind.

    Attributes:
        families: for each family, the function that makes a model from the parts of its name.
    """

    def __init__(self, files: Mapping[str, str], check: Callable[[str, M], None]) -> None:
        """Take the module of each built-in model, and `check`, which raises ValueError for an invalid model.

        The module has the model by its name in capitals, or a function `make_NAME` of the parts of its name.
        """
        self.families: dict[str, Callable[..., M]] = {
            name: functools.partial(_model_in, module, name) for name, module in files.items()
        }
        self._built_in = frozenset(self.families)
        self._check = check
        self._registered: dict[str, _Registered] = {}
        self._models: dict[str, M] = {}

    def register(self, name: str, model: M, owner: str = "") -> None:
        """Register a model for use in scenes. It replaces the model that its owner registered under the same name.

        Args:
            name: letters, digits and underscores.
            model: its device functions.
            owner: only the same owner can replace the model.

        Raises:
            ValueError: if another owner has the name, the name is not an identifier, or the model is invalid.
        """
        if not name.isidentifier():
            raise ValueError(f"a model's name must be an identifier, not {name!r}")
        entry = self._registered.get(name, _Registered(owner, []))
        if name in self._built_in or entry.owner != owner:
            raise ValueError(f"there is a model {name!r} already")
        self._check(name, model)
        if entry.revisions[-1:] != [model]:
            entry.revisions.append(model)
        self._registered[name] = entry
        USER_MODELS.add(name)
        self.families[name] = lambda revision="revision0": entry.revisions[int(revision.removeprefix("revision"))]

    def forget(self, name: str) -> None:
        """Undo all registrations of a name."""
        self._registered.pop(name, None)
        del self.families[name]
        self._models = {key: model for key, model in self._models.items() if key.split(":")[0] != name}

    def current_name(self, name: str) -> str:
        """Return the name that kernels use for the current version of a model.

        A model that is registered again gets a new one, so that neither dispatch nor compiled kernels, which are cached
        by name, keep the old functions.
        """
        revision = len(self._registered[name].revisions) - 1 if name in self._registered else 0
        return f"{name}:revision{revision}" if revision else name

    def model_of(self, name: str) -> M:
        """Return the model with a name such as "diffuse" or "rough_conductor:ggx:smith"."""
        if name not in self._models:
            family, *parts = name.split(":")
            self._models[name] = self.families[family](*parts)
        return self._models[name]


def _model_in(module: str, name: str, *parts: str) -> Any:
    """Import a model's module when a scene first uses it: importing all takes a tenth of the start-up time."""
    found = importlib.import_module(module)
    make = getattr(found, f"make_{name}", None)
    return getattr(found, name.upper()) if make is None else make(*parts)


def model_number(name: str) -> int:
    """Return the number of a model in all kernels: 30 bits that depend on its name alone.

    So kernels for different sets of models can render the same uploaded scene.
    """
    return zlib.crc32(name.encode()) & 0x3FFFFFFF
