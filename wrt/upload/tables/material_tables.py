"""The tables of a scene's reflection models, each computed once in a process."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable

import numpy as np
from numpy.typing import NDArray

from wrt.backend.device import Device
from wrt.upload.arrays import require_countable
from wrt.upload.tables.albedo import dielectric_table, dispersive_table, reflection_table
from wrt.upload.tables.coat import coat_table
from wrt.upload.tables.measured import measured_table

TableKey = tuple[Hashable, ...]
"""A material's `table_key`: the kind of table, a key of MAKERS, then the arguments of that function."""

MAKERS: dict[str, Callable[..., NDArray[np.float32]]] = {
    "coat": coat_table,
    "reflection": reflection_table,
    "dielectric": dielectric_table,
    "dispersive": dispersive_table,
    "measured": measured_table,
}
"""Functions (*arguments, device) -> floats by kind of table."""

_FORGOTTEN = ("measured",)
"""Kinds that are made for each scene anew: they are large, cheap, and made of arrays that a scene may drop."""

_made: dict[tuple[TableKey, str], NDArray[np.float32]] = {}


def _table(key: TableKey, device: Device) -> NDArray[np.float32]:
    """Return the table of a key; of most kinds it is computed on the device the first time only."""
    place = (key, device.name)
    if place in _made:
        return _made[place]
    table = MAKERS[str(key[0])](*key[1:], device)
    if key[0] not in _FORGOTTEN:
        _made[place] = table
    return table


def pack_tables(keys: Iterable[TableKey | None], device: Device) -> tuple[NDArray[np.float32], dict[TableKey, int]]:
    """Return the concatenated tables, and the start of each; None stands for no table."""
    places: dict[TableKey, int] = {}
    parts: list[NDArray[np.float32]] = [np.zeros(0, np.float32)]
    size = 0
    for key in keys:
        if key is not None and key not in places:
            places[key] = size
            parts.append(_table(key, device))
            size += len(parts[-1])
            require_countable(size, "numbers in the tables of the scene's materials")
    return np.concatenate(parts), places
