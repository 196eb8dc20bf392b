"""Values of scene files: tables, texts, points, and which of several kinds a table is."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, did_you_mean
from wrt.values import number, vector

Table = dict[str, Any]


def choice(table: Table, choices: dict[str, Any], *, default: str | None = None) -> Any:
    """Return what the table's `type` stands for."""
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
    """Return the value if it is text that is not empty."""
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
