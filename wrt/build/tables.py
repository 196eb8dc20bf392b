"""Tables that reflection models read, computed where a scene needs them, once in a process."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable

import numpy as np
from numpy.typing import NDArray

from wrt.build.albedo_tables import reflection_table
from wrt.build.coat_tables import coat_table
from wrt.build.dielectric_tables import dielectric_table
from wrt.device import Device

TableKey = tuple[Hashable, ...]
"""What a material's `table_key` is: the kind of table, a key of MAKERS, and what that function takes."""

MAKERS: dict[str, Callable[..., NDArray[np.float32]]] = {
    "coat": coat_table,
    "reflection": reflection_table,
    "dielectric": dielectric_table,
}
"""Functions (*rest of the key, device) -> floats, by the first part of the key."""

_made: dict[tuple[TableKey, str], NDArray[np.float32]] = {}


def table(key: TableKey, device: Device) -> NDArray[np.float32]:
    """Return the table that a key stands for; it is computed on the device the first time."""
    place = (key, device.name)
    if place not in _made:
        _made[place] = MAKERS[str(key[0])](*key[1:], device)
    return _made[place]


def pack_tables(keys: Iterable[TableKey | None], device: Device) -> tuple[NDArray[np.float32], dict[TableKey, int]]:
    """Return all tables one after the other, and where each begins; None stands for no table."""
    places: dict[TableKey, int] = {}
    parts: list[NDArray[np.float32]] = [np.zeros(0, np.float32)]
    size = 0
    for key in keys:
        if key is not None and key not in places:
            places[key] = size
            parts.append(table(key, device))
            size += len(parts[-1])
    return np.concatenate(parts), places
