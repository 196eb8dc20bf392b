"""Registries of models by name: built-in ones, and those registered from outside the package.

A model is a NamedTuple of device functions. Kernels dispatch by number among the models that a scene uses, through a
chain of functions, one for each model, in which each calls the next. A static loop over the models would not do: Warp's
hash of a function leaves out a `wp.static` that depends on a loop variable, so kernels of different scenes would be
confused.
"""

import functools
import importlib
import inspect
import re
import zlib
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Generic, NamedTuple, TypeVar

M = TypeVar("M")

USER_MODELS: set[str] = set()
"""Names of all models that were registered from outside; other processes may register others under the same names."""


class _Registered(NamedTuple):
    """A model from outside: its owner, its versions by the digests of their code, and the digest of the current one."""

    owner: str
    versions: dict[str, Any]
    current: str


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
        entry = self._registered.get(name, _Registered(owner, {}, ""))
        if name in self._built_in or entry.owner != owner:
            raise ValueError(f"there is a model {name!r} already")
        self._check(name, model)
        digest = _digest(model)
        entry.versions[digest] = model
        self._registered[name] = entry._replace(current=digest)
        USER_MODELS.add(name)
        self.families[name] = entry.versions.__getitem__

    def forget(self, name: str) -> None:
        """Undo all registrations of a name."""
        self._registered.pop(name, None)
        del self.families[name]
        self._models = {key: model for key, model in self._models.items() if key.split(":")[0] != name}

    def current_name(self, name: str) -> str:
        """Return the name that kernels use for the current version of a model.

        Of a model from outside it contains a digest of its code. So neither dispatch nor compiled kernels, which are
        cached by name, keep old functions, and other processes find the kernels.
        """
        return f"{name}:{self._registered[name].current}" if name in self._registered else name

    def model_of(self, name: str) -> M:
        """Return the model with a name such as "diffuse" or "rough_conductor:ggx:smith"."""
        if name not in self._models:
            family, *parts = name.split(":")
            self._models[name] = self.families[family](*parts)
        return self._models[name]


def names_user_model(text: str) -> bool:
    """Return whether text, such as the repr of Features, has the quoted name of a model from outside.

    Names with the digest of a version do not count: they mean the same in all processes.
    """
    return not USER_MODELS.isdisjoint(re.findall(r"'(\w+)'", text))


def from_outside(names: Iterable[str]) -> list[str]:
    """Return those of the `names` in Features that are of models from outside."""
    return [name for name in names if name.partition(":")[0] in USER_MODELS]


def _digest(model: Any) -> str:
    """Return a digest of a model: of the code of its functions and all that they call, and of its other values."""
    import hashlib
    import secrets

    from warp._src.codegen import Struct
    from warp._src.context import Function, ModuleHasher

    hasher = ModuleHasher([], {})
    values = [
        hasher.hash_function(value)
        if isinstance(value, Function)
        else value.hash
        if isinstance(value, Struct)
        else value
        for value in model
        if not inspect.isfunction(value)  # which makes device functions, as the model has one
    ]
    outside = [f for f in hasher.function_hashes if not f.func.__module__.startswith("wrt.")]
    if any(each.adj.has_unresolved_static_expressions for f in outside for each in f.user_overloads.values()):
        values.append(secrets.token_bytes())  # what a `wp.static` in a loop says is known only to Warp's compiler
    return hashlib.blake2b(repr(values).encode(), digest_size=8).hexdigest()


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
