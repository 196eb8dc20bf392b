"""Reading of TOML files and their tables: keys and values are checked, and errors name the file and the key."""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, did_you_mean
from wrt.io.safe_read import as_utf8, read_file
from wrt.io.toml.scene_keys import TURN, Keys
from wrt.linalg import product
from wrt.scene.motion import rotation_matrix
from wrt.values import number, vector

Table = dict[str, Any]
Result = TypeVar("Result")

MOST_LEVELS = 64  # most parts of a dotted key. The parser takes time and memory quadratic in their number
_PART = r"""(?:(?<![\w-])[\w-]+|"[^"\n]*"|'[^'\n]*')"""
_TOO_LONG = re.compile(rf"(?:{_PART}[ \t]*\.[ \t]*){{{MOST_LEVELS}}}", re.ASCII)


def _require_short_keys(text: str) -> None:
    """Raise InputError where a dotted key in a TOML file has more than MOST_LEVELS parts."""
    if found := _TOO_LONG.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise InputError(f"line {line}: a dotted key has more than {MOST_LEVELS} parts")


def _require_short_integers(value: Any, key: str = "") -> None:
    """Raise InputError where an integer has more than 64 bits, which TOML forbids and Python may not print."""
    if isinstance(value, dict):
        for name, inner in value.items():
            _require_short_integers(inner, name)
    elif isinstance(value, list):
        for inner in value:
            _require_short_integers(inner, key)
    elif isinstance(value, int) and not -(2**63) <= value < 2**63:
        raise InputError(f"not TOML: {key} is an integer of more than 64 bits")


def read_toml(path: Path) -> dict[str, Any]:
    """Return the tables of a TOML file."""
    if sys.version_info >= (3, 11):
        import tomllib
    else:
        import tomli as tomllib
    try:
        text = as_utf8(read_file(path)).decode("utf-8")
        _require_short_keys(text)
        tables = dict(tomllib.loads(text))
        _require_short_integers(tables)
        return tables
    except UnicodeDecodeError as error:
        raise InputError(f"not UTF-8 text: byte {error.start} is {error.object[error.start]:#04x}") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"not TOML: {error}") from None
    except InputError:
        raise
    except RecursionError:
        raise InputError("not TOML: arrays or tables are nested too deeply") from None
    except (OverflowError, ValueError) as error:
        too_long = "integer string conversion" in str(error)  # Python converts at most 4,300 digits
        what = "an integer of more than 64 bits" if too_long else type(error).__name__
        raise InputError(f"not TOML: {what}") from None


def choice(table: Table, choices: dict[str, Any], *, default: str | None = None) -> Any:
    """Return the choice that the `type` of a table names."""
    names = ", ".join(repr(name) for name in choices)
    kind = table.get("type", default)
    if kind is None:
        raise InputError(f"the key 'type' is missing; it is one of {names}")
    if not isinstance(kind, str) or kind not in choices:
        raise InputError(f"type must be one of {names}, not {kind!r}{did_you_mean(kind, choices)}")
    return choices[kind]


def table_of(value: Any) -> Table:
    """Return the value if it is a table."""
    if not isinstance(value, dict):
        raise InputError(f"must be a table, not {value!r}")
    return value


def text_of(value: Any) -> str:
    """Return the value if it is text and not empty."""
    if not isinstance(value, str) or not value:
        raise InputError(f"must be a text, not {value!r}")
    return value


def numbers_of(value: Any, name: str) -> list[float]:
    """Return the numbers of an array."""
    if not isinstance(value, list):
        raise InputError(f"{name} must be an array of numbers, not {value!r}")
    return [number(item, f"{name}[{i}]") for i, item in enumerate(value)]


def points_of(value: Any, name: str) -> NDArray[np.float64]:
    """Return (N, 3) points from an array of arrays."""
    if not isinstance(value, list):
        raise InputError(f"{name} must be an array of points, not {value!r}")
    return np.array([vector(point, f"{name}[{i}]") for i, point in enumerate(value)]).reshape(-1, 3)


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

    def read(self, table: Table, key: str, convert: Callable[[Any], Result]) -> Result | None:
        """Return the converted value of a key; None if a table does not have the key."""
        if key not in table:
            return None
        with self.at(key):
            return convert(table[key])

    def each(self, tree: Table, key: str, use: Callable[[Table], object]) -> None:
        """Call `use` with each table of an array of tables."""
        with self.at(key):
            tables = tree.get(key, [])
            if not isinstance(tables, list):
                raise InputError(f"must be an array of tables; write [[{key}]]")
            for i, table in enumerate(tables):
                with self.at(f"[{i}]"):
                    use(table_of(table))

    def check_keys(self, table: Table, allowed: Collection[str], required: Iterable[str] = ()) -> None:
        """Raise InputError where a table has keys that are not allowed, or lacks required ones."""
        for key in table:
            if key not in allowed:
                with self.at(key):
                    raise InputError(f"unknown key{did_you_mean(key, allowed)}")
        for key in required:
            if key not in table:
                raise InputError(f"the key {key!r} is missing")

    def check_table(self, table: Table, keys: Keys, fields: Iterable[str] = ()) -> None:
        """Raise InputError where a table has keys that are neither among `keys` nor `fields`, or lacks some."""
        self.check_keys(table, [*keys, *fields], [name for name, key in keys.items() if key.required])

    def call(self, function: Callable[..., Any], table: Table, extra: Collection[str] = ()) -> Any:
        """Call a function or class with the table's keys as arguments, except `extra` keys."""
        parameters = inspect.signature(function).parameters
        required = [name for name, p in parameters.items() if p.default is inspect.Parameter.empty]
        self.check_keys(table, [*parameters, *extra], required)
        return function(**{key: value for key, value in table.items() if key not in extra})

    def file(self, name: Any) -> Path:
        """Return the path of a file that the scene names."""
        text = text_of(name)
        if "\0" in text:
            raise InputError(f"{text!r}: a file's name has no NUL character")
        return self.path.parent / text

    def transform(self, table: Table) -> NDArray[np.float64]:
        """Return the (4, 4) matrix of scale, then rotations in order, then translation."""
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
