"""Values in scene files: tables, text, numbers, points, and the class that a `type` names."""

from __future__ import annotations

import inspect
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, did_you_mean
from wrt.scene.shapes import MAX_SUBDIVISIONS, sphere
from wrt.values import number, vector

Table = dict[str, Any]

_SUBDIVISIONS = inspect.signature(sphere).parameters["subdivisions"].default

MAX_MADE_TRIANGLES = 30_000_000
"""Limit on the triangles of all spheres and procedural meshes of a scene file: a few gigabytes."""


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


def check_triangles(tables: Any, procedural: int | None) -> None:
    """Raise InputError where the spheres and procedural meshes of a scene would be too large together.

    Args:
        tables: the shapes.
        procedural: if given, replaces the number of triangles of each procedural mesh.
    """
    total = 0
    for table in tables if isinstance(tables, list) else []:
        match table:
            case {"type": "sphere", "exact": True}:
                total += 1
            case {"type": "sphere"}:
                times = table.get("subdivisions", _SUBDIVISIONS)
                total += 20 * 4 ** min(max(times, 0), MAX_SUBDIVISIONS) if isinstance(times, int) else 0
            case {"type": "many-triangles", "triangles": int(count)}:
                total += count if procedural is None else procedural
    if total > MAX_MADE_TRIANGLES:
        raise InputError(
            f"spheres and procedural meshes have more than {MAX_MADE_TRIANGLES} triangles together; "
            "give spheres fewer subdivisions"
        )
