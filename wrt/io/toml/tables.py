"""Reading of tables: keys are checked, and errors name the file and the key."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, did_you_mean
from wrt.io.toml.scene_keys import TRANSFORM, TURN, Keys
from wrt.io.toml.values import Table, table_of, text_of
from wrt.linalg import product
from wrt.scene.motion import rotation_matrix
from wrt.values import number, vector


class _Placed(InputError):
    """An InputError that already names the file and the key."""


class TableReader:
    """Reads the tables of one file, and keeps track of the current key for messages.

    Attributes:
        path: the file.
        place: the keys that lead to the table being read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.place: list[str] = []

    @contextmanager
    def at(self, key: str) -> Iterator[None]:
        """Within the context, prefix errors with the file and the path of keys, once: at the innermost key."""
        self.place.append(key)
        try:
            yield
        except _Placed:
            raise
        except (InputError, OverflowError) as error:
            where = ".".join(part for part in self.place if part).replace(".[", "[")
            raise _Placed(": ".join(text for text in (str(self.path), where, str(error)) if text)) from None
        finally:
            self.place.pop()

    def each(self, tree: Table, key: str, use: Callable[[Table], object]) -> None:
        """Call `use` with each table of an array of tables."""
        with self.at(key):
            tables = tree.get(key, [])
            if not isinstance(tables, list):
                raise InputError(f"must be an array of tables; write [[{key}]]")
            for i, table in enumerate(tables):
                with self.at(f"[{i}]"):
                    use(table_of(table))

    def check_keys(self, table: Table, known: Iterable[str], required: Iterable[str] = ()) -> None:
        """Raise InputError where a table has keys that are not known, or lacks required ones."""
        known = list(known)
        for key in table:
            if key not in known:
                with self.at(key):
                    raise InputError(f"unknown key{did_you_mean(key, known)}")
        for key in required:
            if key not in table:
                raise InputError(f"the key {key!r} is missing")

    def check_table(self, table: Table, keys: Keys, others: Iterable[str] = ()) -> None:
        """Raise InputError where a table has keys that are neither among `keys` nor `others`, or lacks some."""
        self.check_keys(table, [*keys, *others], [name for name, key in keys.items() if key.required])

    def call(self, function: Callable[..., Any], table: Table, extra: Iterable[str] = ()) -> Any:
        """Call a function or class with the table's keys as arguments; `extra` keys are somebody else's."""
        extra = list(extra)
        parameters = inspect.signature(function).parameters
        required = [name for name, p in parameters.items() if p.default is inspect.Parameter.empty]
        self.check_keys(table, [*parameters, *extra], required)
        return function(**{key: value for key, value in table.items() if key not in extra})

    def build(self, cls: type[Any], table: Table) -> Any:
        """Make an object of a class from a table, whose `type` may only have named the class."""
        return self.call(cls, table, extra=["type"] if "type" not in inspect.signature(cls).parameters else [])

    def beside(self, name: Any) -> Path:
        """Return the path of a file that the scene names."""
        text = text_of(name)
        if "\0" in text:
            raise InputError(f"{text!r}: a file's name has no NUL character")
        return self.path.parent / text

    def transform(self, table: Table) -> NDArray[np.float64] | None:
        """Return the (4, 4) matrix of scale, then rotations in order, then translation."""
        if not any(key in table for key in TRANSFORM):
            return None
        matrix = np.eye(4)
        scale = table.get("scale", 1.0)
        factors = vector(scale, "scale") if isinstance(scale, list) else [number(scale, "scale")] * 3
        matrix[:3, :3] = np.diag(factors)
        if not all(factors):
            raise InputError("scale must not be 0")
        turns = table.get("rotate", [])
        for i, turn in enumerate(turns if isinstance(turns, list) else [turns]):
            with self.at("rotate" + (f"[{i}]" if isinstance(turns, list) else "")):
                self.check_table(table_of(turn), TURN)
                matrix[:3, :3] = product(rotation_matrix(turn["axis"], turn["degrees"]), matrix[:3, :3])
        matrix[:3, 3] = vector(table.get("translate", [0.0, 0.0, 0.0]), "translate")
        return matrix
